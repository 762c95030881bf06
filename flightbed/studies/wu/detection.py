"""The law of d when nothing fails, thresholds that keep their word, and what they cost in delay."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from flightbed.document import Section, Table
from flightbed.estimation.bias_test import (
    calibrated_threshold,
    chi_square_threshold,
    correlated_threshold,
    effective_degrees,
)
from flightbed.statistics import median_interval, share, spread
from flightbed.studies.base import Part, Trials, keyed
from flightbed.studies.wu import printed
from flightbed.studies.wu.measures import QUIET_S, Measured, Quiet, autocorrelation, delay_s, measure, quiet
from flightbed.studies.wu.simulate import EXTERNAL, FORGETTING, PERIOD_S, Case, Law, aircraft, unstable

NOMINAL = 0.05  # false alarm rate, of a sample in the first table, of a run in the second
QUIETER = 0.1  # factor on the noise, for what is left of gamma-hat's mean
_Runs = Mapping[Any, list[Any]]


def law(runs: int, fewer: int) -> Part:
    """Simulate runs without failure, twice: to calibrate, and to check; and the failures of scenario 1.

    Args:
        runs: without failure, and as many again.
        fewer: runs with the failure.

    """
    jobs: dict[Any, Trials] = {}
    for key, case in quiet_cases().items():
        jobs["first", key] = Trials(quiet, (case,), runs)
        if key[0] != _LESS:
            jobs["again", key] = Trials(quiet, (case,), runs, first_seed=runs)
    for name, forgetting in FORGETTING.items():
        jobs["failed", name] = Trials(measure, (aircraft(1, forgetting),), fewer)

    def build(found: _Runs) -> Section:
        return Section(
            "The test without failure",
            [
                "L d would be chi-square with L degrees of freedom if successive estimates were independent, if they had the variance "
                "that the filter says, and if they had no mean. Successive estimates are nearly the same, so that there is one degree "
                "of freedom rather than three: without forgetting and with the loop open that is all there is to it, and the threshold "
                "for the effective number of degrees keeps its word.",
                "Forgetting makes the filter claim more variance than its estimates have, so that alarms are rarer. And where "
                "estimates are fed back, what is applied to the plant holds the noise of past readings, which the filter takes for "
                "known input: gamma-hat gets a mean. It goes with the noise, and with the loop open; with variable factors, which keep "
                "relying on the last seconds, it is more than a standard deviation. Only thresholds from simulated runs allow for that.",
            ],
            [_law(found), _thresholds(found)],
        )

    return keyed(jobs, build)


_CLOSED, _OPEN, _LESS, _SECOND = (
    "example 1",
    "example 1, loop open",
    f"example 1, {QUIETER:g} of the noise",
    "example 2",
)


def quiet_cases() -> dict[tuple[str, str], Case]:
    """Return the cases without failure: (loop, filter)."""
    found: dict[tuple[str, str], Case] = {}
    for name, f in FORGETTING.items():
        found[_CLOSED, name] = aircraft(None, f)
        found[_OPEN, name] = aircraft(None, f, Law.OPEN)
        found[_LESS, name] = Case(1, (), f, external=EXTERNAL, noise=QUIETER)
        found[_SECOND, name] = unstable(None, f)
    return dict(sorted(found.items(), key=lambda item: (_CLOSED, _LESS, _OPEN, _SECOND).index(item[0][0])))


def _exceeded(runs: Sequence[Quiet], threshold: float) -> Any:
    return share(sum(bool(run.statistic[-1] > threshold) for run in runs), len(runs))


def _law(found: _Runs) -> Table:
    rows: list[list[Any]] = []
    L = printed.WINDOW
    for loop, name in quiet_cases():
        runs: list[Quiet] = found["first", (loop, name)]
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
                *(cell for t in thresholds for cell in (_exceeded(runs, t), float(np.mean(everywhere > t)))),
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
        "law_of_test", f"The law of d without failure, L = {L}", columns, rows, formats | dict.fromkeys(columns[7:11], ".3f"),
        note=f"z = gamma-hat over its standard deviation, of the first input, at {printed.DURATION_S:g} s; correlation: of z from "
        f"sample to sample; above: share of the runs with d above a threshold of nominally {NOMINAL:g}, at the same time, with its "
        f"interval; all samples: the share of all samples from {QUIET_S:g} s on. NIS is {len(printed.AIRCRAFT.C)} in example 1 and "
        f"{len(printed.UNSTABLE.C)} in example 2 for a filter whose model holds.",
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
            failed: list[Measured] = found["failed", name]
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
        note=f"A run of {printed.DURATION_S:g} s, either input. Calibrated: the quantile of the largest d of a run, with its interval "
        "between order statistics, checked on as many fresh runs. Delay: of the elevon's alarm in scenario 1, median [5 %, 95 %]; an "
        "alarm that was false already counts with the first sample.",
    )  # fmt: skip
