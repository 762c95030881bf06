"""What the paper argues from, each as a claim that the computation bears out or does not, with its interval."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from flightbed.document import Claim, Section
from flightbed.estimation.bias_test import chi_square_threshold
from flightbed.statistics import median_interval, share
from flightbed.studies.base import Part, Trials, keyed
from flightbed.studies.wu import printed
from flightbed.studies.wu.measures import (
    EARLY_S,
    ON_RAMP_S,
    SETTLED_S,
    Measured,
    Quiet,
    Recovery,
    early,
    measure,
    quiet,
    recovery,
)
from flightbed.studies.wu.simulate import FORGETTING, LEFT, NONE, PERIOD_S, VARIABLE, Case, Law, aircraft, unstable

FOLLOWED = 0.1  # RMS error on the ramp, a quarter of its fall, below which the estimate follows it
RARE = 0.05  # share of runs with a false alarm before the failure below which d is small until then
NOMINAL = 0.05  # false alarm rate of a sample that the law of d is tested at
FACTOR = 2.0  # within which the rate must be of the nominal one for the law to hold
NEGLIGIBLE = 0.25  # mean of gamma-hat, in standard deviations, below which it has none to speak of
NEARER = 0.05  # share of the distance from the run without failure that must be saved for the response to be nearer
UNSTABLE, SETTLED = 10.0, 2.0  # late RMS of the outputs, times that without failure: above the one, below the other
ADAPTED = {Law.REDESIGNED: "redesign by eqs (47)-(49)", Law.OFFSET: "redesign with offset weights"}
ALPHA_THETA = (1, 3)
_Found = Mapping[Any, list[Any]]


def claims(runs: int, without_failure: int) -> Part:
    """Simulate what the claims need, and judge them.

    Args:
        runs: noise draws of each case.
        without_failure: runs that the law of the test is judged by.

    """

    def build(found: _Found) -> Section:
        return Section(
            "Claims",
            [
                f"What the paper argues from, over {runs} noise draws each, {without_failure} without failure. Intervals are of 95 %, "
                "of medians between order statistics, of shares exact; differences are those of runs with the same noise. A claim "
                "holds if the whole interval lies on its side, and does not if none of it does; else these draws do not settle it.",
                f"Errors of K-hat are RMS over both inputs from {SETTLED_S:g} s after the first change on; over the whole time since the "
                "change see the tables. That the constant factor does better than none the text does not say; it is the order in which "
                "the filters are introduced.",
            ],
            list(judged(found)),
        )

    return keyed(trials(runs, without_failure), build)


def trials(runs: int, without_failure: int) -> dict[Any, Trials]:
    """Return what the claims are judged by."""
    found: dict[Any, Trials] = {key: Trials(measure, (case,), runs) for key, case in cases().items()}
    for law in ADAPTED:
        found["recovery", law] = Trials(recovery, (aircraft(1, law=law), ALPHA_THETA), runs)
    found["recovery", Law.FIXED] = Trials(recovery, (aircraft(1), ALPHA_THETA), runs)
    found["quiet", Law.FIXED] = Trials(quiet, (aircraft(None),), without_failure)
    found["quiet", Law.OPEN] = Trials(quiet, (aircraft(None, NONE, Law.OPEN),), without_failure)
    return found


def cases() -> dict[Any, Case]:
    """Return the cases that are measured: (scenario, filter) of example 1, laws of example 2."""
    found: dict[Any, Case] = {(s, name): aircraft(s, f) for s in printed.SCENARIOS for name, f in FORGETTING.items()}
    found |= {law: unstable(LEFT, VARIABLE, law) for law in (Law.FIXED, *ADAPTED)}
    return found | {"healthy": unstable(None)}


def judged(found: _Found) -> Iterator[Claim]:
    """Judge all claims by the runs of ``trials``."""
    yield from _ordering(found)
    yield below(
        "ramp_followed",
        "The variable factors follow an incipient loss (scenario 5's ramp): RMS error below a quarter of its fall.",
        f"RMS error of the elevon's K-hat from {ON_RAMP_S:g} s after the ramp's start to its end",
        [run.ramp for run in found[5, "variable"]],
        FOLLOWED,
    )
    yield from _test(found)
    yield from _recovery(found)
    yield from _stability(found)
    yield from _adaptation(found)


def below(key: str, text: str, measured: str, values: Sequence[float], limit: float = 0.0) -> Claim:
    """Return a claim that a median lies below a limit."""
    interval = median_interval(values)
    return Claim(key, text, measured, interval, _side(limit - interval.high, limit - interval.low))


def above(key: str, text: str, measured: str, values: Sequence[float], limit: float = 0.0) -> Claim:
    """Return a claim that a median lies above a limit."""
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
    runs: list[Measured] = found[1, "variable"]
    alarms = share(sum(run.before > printed.THRESHOLD for run in runs), len(runs))
    yield Claim(
        "small_until_failure",
        f"d stays below the paper's threshold of {printed.THRESHOLD:g} until effectiveness is lost (scenario 1, variable factors), but "
        f"for at most {RARE:.0%} of the runs.",
        "share of runs with a false alarm of either input before the failure",
        alarms,
        _side(RARE - alarms.high, RARE - alarms.low),
    )
    raised = share(sum(bool(np.any(r.statistic[r.failed :] > printed.THRESHOLD)) for r in runs), len(runs))
    yield Claim(
        "raised_after_failure", "... and exceeds it once it is.", "share of runs with an alarm of the elevon after the failure", raised,
        _side(raised.low - 1.0 + RARE, raised.high - 1.0 + RARE),
    )  # fmt: skip
    for law, words in ((Law.FIXED, "closed loop, variable factors"), (Law.OPEN, "open loop, no forgetting")):
        yield from _law_of_test(found["quiet", law], law.value, words)


def _law_of_test(runs: Sequence[Quiet], key: str, words: str) -> Iterator[Claim]:
    threshold = chi_square_threshold(printed.WINDOW, NOMINAL)
    rate = share(sum(bool(run.statistic[-1] > threshold) for run in runs), len(runs))
    inside = rate.low > NOMINAL / FACTOR and rate.high < NOMINAL * FACTOR
    outside = rate.high < NOMINAL / FACTOR or rate.low > NOMINAL * FACTOR
    yield Claim(
        f"chi_square_{key}",
        f"Without failure L d is chi-square with L = {printed.WINDOW} degrees of freedom ({words}): its {1 - NOMINAL:.0%} point is "
        f"exceeded as often as that says, within a factor of {FACTOR:g}.",
        f"share of runs with d of the elevon above it at the end, nominally {NOMINAL:g}",
        rate,
        True if inside else False if outside else None,
    )
    mean = median_interval([run.last for run in runs])
    small = max(abs(mean.low), abs(mean.high)) < NEGLIGIBLE
    large = mean.low > NEGLIGIBLE or mean.high < -NEGLIGIBLE
    yield Claim(
        f"zero_mean_{key}",
        f"Without failure gamma-hat has no mean, to within {NEGLIGIBLE:g} of its standard deviation ({words}).",
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
                f"Reconfiguration brings {name} nearer to what it is without failure, by {NEARER:.0%} at least (scenario 1, Fig. 4; "
                f"{words}).",
                "share of the RMS distance from the run without failure that reconfiguration saves",
                [float(1.0 - b.outputs[column] / a.outputs[column]) for a, b in pairs],
                NEARER,
            )


def _stability(found: _Found) -> Iterator[Claim]:
    healthy: list[Measured] = found["healthy"]

    def late(law: Law) -> list[float]:
        return [run.late / whole.late for run, whole in zip(found[law], healthy, strict=True)]

    measured = "RMS of x1 and x3 over the last 5 s, over that without failure"
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
    fixed: list[Measured] = found[Law.FIXED]
    for law, words in ADAPTED.items():
        adapted: list[Measured] = found[law]
        pairs = list(zip(fixed, adapted, strict=True))
        yield above(
            f"more_indicative_{law.value}",
            f"d is more indicative of the change with an adaptive law ({words}), within {EARLY_S:g} s of the failure.",
            "logarithm of the largest d of the first input, adapted over fixed",
            [float(np.log(early(b, PERIOD_S) / early(a, PERIOD_S))) for a, b in pairs],
        )
        yield above(
            f"more_indicative_ever_{law.value}",
            f"... over the whole run ({words}).",
            "logarithm of the largest d of the first input, adapted over fixed",
            [float(np.log(np.max(b.statistic[b.failed :]) / np.max(a.statistic[a.failed :]))) for a, b in pairs],
        )
        yield below(
            f"more_accurate_{law.value}",
            f"K is estimated more accurately when the law is adaptive ({words}).",
            "RMS error of K-hat, adapted less fixed",
            [b.error_settled - a.error_settled for a, b in pairs],
        )
