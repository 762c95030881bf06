"""Claims of the paper, each judged by the 95 % interval of a computed quantity."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from flightbed.document.document import Claim, Section
from flightbed.estimation.two_stage.change_test import chi_square_threshold
from flightbed.statistics.intervals import median_interval, share
from flightbed.studies.base import Part, Trials, keyed_part
from flightbed.studies.wu import printed
from flightbed.studies.wu.measures import (
    EARLY_S,
    ON_RAMP_S,
    SETTLED_S,
    QuietRun,
    Recovery,
    RunMeasures,
    early_statistic,
    measure,
    quiet_run,
    recovery,
)
from flightbed.studies.wu.simulate import FORGETTING, LEFT, NONE, PERIOD_S, VARIABLE, Case, Law, aircraft, unstable

FOLLOWED = 0.1  # the estimate follows the ramp if its RMS error is below this: a quarter of the fall
RARE = 0.05  # d is small until the failure if the share of runs with an earlier alarm is below this
NOMINAL = 0.05  # nominal false alarm rate per sample at which the distribution of d is tested
FACTOR = 2.0  # the distribution of d holds if the rate is within this factor of the nominal rate
NEGLIGIBLE = 0.25  # the mean of gamma-hat is negligible below this, in standard deviations
NEARER = 0.05  # the response is nearer if its distance from the run without failure is lower by at least this share
UNSTABLE, SETTLED = 10.0, 2.0  # late RMS of the outputs relative to no failure: unstable above, settled below
ADAPTED = {Law.REDESIGNED: "redesign by eqs (47)-(49)", Law.OFFSET: "redesign with offset weights"}
ALPHA_THETA = (1, 3)
_Found = Mapping[Any, list[Any]]


def claims(runs: int, without_failure: int) -> Part:
    """Simulate the cases of the claims and judge the claims.

    Args:
        runs: noise draws per case.
        without_failure: runs without failure, for the distribution of the test statistic d.

    """

    def build(found: _Found) -> Section:
        return Section(
            "Claims",
            [
                f"Claims of the paper, {runs} noise draws each, {without_failure} without failure. Intervals: 95 %, of medians between "
                "order statistics, of shares exact; differences are between runs with the same noise. A claim holds if the whole "
                "interval meets its condition, and does not hold if no part of the interval does; otherwise these draws do not settle "
                "it.",
                f"Errors of K-hat are RMS over both inputs from {SETTLED_S:g} s after the first change on; the tables give them over the "
                "whole time since the change. The paper introduces the filters in the order none, constant factor, variable factors; its "
                "text does not claim that the constant factor is better than none.",
            ],
            list(judge(found)),
        )

    return keyed_part(trials(runs, without_failure), build)


def trials(runs: int, without_failure: int) -> dict[Any, Trials]:
    """Return the simulations of the claims, by key: the keys of ``cases``, ``("recovery", law)`` and ``("quiet", law)``."""
    found: dict[Any, Trials] = {key: Trials(measure, (case,), runs) for key, case in cases().items()}
    for law in ADAPTED:
        found["recovery", law] = Trials(recovery, (aircraft(1, law=law), ALPHA_THETA), runs)
    found["recovery", Law.FIXED] = Trials(recovery, (aircraft(1), ALPHA_THETA), runs)
    found["quiet", Law.FIXED] = Trials(quiet_run, (aircraft(None),), without_failure)
    found["quiet", Law.OPEN] = Trials(quiet_run, (aircraft(None, NONE, Law.OPEN),), without_failure)
    return found


def cases() -> dict[Any, Case]:
    """Return the cases by key: (scenario, filter) of example 1; law, or "healthy", of example 2."""
    found: dict[Any, Case] = {(s, name): aircraft(s, f) for s in printed.SCENARIOS for name, f in FORGETTING.items()}
    found |= {law: unstable(LEFT, VARIABLE, law) for law in (Law.FIXED, *ADAPTED)}
    return found | {"healthy": unstable(None)}


def judge(found: _Found) -> Iterator[Claim]:
    """Judge all claims, from the results of ``trials`` by key."""
    yield from _ordering(found)
    yield below(
        "ramp_followed",
        "The variable factors follow an incipient loss (the ramp of scenario 5): RMS error below a quarter of the fall.",
        f"RMS error of the elevon's K-hat from {ON_RAMP_S:g} s after the ramp's start to its end",
        [run.ramp for run in found[5, "variable"]],
        FOLLOWED,
    )
    yield from _test(found)
    yield from _recovery(found)
    yield from _stability(found)
    yield from _adaptation(found)


def below(key: str, text: str, measured: str, values: Sequence[float], limit: float = 0.0) -> Claim:
    """Judge the claim that the median of the values is below a limit, from the 95 % interval of the median."""
    interval = median_interval(values)
    return Claim(key, text, measured, interval, _side(limit - interval.high, limit - interval.low))


def above(key: str, text: str, measured: str, values: Sequence[float], limit: float = 0.0) -> Claim:
    """Judge the claim that the median of the values is above a limit, from the 95 % interval of the median."""
    interval = median_interval(values)
    return Claim(key, text, measured, interval, _side(interval.low - limit, interval.high - limit))


def _side(least: float, most: float) -> bool | None:
    return True if least > 0.0 else False if most <= 0.0 else None


def _ordering(found: _Found) -> Iterator[Claim]:
    words = {"none": "no forgetting", "constant": "the constant factor", "variable": "the set of variable factors"}
    for scenario in printed.SCENARIOS:
        pairs = [*pairwise(FORGETTING), ("none", "variable")]
        for worse, better in pairs:
            yield below(
                f"{better}_better_than_{worse}_{scenario}",
                f"Scenario {scenario}: with {words[better]} K is estimated better than with {words[worse]}.",
                f"RMS error of K-hat, {better} less {worse}",
                [
                    b.error_settled - a.error_settled
                    for a, b in zip(found[scenario, worse], found[scenario, better], strict=True)
                ],
            )


def _test(found: _Found) -> Iterator[Claim]:
    runs: list[RunMeasures] = found[1, "variable"]
    alarms = share(sum(run.before > printed.THRESHOLD for run in runs), len(runs))
    yield Claim(
        "small_until_failure",
        f"In at least {1.0 - RARE:.0%} of the runs d stays below the paper's threshold of {printed.THRESHOLD:g} until effectiveness is "
        "lost (scenario 1, variable factors).",
        "share of runs with a false alarm of either input before the failure",
        alarms,
        _side(RARE - alarms.high, RARE - alarms.low),
    )
    raised = share(sum(bool(np.any(r.statistic[r.failed :] > printed.THRESHOLD)) for r in runs), len(runs))
    yield Claim(
        "raised_after_failure", "... and exceeds it after the loss.", "share of runs with an alarm of the elevon after the failure", raised,
        _side(raised.low - 1.0 + RARE, raised.high - 1.0 + RARE),
    )  # fmt: skip
    for law, words in ((Law.FIXED, "closed loop, variable factors"), (Law.OPEN, "open loop, no forgetting")):
        yield from _law_of_test(found["quiet", law], law.value, words)


def _law_of_test(runs: Sequence[QuietRun], key: str, words: str) -> Iterator[Claim]:
    threshold = chi_square_threshold(printed.WINDOW, NOMINAL)
    rate = share(sum(bool(run.statistic[-1] > threshold) for run in runs), len(runs))
    inside = rate.low > NOMINAL / FACTOR and rate.high < NOMINAL * FACTOR
    outside = rate.high < NOMINAL / FACTOR or rate.low > NOMINAL * FACTOR
    yield Claim(
        f"chi_square_{key}",
        f"Without failure L d is chi-square with L = {printed.WINDOW} degrees of freedom ({words}): the share of runs above its "
        f"{1 - NOMINAL:.0%} point is nominal, within a factor of {FACTOR:g}.",
        f"share of runs with d of the elevon above that point at the end, nominally {NOMINAL:g}",
        rate,
        True if inside else False if outside else None,
    )
    mean = median_interval([run.last for run in runs])
    small = max(abs(mean.low), abs(mean.high)) < NEGLIGIBLE
    large = mean.low > NEGLIGIBLE or mean.high < -NEGLIGIBLE
    yield Claim(
        f"zero_mean_{key}",
        f"Without failure gamma-hat has zero mean, within {NEGLIGIBLE:g} of its standard deviation ({words}).",
        "gamma-hat of the elevon in standard deviations at the end, median",
        mean,
        True if small else False if large else None,
    )


def _recovery(found: _Found) -> Iterator[Claim]:
    for law, words in ADAPTED.items():
        for column, name in enumerate(("alpha", "theta")):
            fixed: list[Recovery] = found["recovery", Law.FIXED]
            pairs = zip(fixed, found["recovery", law], strict=True)
            yield above(
                f"recovered_{name}_{law.value}",
                f"Reconfiguration brings {name} nearer to the run without failure, by at least {NEARER:.0%} (scenario 1, Fig. 4; {words}).",
                "relative reduction by reconfiguration of the RMS distance from the run without failure",
                [float(1.0 - b.outputs[column] / a.outputs[column]) for a, b in pairs],
                NEARER,
            )


def _stability(found: _Found) -> Iterator[Claim]:
    healthy: list[RunMeasures] = found["healthy"]

    def late(law: Law) -> list[float]:
        return [run.late / whole.late for run, whole in zip(found[law], healthy, strict=True)]

    measured = "RMS of x1 and x3 over the last 5 s, relative to the run without failure"
    yield above(
        "unstable_without",
        f"Example 2 without adaptation becomes unstable when {1 - LEFT:.0%} of the first input is lost.",
        measured,
        late(Law.FIXED),
        UNSTABLE,
    )
    for law, words in ADAPTED.items():
        yield below(f"settled_with_{law.value}", f"... and settles with it ({words}).", measured, late(law), SETTLED)


def _adaptation(found: _Found) -> Iterator[Claim]:
    fixed: list[RunMeasures] = found[Law.FIXED]
    for law, words in ADAPTED.items():
        adapted: list[RunMeasures] = found[law]
        pairs = list(zip(fixed, adapted, strict=True))
        yield above(
            f"more_indicative_{law.value}",
            f"d is more indicative of the change with an adaptive law ({words}), within {EARLY_S:g} s of the failure.",
            "logarithm of the largest d of the first input, adapted over fixed",
            [float(np.log(early_statistic(b, PERIOD_S) / early_statistic(a, PERIOD_S))) for a, b in pairs],
        )
        yield above(
            f"more_indicative_ever_{law.value}",
            f"... over the whole run ({words}).",
            "logarithm of the largest d of the first input, adapted over fixed",
            [float(np.log(np.max(b.statistic[b.failed :]) / np.max(a.statistic[a.failed :]))) for a, b in pairs],
        )
        yield below(
            f"more_accurate_{law.value}",
            f"K is estimated more accurately with an adaptive law ({words}).",
            "RMS error of K-hat, adapted less fixed",
            [b.error_settled - a.error_settled for a, b in pairs],
        )
