"""What the thesis argues from, each as a claim that the computation bears out or does not, with its interval."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from flightbed.document import Claim, Section
from flightbed.ensemble import Flown, Job
from flightbed.settings import Scenario
from flightbed.statistics import median_interval
from flightbed.studies.base import Part, keyed
from flightbed.studies.sillence import printed
from flightbed.studies.sillence.plots import NOISES, TIME
from flightbed.studies.sillence.setup import EXPANDING, WINDOW, estimator, thesis

NEAR = 0.9  # share of what the failure costs in tracking that adaptation must win back to be "near" the flight without failure
SIGNIFICANT = 0.05  # share of the tracking error that bounds must save for the improvement to be called significant
SMALL, LARGE = "window-15", "window-60"
_PI = "proportional-integral"
_COLUMNS = (TIME, "effectiveness_true", f"{WINDOW}.effectiveness_raw", f"{WINDOW}.effectiveness_std")
_Flights = Mapping[str, list[Flown]]


def claims(runs: int) -> Part:
    """Fly what the claims need, and judge them."""
    jobs = {name: Job(scenario, runs, _COLUMNS) for name, scenario in scenarios().items()}

    def build(flown: _Flights) -> Section:
        return Section(
            "Claims",
            [
                f"What the thesis argues from, over {runs} noise draws each. Intervals are of 95 %: of a median, by bootstrap; differences "
                "are those of flights with the same noise. A claim holds if the whole interval lies on its side.",
            ],
            list(judged(flown)),
        )

    return keyed(jobs, build)


def scenarios() -> dict[str, Scenario]:
    """Return what the claims are judged by."""
    sizes = [
        estimator(WINDOW),
        estimator(EXPANDING, "expanding"),
        estimator(SMALL, window=15),
        estimator(LARGE, window=60),
    ]
    bounded, free = estimator(WINDOW, bounds=(0.0, 1.0)), estimator(WINDOW)
    filters = [bounded, estimator(EXPANDING, "expanding")]
    found: dict[str, Scenario] = {f"fixed {left:g}": thesis(left=left, law=_PI) for left in printed.GAINS_LEFT}
    found["sizes"] = thesis(left=0.2, law=_PI, estimators=sizes)
    found["nothing fails"] = thesis(left=None, law=_PI)
    for feedback in ("effective", "position"):
        found[f"adapted, {feedback}"] = thesis(
            left=0.2, law=_PI, adapts=WINDOW, estimators=filters, adaptation={"feedback": feedback}
        )
    for name, filter_ in (("bounded", bounded), ("unbounded", free)):
        for left in (0.2, 0.1):
            found[f"23 dB {name} {left:g}"] = thesis(
                left=left, law=_PI, adapts=WINDOW, noise=NOISES["23.29"], estimators=[filter_, filters[1]]
            )
    for snr in ("23.29", "40", "60"):
        found[f"fixed at {snr} dB"] = thesis(left=0.2, law=_PI, noise=NOISES[snr])
    return found


def judged(flown: _Flights) -> Iterator[Claim]:
    """Judge all claims by the flights of ``scenarios``."""
    yield from _quicker(flown)
    yield from _larger_failure(flown)
    yield from _noise(flown)
    yield from _sizes(flown)
    yield from _bounds(flown)
    yield from _adaptation(flown)
    yield _coverage(flown)


def _below(key: str, text: str, measured: str, values: Sequence[float], limit: float = 0.0) -> Claim:
    interval = median_interval(values)
    return Claim(key, text, measured, interval, interval.high < limit)


def _above(key: str, text: str, measured: str, values: Sequence[float], limit: float = 0.0) -> Claim:
    interval = median_interval(values)
    return Claim(key, text, measured, interval, interval.low > limit)


def _quicker(flown: _Flights) -> Iterator[Claim]:
    for left in printed.GAINS_LEFT:
        flights = flown[f"fixed {left:g}"]
        for metric, word in (("first_within_20pct_s", "raw"), ("first_within_20pct_smoothed_s", "smoothed")):
            saved = [_entry(f, WINDOW, metric) - _entry(f, EXPANDING, "first_within_20pct_s") for f in flights]
            yield _below(
                f"window_quicker_{left:g}_{word}",
                f"The moving window, {word}, finds K_1 = {left:g} sooner than the expanding horizon.",
                "entry into 20 % of K_1, window less expanding horizon, s",
                saved,
            )


def _entry(flown: Flown, name: str, metric: str) -> float:
    value = getattr(flown.metrics.estimators[name], metric)
    return float("inf") if value is None else float(value)


def _larger_failure(flown: _Flights) -> Iterator[Claim]:
    for left in (0.2, 0.1):
        yield _below(
            f"better_after_{left:g}",
            f"With a fixed law K is estimated better after the failure than before it, K_1 = {left:g}.",
            "RMS error of the window's K-hat, after less before",
            [_rms_after(f) - _rms_before(f) for f in flown[f"fixed {left:g}"]],
        )
    least, most = flown["fixed 0.8"], flown["fixed 0.1"]
    yield _below(
        "larger_better",
        "The larger the failure that the fixed law does not follow, the better K is estimated after it.",
        "RMS error after the failure, K_1 = 0.1 less K_1 = 0.8",
        [_rms_after(b) - _rms_after(a) for a, b in zip(least, most, strict=True)],
    )
    pairs = zip(flown["fixed 0.2"], flown["adapted, effective"], strict=True)
    yield _above(
        "adaptation_costs_excitation",
        "Once adaptation has restored tracking, K is estimated worse than with the fixed law, K_1 = 0.2.",
        "RMS error after the failure, before the bounds, adapted less fixed",
        [_rms_after(adapted) - _rms_after(fixed) for fixed, adapted in pairs],
    )


def _noise(flown: _Flights) -> Iterator[Claim]:
    for low, high in (("23.29", "40"), ("40", "60")):
        pairs = zip(flown[f"fixed at {low} dB"], flown[f"fixed at {high} dB"], strict=True)
        yield _below(
            f"snr_{low}_{high}",
            f"The estimate is better at {high} dB than at {low} dB.",
            f"RMS error after the failure, {high} dB less {low} dB",
            [_rms_after(b) - _rms_after(a) for a, b in pairs],
        )


def _sizes(flown: _Flights) -> Iterator[Claim]:
    flights = flown["sizes"]
    yield _below(
        "shorter_quicker",
        "A shorter window finds the failure sooner: 15 samples against 60.",
        "entry into 20 % of K_1 = 0.2, 15 samples less 60, s",
        [_entry(f, SMALL, "first_within_20pct_s") - _entry(f, LARGE, "first_within_20pct_s") for f in flights],
    )
    yield _below(
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
    for phase in ("post", "pre"):
        for left in (0.2, 0.1):
            pairs = zip(flown[f"23 dB bounded {left:g}"], flown[f"23 dB unbounded {left:g}"], strict=True)
            yield _below(
                f"bounded_{left:g}_{phase}",
                f"At 23 dB the adaptive law tracks better with K-hat kept within 0 and 1, {'after' if phase == 'post' else 'before'} "
                f"the failure, K_1 = {left:g}.",
                "RMS of q - reference, bounded less unbounded, deg/s",
                [_tracking(a, phase) - _tracking(b, phase) for a, b in pairs],
            )
    pairs = zip(flown["23 dB bounded 0.1"], flown["23 dB unbounded 0.1"], strict=True)
    yield _above(
        "bounded_significant",
        f"... and the improvement is significant, K_1 = 0.1: at least {SIGNIFICANT:.0%} of the RMS.",
        "share of the RMS of q - reference after the failure that the bounds save",
        [1.0 - _tracking(a) / _tracking(b) for a, b in pairs],
        SIGNIFICANT,
    )


def _tracking(flown: Flown, phase: str = "post") -> float:
    value = getattr(flown.metrics, f"tracking_rms_{phase}_deg_s")
    return float("nan") if value is None else float(value)


def _late(flown: Flown) -> float:
    """RMS of q - reference over a whole flight without failure."""
    return _tracking(flown, "pre")


def _adaptation(flown: _Flights) -> Iterator[Claim]:
    words = {
        "effective": "the position feedback lies behind the 1/K",
        "position": "the position feedback is multiplied by 1/K too",
    }
    for feedback, word in words.items():
        regained = []
        for fixed, adapted, whole in zip(
            flown["fixed 0.2"], flown[f"adapted, {feedback}"], flown["nothing fails"], strict=True
        ):
            regained.append((_tracking(fixed) - _tracking(adapted)) / (_tracking(fixed) - _late(whole)))
        yield _above(
            f"adaptive_near_unfailed_{feedback}",
            f"Adaptation at K_1 = 0.2 brings tracking near that of the flight without failure, at least {NEAR:.0%} of the way; {word}.",
            "share of the failure's cost in RMS of q - reference that is won back",
            regained,
            NEAR,
        )


def _coverage(flown: _Flights) -> Claim:
    shares = [_within(f, 2.0) for f in flown["fixed 0.6"]]
    interval = median_interval(shares)
    return Claim(
        "two_sigma",
        "Two sigma around the window's estimate hold the truth 95 % of the time (Fig. 34), windows that hold the failure left out.",
        "share of the estimates within two sigma of the truth, K_1 = 0.6",
        interval,
        interval.low <= 0.9545 <= interval.high or interval.low > 0.9545,
    )


def _within(flown: Flown, sigmas: float) -> float:
    t = flown.columns[TIME]
    clean = (t > 0.3) & ~((t >= printed.FAILED_AT_S) & (t < printed.FAILED_AT_S + 0.3))
    return float(np.mean((np.abs(_error(flown)) <= sigmas * flown.columns[f"{WINDOW}.effectiveness_std"])[clean]))


def _error(flown: Flown) -> Any:
    return flown.columns[f"{WINDOW}.effectiveness_raw"] - flown.columns["effectiveness_true"]


def _rms_before(flown: Flown) -> float:
    t = flown.columns[TIME]
    return float(np.sqrt(np.mean(_error(flown)[(t > 0.3) & (t < printed.FAILED_AT_S - 1e-9)] ** 2)))


def _rms_after(flown: Flown) -> float:
    return float(np.sqrt(np.mean(_error(flown)[_settled(flown)] ** 2)))


def _settled(flown: Flown) -> Any:
    return flown.columns[TIME] >= printed.FAILED_AT_S + 0.3 - 1e-9
