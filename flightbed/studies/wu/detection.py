"""Distribution of the test statistic d without failure, calibrated thresholds, and their detection delay."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from flightbed.document.document import Section, Table
from flightbed.estimation.two_stage.change_test import (
    calibrated_threshold,
    chi_square_threshold,
    correlated_threshold,
    effective_degrees,
)
from flightbed.statistics.intervals import median_interval, share, spread
from flightbed.studies.base import Part, Trials, keyed_part
from flightbed.studies.wu import printed
from flightbed.studies.wu.measures import QUIET_S, QuietRun, RunMeasures, autocorrelation, delay_s, measure, quiet_run
from flightbed.studies.wu.simulate import EXTERNAL, FORGETTING, PERIOD_S, Case, Law, aircraft, unstable

NOMINAL = 0.05  # false alarm rate, per sample in the first table, per run in the second
QUIETER = 0.1  # factor on the noise of a case that shows the mean of gamma-hat with little noise
_Runs = Mapping[Any, list[Any]]


def law(runs: int, fewer: int) -> Part:
    """Simulate runs without failure for calibration, as many again for the check, and runs of scenario 1.

    Args:
        runs: runs without failure, for the calibration and again for the check.
        fewer: runs of scenario 1.

    """
    jobs: dict[Any, Trials] = {}
    for key, case in quiet_cases().items():
        jobs["first", key] = Trials(quiet_run, (case,), runs)
        if key[0] != _LESS:
            jobs["again", key] = Trials(quiet_run, (case,), runs, first_seed=runs)
    for name, forgetting in FORGETTING.items():
        jobs["failed", name] = Trials(measure, (aircraft(1, forgetting),), fewer)

    def build(found: _Runs) -> Section:
        return Section(
            "The test without failure",
            [
                "L d is chi-square with L degrees of freedom if successive estimates are independent, have the variance that the filter "
                "computes, and have zero mean. In fact successive estimates are nearly equal, so there is one degree of freedom rather "
                "than three: without forgetting and in open loop this is the only deviation, and the threshold for the effective number "
                "of degrees gives the nominal rate.",
                "With forgetting the filter computes a larger variance than its estimates have, so alarms are rarer. Where estimates are "
                "fed back, the applied input contains the noise of past readings, and the filter takes it for a known input: gamma-hat "
                "has a mean. It is small at a tenth of the noise and in open loop; with variable factors, which rely on the last "
                "seconds, it exceeds one standard deviation. Only thresholds from simulated runs include this effect.",
            ],
            [_law(found), _thresholds(found)],
        )

    return keyed_part(jobs, build)


_CLOSED, _OPEN, _LESS, _SECOND = (
    "example 1",
    "example 1, loop open",
    f"example 1, {QUIETER:g} of the noise",
    "example 2",
)


def quiet_cases() -> dict[tuple[str, str], Case]:
    """Return the cases without failure, by (loop, filter)."""
    found: dict[tuple[str, str], Case] = {}
    for name, f in FORGETTING.items():
        found[_CLOSED, name] = aircraft(None, f)
        found[_OPEN, name] = aircraft(None, f, Law.OPEN)
        found[_LESS, name] = Case(1, (), f, external=EXTERNAL, noise=QUIETER)
        found[_SECOND, name] = unstable(None, f)
    return dict(sorted(found.items(), key=lambda item: (_CLOSED, _LESS, _OPEN, _SECOND).index(item[0][0])))


def _share_above(runs: Sequence[QuietRun], threshold: float) -> Any:
    return share(sum(bool(run.statistic[-1] > threshold) for run in runs), len(runs))


def _law(found: _Runs) -> Table:
    rows: list[list[Any]] = []
    L = printed.WINDOW
    for loop, name in quiet_cases():
        runs: list[QuietRun] = found["first", (loop, name)]
        rho = autocorrelation(runs)
        degrees = effective_degrees(rho, L)
        late = [run.last for run in runs]
        thresholds = (chi_square_threshold(L, NOMINAL), correlated_threshold(degrees, NOMINAL))
        everywhere = np.array([run.statistic[round(QUIET_S / PERIOD_S) :] for run in runs])
        rows.append(
            [
                loop,
                name,
                median_interval([run.gamma for run in runs]),
                median_interval(late),
                float(np.std(late)),
                float(rho[0]),
                degrees,
                *(cell for t in thresholds for cell in (_share_above(runs, t), float(np.mean(everywhere > t)))),
                float(np.mean([run.nis for run in runs])),
                len(runs),
            ]
        )
    columns = (
        "loop", "forgetting", "gamma-hat, median", "z, median", "z, standard deviation", "correlation", "degrees",
        "above chi-square, L degrees", "all samples", "above chi-square, effective degrees", "all samples ", "mean NIS", "runs",
    )  # fmt: skip
    formats = (
        {columns[2]: ".3f"}
        | dict.fromkeys(columns[3:5], ".2f")
        | {"correlation": ".3f", "degrees": ".2f", "mean NIS": ".2f"}
    )
    return Table(
        "law_of_test", f"Distribution of d without failure, L = {L}", columns, rows, formats | dict.fromkeys(columns[7:11], ".3f"),
        note=f"z = gamma-hat / standard deviation, first input, at {printed.DURATION_S:g} s; correlation: between z at successive "
        f"samples; above: share of the runs with d at the same time above a threshold of nominally {NOMINAL:g}, with its interval; all "
        f"samples: share of all samples from {QUIET_S:g} s on. The NIS of a filter with a correct model is {len(printed.AIRCRAFT.C)} in "
        f"example 1 and {len(printed.UNSTABLE.C)} in example 2.",
    )  # fmt: skip


def _thresholds(found: _Runs) -> Table:
    rows: list[list[Any]] = []
    for loop, name in quiet_cases():
        if loop == _LESS:
            continue
        runs, fresh = found["first", (loop, name)], found["again", (loop, name)]
        calibrated = calibrated_threshold([run.largest for run in runs], NOMINAL)
        above = share(sum(run.largest > calibrated.threshold for run in fresh), len(fresh))
        paper = share(sum(run.largest > printed.THRESHOLD for run in runs), len(runs))
        delays: list[Any] = [None, None]
        if loop == _CLOSED:
            failed: list[RunMeasures] = found["failed", name]
            levels = (printed.THRESHOLD, calibrated.threshold)
            delays = [spread([delay_s(run, level, PERIOD_S) for run in failed]) for level in levels]
        where = f"{calibrated.threshold:.1f} ({calibrated.low:.1f} to {calibrated.high:.1f})"
        rows.append([loop, name, paper, where, above, *delays])
    columns = (
        "loop", "forgetting", f"runs with a false alarm, threshold {printed.THRESHOLD:g}", "calibrated threshold",
        "fresh runs with a false alarm", f"delay, threshold {printed.THRESHOLD:g}, s", "delay, calibrated, s",
    )  # fmt: skip
    formats = dict.fromkeys((columns[2], columns[4]), ".3f") | dict.fromkeys(columns[5:], ".1f")
    return Table(
        "thresholds", f"Thresholds for a false alarm in {NOMINAL:.0%} of the runs", columns, rows, formats,
        note=f"A run of {printed.DURATION_S:g} s, either input. Calibrated: quantile of the largest d of a run, with its interval between "
        "order statistics, checked on as many fresh runs. Delay: of the elevon's alarm in scenario 1, median [5 %, 95 %]; if d is above "
        "the threshold already before the failure, the alarm counts at the first sample after it.",
    )  # fmt: skip
