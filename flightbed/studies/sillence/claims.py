"""Claims of the thesis, each judged by the 95 % interval of a computed quantity."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise, product
from typing import Any

import numpy as np

from flightbed.analysis.seeds import Flown, Job
from flightbed.document.document import Claim, Section, Table
from flightbed.scenario.tables import Scenario
from flightbed.statistics.intervals import median_interval, spread
from flightbed.studies.base import Part, keyed_part
from flightbed.studies.judging import above, below
from flightbed.studies.sillence import printed
from flightbed.studies.sillence.measures import SETTLED_S, peak, rms_after, rms_before, share_within_two_sigma, tracking
from flightbed.studies.sillence.plots import NOISES, TIME
from flightbed.studies.sillence.setup import DEFAULT, EXPANDING, LAWS_READ, WINDOW, adaptive, estimator, thesis

# Tracking is "near" that of the flight without failure if adaptation removes this share of the RMS error that the failure adds.
NEAR = 0.9
# Smallest relative reduction by the bounds: of the RMS tracking error to be "significant"; of the peak error for the hump to be
# "removed".
SIGNIFICANT, REMOVED = 0.05, 0.5
SMALL, LARGE = "window-15", "window-60"
_PI = "proportional-integral"
_COLUMNS = (TIME, "q_deg_s", "q_ref_deg_s", "effectiveness_true", f"{WINDOW}.effectiveness_raw")
_PRIORS, _INPUTS = {"fixed": "as his", "measurement": "the readings"}, ("mean", "start", "end")
_Flights = Mapping[str, list[Flown]]


def claims(runs: int) -> Part:
    """Fly the scenarios of the claims and judge the claims."""
    jobs = {name: Job(scenario, runs, _COLUMNS) for name, scenario in scenarios().items()}
    jobs["coverage"] = Job(_coverage_scenario(), runs, _coverage_columns())

    def build(flown: _Flights) -> Section:
        return Section(
            "Claims",
            [
                f"Claims of the thesis, {runs} noise draws each. Intervals: 95 %, of the median, between order statistics; differences "
                "are between flights with the same noise. A claim holds if the whole interval meets its condition, and does not hold if "
                "no part of the interval does; otherwise these draws do not settle it.",
                "The adaptive law of the thesis can be read in four ways. In Figure 1, 1/K multiplies a sum that includes the actuator's "
                "position; with the right K that loop differs from the healthy loop, whereas with the position fed back behind the "
                "correction it equals the healthy loop. In S 5.6 the law is fed the estimates of alpha and q, whereas the tables need "
                "the readings only. All four readings are flown. The thesis's figures are drawn here with position feedback behind the "
                "correction and the estimates fed back; a second curve has the position feedback corrected too.",
            ],
            [*judge(flown), _adaptation_table(flown), _coverage_table(flown["coverage"])],
        )

    return keyed_part(jobs, build)


def scenarios() -> dict[str, Scenario]:
    """Return the scenarios of the claims, by name."""
    sizes = [
        estimator(WINDOW),
        estimator(EXPANDING, "expanding"),
        estimator(SMALL, window=15),
        estimator(LARGE, window=60),
    ]
    found: dict[str, Scenario] = {f"fixed {left:g}": thesis(left=left, law=_PI) for left in printed.GAINS_LEFT}
    found["sizes"] = thesis(left=0.2, law=_PI, estimators=sizes)
    found["nothing fails"] = thesis(left=None, law=_PI)
    for feedback, fed in LAWS_READ:
        found[f"{feedback}, {fed}"] = adaptive(feedback=feedback, fed=fed)
    for bounded, left in product((True, False), (0.2, 0.1)):
        found[f"23 dB {'bounded' if bounded else 'unbounded'} {left:g}"] = adaptive(
            left=left, snr="23.29", bounded=bounded
        )
    for snr in ("23.29", "40", "60"):
        found[f"fixed at {snr} dB"] = thesis(left=0.2, law=_PI, noise=NOISES[snr])
    return found


def _coverage_scenario() -> Scenario:
    his = estimator(WINDOW)["prior"]
    of_gain = {key: value for key, value in his.items() if key.startswith("effectiveness")}
    priors = {"fixed": his, "measurement": {"state": "measurement", **of_gain}}
    filters = [estimator(f"{p}-{at}", input_at=at, prior=priors[p]) for p, at in product(_PRIORS, _INPUTS)]
    return thesis(left=0.6, law=_PI, estimators=filters)


def _coverage_columns() -> tuple[str, ...]:
    kept = [
        f"{prior}-{at}.{c}"
        for prior, at in product(_PRIORS, _INPUTS)
        for c in ("effectiveness_raw", "effectiveness_std")
    ]
    return (TIME, "effectiveness_true", *kept)


def judge(flown: _Flights) -> Iterator[Claim]:
    """Judge all claims, from the flights of ``scenarios`` by name, and of the coverage scenario under ``"coverage"``."""
    yield from _quicker(flown)
    yield from _larger_failure(flown)
    yield from _noise(flown)
    yield from _sizes(flown)
    yield from _bounds(flown)
    yield from _adaptation(flown)
    yield _coverage(flown)


def _quicker(flown: _Flights) -> Iterator[Claim]:
    for left in printed.GAINS_LEFT:
        flights = flown[f"fixed {left:g}"]
        for metric, word in (("first_within_20pct_s", "raw"), ("first_within_20pct_smoothed_s", "smoothed")):
            saved = [_sooner(f, (WINDOW, metric), (EXPANDING, "first_within_20pct_s")) for f in flights]
            yield below(
                f"window_quicker_{left:g}_{word}",
                f"The moving window, {word}, finds K_1 = {left:g} sooner than the expanding horizon.",
                "entry into 20 % of K_1, window less expanding horizon, s",
                saved,
            )


def _sooner(flown: Flown, one: tuple[str, str], other: tuple[str, str]) -> float:
    """Return the difference of two event times, s: an event that never happens counts as infinitely late; 0 if neither happens."""
    first, second = (getattr(flown.metrics.estimators[name], metric) for name, metric in (one, other))
    if first is None or second is None:
        return 0.0 if first == second else float("inf" if first is None else "-inf")
    return float(first - second)


def _larger_failure(flown: _Flights) -> Iterator[Claim]:
    for left in printed.GAINS_LEFT:
        yield below(
            f"better_after_{left:g}",
            f"With a fixed law K is estimated better after the failure than before it, K_1 = {left:g}.",
            "RMS error of the window's K-hat, after less before",
            [rms_after(f) - rms_before(f) for f in flown[f"fixed {left:g}"]],
        )
    for less, more in pairwise(printed.GAINS_LEFT):
        pairs = zip(flown[f"fixed {less:g}"], flown[f"fixed {more:g}"], strict=True)
        yield below(
            f"larger_better_{more:g}",
            f"With a fixed law, the larger the failure, the better K is estimated after it: {more:g} against {less:g}.",
            f"RMS error after the failure, K_1 = {more:g} less K_1 = {less:g}",
            [rms_after(b) - rms_after(a) for a, b in pairs],
        )
    for feedback, fed in LAWS_READ:
        pairs = zip(flown["fixed 0.2"], flown[f"{feedback}, {fed}"], strict=True)
        yield above(
            f"adaptation_costs_excitation_{feedback}_{fed}",
            f"Once adaptation has restored tracking, K is estimated worse than with the fixed law, K_1 = 0.2; {_law(feedback, fed)}.",
            "RMS error of the unbounded K-hat after the failure, adapted less fixed",
            [rms_after(adapted) - rms_after(fixed) for fixed, adapted in pairs],
        )


def _law(feedback: str, fed: str) -> str:
    where = "position feedback behind the 1/K" if feedback == "effective" else "position feedback multiplied by 1/K too"
    return f"{where}, law fed the {'estimates' if fed == WINDOW else 'readings'}"


def _noise(flown: _Flights) -> Iterator[Claim]:
    for low, high in (("23.29", "40"), ("40", "60")):
        pairs = zip(flown[f"fixed at {low} dB"], flown[f"fixed at {high} dB"], strict=True)
        yield below(
            f"snr_{low}_{high}",
            f"The estimate is better at {high} dB than at {low} dB.",
            f"RMS error after the failure, {high} dB less {low} dB",
            [rms_after(b) - rms_after(a) for a, b in pairs],
        )


def _sizes(flown: _Flights) -> Iterator[Claim]:
    flights = flown["sizes"]
    yield below(
        "shorter_quicker",
        "A shorter window finds the failure sooner: 15 samples against 60.",
        "entry into 20 % of K_1 = 0.2, 15 samples less 60, s",
        [_sooner(f, (SMALL, "first_within_20pct_s"), (LARGE, "first_within_20pct_s")) for f in flights],
    )
    yield below(
        "longer_calmer",
        "A longer window fluctuates less: 60 samples against 15.",
        "standard deviation of K-hat before the failure, 60 samples less 15",
        [_std_before(f, LARGE) - _std_before(f, SMALL) for f in flights],
    )


def _std_before(flown: Flown, name: str) -> float:
    value = flown.metrics.estimators[name].std_pre
    assert value is not None
    return value


def _bounds(flown: _Flights) -> Iterator[Claim]:
    spans = {
        "before the failure, from 0.3 s on": (0.3, printed.FAILED_AT_S),
        "from 0.3 s after the failure": (SETTLED_S, np.inf),
    }
    for (words, span), left in product(spans.items(), (0.2, 0.1)):
        if span[0] < printed.FAILED_AT_S and left != 0.2:
            continue  # before the failure the flights are identical
        pairs = zip(flown[f"23 dB bounded {left:g}"], flown[f"23 dB unbounded {left:g}"], strict=True)
        yield below(
            f"bounded_{left:g}_{'pre' if span[0] < printed.FAILED_AT_S else 'post'}",
            f"At 23 dB the adaptive law tracks better with K-hat bounded to 0 .. 1, {words}, K_1 = {left:g}.",
            "RMS of q - reference, bounded less unbounded, deg/s",
            [tracking(a, *span) - tracking(b, *span) for a, b in pairs],
        )
    for left in (0.2, 0.1):
        bounded, unbounded = flown[f"23 dB bounded {left:g}"], flown[f"23 dB unbounded {left:g}"]
        yield above(
            f"bounded_significant_{left:g}",
            f"... and the improvement is significant, at least {SIGNIFICANT:.0%} of the RMS, K_1 = {left:g}.",
            "relative reduction by the bounds of the RMS of q - reference, from 0.3 s after the failure",
            [1.0 - tracking(a, SETTLED_S) / tracking(b, SETTLED_S) for a, b in zip(bounded, unbounded, strict=True)],
            SIGNIFICANT,
        )
        yield above(
            f"hump_removed_{left:g}",
            f"... and removes the hump of q just after the failure (Figs. 40, 41), at least {REMOVED:.0%} of the largest error, "
            f"K_1 = {left:g}.",
            "relative reduction by the bounds of the largest |q - reference| within 0.3 s after the failure",
            [1.0 - peak(a) / peak(b) for a, b in zip(bounded, unbounded, strict=True)],
            REMOVED,
        )


def _adaptation(flown: _Flights) -> Iterator[Claim]:
    for feedback, fed in LAWS_READ:
        regained = []
        for flights in zip(flown["fixed 0.2"], flown[f"{feedback}, {fed}"], flown["nothing fails"], strict=True):
            fixed, adapted, whole = (tracking(f, SETTLED_S) for f in flights)
            regained.append((fixed - adapted) / (fixed - whole))
        yield above(
            f"adaptive_near_unfailed_{feedback}_{fed}",
            f"Adaptation at K_1 = 0.2 removes at least {NEAR:.0%} of the tracking error that the failure adds; {_law(feedback, fed)}.",
            f"share removed of the increase by the failure in RMS of q - reference from {SETTLED_S:g} s on",
            regained,
            NEAR,
        )


def _adaptation_table(flown: _Flights) -> Table:
    rows: list[list[Any]] = []
    cases = {"nothing fails": "nothing fails", "fixed law": "fixed 0.2"}
    cases |= {f"adapted, {_law(*reading)}": f"{reading[0]}, {reading[1]}" for reading in LAWS_READ}
    for words, name in cases.items():
        flights = flown[name]
        rows.append(
            [
                words,
                *(
                    spread([f(flight) for flight in flights])
                    for f in (lambda f: tracking(f, SETTLED_S), peak, rms_after)
                ),
            ]
        )
    columns = (
        "K_1 = 0.2, 37.227 dB",
        "RMS of q - reference, deg/s",
        "largest error within 0.3 s, deg/s",
        "RMS error of K-hat, unbounded",
    )
    return Table(
        "adaptation", "Tracking and estimation with and without adaptation", columns, rows,
        dict(zip(columns[1:], (".3f", ".2f", ".4f"), strict=True)),
        note=f"PI law; median [5 %, 95 %]; RMS from {SETTLED_S:g} s to the end, with and without a failure.",
    )  # fmt: skip


def _coverage(flown: _Flights) -> Claim:
    return above(
        "two_sigma",
        "The true K lies within two sigma of the window's estimate 95 % of the time (Fig. 34), windows that contain the failure "
        "excluded.",
        "share of the estimates within two sigma of the true K, K_1 = 0.6, this study's set-up",
        [share_within_two_sigma(f, f"fixed-{DEFAULT.input_at}") for f in flown["coverage"]],
        0.95,
    )


def _coverage_table(flights: Sequence[Flown]) -> Table:
    rows: list[list[Any]] = [
        [words, *(median_interval([share_within_two_sigma(f, f"{prior}-{at}") for f in flights]) for at in _INPUTS)]
        for prior, words in _PRIORS.items()
    ]
    columns = ("the window's prior", *(f"u_k: {at}" for at in _INPUTS))
    return Table(
        "coverage", "Share of the window's estimates within two sigma of the true K, K_1 = 0.6", columns, rows,
        dict.fromkeys(columns[1:], ".3f"),
        note="Median over the flights, with its 95 % interval; windows that contain the failure, and the first window, are excluded. A "
        "consistent sigma gives 0.954. The choice of u_k dominates: the deflection at one end of the sample differs from the mean "
        "deflection over the sample by up to half a sample's motion, and sigma does not include this error. The deliberately wrong prior "
        "has little effect.",
    )  # fmt: skip
