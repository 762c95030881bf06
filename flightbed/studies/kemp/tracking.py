"""Chapters 4 and 7: tracking of time-varying parameters, and the U-D factored form of the filter; claims and tables."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from typing import Any

import numpy as np
import numpy.typing as npt

from flightbed.document.document import Claim, Section, Table
from flightbed.statistics.intervals import median_interval, spread
from flightbed.studies.base import Part, Trials, keyed_part
from flightbed.studies.judging import above, below, between, mostly, rarely
from flightbed.studies.kemp import methods, printed
from flightbed.studies.kemp.methods import BLOCK, PLID, UD_BLOCK
from flightbed.studies.kemp.trials import PrecisionComparison, compare_precision, difference, track

ERROR = 0.1  # the estimates have arrived when all errors are within this, about the resolution of a figure
AROUND = 3.0  # tolerance of a claimed time, samples
CONDITIONED = 1e-8  # tolerance of the agreement of both forms with a well-conditioned P
SMALL, LARGE = (1e-6, 1e-4), (1e-2, 1e-2)  # r and q of the runs in single precision
PRECISE_SAMPLES = 300
COMPARED = (
    PLID, BLOCK, methods.WHOLE, methods.PSEUDONOISE, methods.RESET, methods.RESET_SMALL, UD_BLOCK, methods.RML, methods.FADING_RML,
)  # fmt: skip
RIVALS = {
    methods.WHOLE: "the fade of the whole matrix",
    methods.PSEUDONOISE: f"pseudonoise of variance {methods.GAMMA:g}",
    methods.RESET: f"resetting the covariance every {methods.RESET_EVERY} samples",
    methods.RESET_SMALL: f"resetting the covariance when the norm of the parameters' gains falls below {methods.RESET_BELOW:g}",
}

Vector = npt.NDArray[np.float64]
Results = Mapping[Any, list[Any]]
STEPPED, DRIFTING = "E stepped", "E"


def arrival(errors: Vector, start: int, end: int) -> float:
    """Return the samples from ``start`` until the errors stay within ``ERROR`` to ``end``; infinite if they do not."""
    away = np.flatnonzero(errors[start:end] > ERROR)
    if not away.size:
        return 0.0
    return float(away[-1] + 1) if away[-1] + 1 < end - start else float("inf")


def tracking(runs: int) -> Part:
    """Track plant E and judge the claims of chapters 4 and 7."""
    jobs: dict[Any, Trials] = {}
    for plant, case, method in product((STEPPED, DRIFTING), (1, 2, 3), COMPARED):
        jobs[plant, case, method] = Trials(track, (plant, case, method), runs)
    for plant, case in product((STEPPED, DRIFTING), (1, 2, 3)):
        jobs["difference", plant, case] = Trials(difference, (plant, case), runs)
    for method, variances in product((methods.SINGLE, methods.UD_SINGLE, PLID), (SMALL, LARGE)):
        jobs["precise", method, variances] = Trials(compare_precision, (method, *variances, PRECISE_SAMPLES), runs)

    def build(results: Results) -> Section:
        return Section(
            "Tracking and factors: chapters 4 and 7",
            [
                f"Plant E drifts from sample 50 to 100 and jumps at 150; the stepped version jumps at 50 and 150. {runs} draws of input "
                f"and noises. An estimate has arrived when no error of a parameter exceeds {ERROR:g}. The thesis gives neither the noises "
                "of Figures 4.2 and 4.3, here r = 0.005 and q = 0.01, nor the settings of its trials of resetting, pseudonoise and "
                "fading RML.",
                "With q = r = 0 P reaches zero and stays there: a factor does not change zero, so the whole fade cannot reactivate the "
                "filter. The block fade keeps P above zero: it enlarges the parameters' block without their correlation to the state. In "
                "noise P does not reach zero, and a fade of 1.001 is a memory of a thousand samples.",
            ],
            [*judge(results), _table(results), _precision_table(results)],
        )

    return keyed_part(jobs, build)


def _arrivals(runs: Sequence[Vector], start: int, end: int) -> list[float]:
    return [arrival(run, start, end) for run in runs]


def judge(results: Results) -> Iterator[Claim]:
    """Judge the claims of chapters 4 and 7."""
    first, _, third = printed.E_CHANGES
    last = printed.E_SAMPLES + 1
    blocked, twelve = results[STEPPED, 1, BLOCK], float(printed.TRACKING_START)
    spans = {"start": (0, first, "Without noise the tracking PLID converges first"),
             "lag": (first, third, "... and follows a jump of the parameters")}  # fmt: skip
    for key, (start, end, words) in spans.items():
        times = median_interval(_arrivals(blocked, start, end))
        yield between(
            f"tracking_{key}", f"{words} after about 4n = {twelve:g} samples.", f"samples until no error is above {ERROR:g}",
            times, twelve - AROUND, twelve + AROUND,
        )  # fmt: skip
    yield mostly(
        "plain_sleeps", "Without such measures PLID does not always follow a change: its gain vanishes.",
        "share of the runs in which it has not arrived 51 samples after the jump at 150",
        [np.isinf(t) for t in _arrivals(results[STEPPED, 1, PLID], third, last)],
    )  # fmt: skip
    for method, words in RIVALS.items():
        rival = _arrivals(results[STEPPED, 1, method], first, third)
        yield above(
            f"worse_{method}", f"Without noise {words} is less effective than the block fade.",
            "samples until arrival after the jump at 50, less those of the block fade",
            [_less(a, b) for a, b in zip(rival, _arrivals(blocked, first, third), strict=True)],
        )  # fmt: skip
    for case, (method, words) in product((2, 3), RIVALS.items()):
        yield above(
            f"worse_{method}_noise_{case}",
            f"In noise (case {case}) {words} is less effective than the block fade.",
            "largest error at sample 149, 99 after the jump, less that of the block fade",
            [
                float(a[third - 1] - b[third - 1])
                for a, b in zip(results[STEPPED, case, method], results[STEPPED, case, BLOCK], strict=True)
            ],
        )
    for case in (2, 3):
        yield above(
            f"noise_slows_{case}", f"In noise tracking is much slower: at least twice the time, case {case} against case 1.",
            "samples until arrival after the jump at 50, noisy less twice the noise-free",
            [
                _less(a, 2.0 * b)
                for a, b in zip(
                    _arrivals(results[STEPPED, case, BLOCK], first, third), _arrivals(blocked, first, third), strict=True
                )
            ],
        )  # fmt: skip
    pairs = zip(results[STEPPED, 1, methods.FADING_RML], blocked, strict=True)
    yield above(
        "fading_rml_sluggish", "Fading RML tracks slowly at best, even without noise.",
        "largest error at sample 149, fading RML less block fade", [float(a[third - 1] - b[third - 1]) for a, b in pairs], ERROR,
    )  # fmt: skip
    pairs = zip(results[STEPPED, 1, methods.FADING_RML], results[STEPPED, 1, methods.RML], strict=True)
    yield above(
        "fading_rml_slower", "... and converges even slower than basic RML.",
        "largest error at sample 49, fading less basic", [float(a[first - 1] - b[first - 1]) for a, b in pairs],
    )  # fmt: skip
    yield from _factors(results)


def _less(a: float, b: float) -> float:
    """Return a - b; 0 for two infinite times."""
    return 0.0 if a == b else a - b


def _factors(results: Results) -> Iterator[Claim]:
    for plant, case in product((STEPPED, DRIFTING), (1, 2, 3)):
        limit = CONDITIONED if case > 1 else 1e-3
        yield mostly(
            f"ud_equal_{plant}_{case}", f"The U-D form gives identical results, plant {plant}, case {case}"
            + (" (Fig. 7.1)." if plant == STEPPED and case == 1 else "."),
            f"share of the runs without a difference of a parameter above {limit:g} at any sample",
            [value < limit for value in results["difference", plant, case]],
        )  # fmt: skip
    single: list[PrecisionComparison] = results["precise", methods.SINGLE, SMALL]
    factored: list[PrecisionComparison] = results["precise", methods.UD_SINGLE, SMALL]
    double: list[PrecisionComparison] = results["precise", PLID, SMALL]
    yield mostly(
        "single_plain_lost", f"In single precision the plain form loses positive definiteness (r, q = {SMALL}).",
        f"share of the runs in which an eigenvalue of P is negative within {PRECISE_SAMPLES} samples", [r.lost is not None for r in single],
    )  # fmt: skip
    yield rarely(
        "single_ud_lost",
        "... and the U-D form keeps it.",
        "the same share for the U-D form",
        [r.lost is not None for r in factored],
    )
    yield mostly(
        "single_ud_stable", "U-D in single precision is as stable as the plain form in double precision.",
        f"share of the runs with a difference below 1e-4 at sample {PRECISE_SAMPLES} from U-D in double precision",
        [r.difference < 1e-4 for r in factored],
    )  # fmt: skip
    yield below(
        "single_ud_accurate", "... and as accurate.",
        "log10 of the largest difference from U-D in double precision, less that of the plain form",
        [float(np.log10((a.difference + 1e-300) / (b.difference + 1e-300))) for a, b in zip(factored, double, strict=True)], 1.0,
    )  # fmt: skip


def _table(results: Results) -> Table:
    first, _, third = printed.E_CHANGES
    rows: list[list[Any]] = []
    for plant, case, method in product((STEPPED, DRIFTING), (1, 2, 3), COMPARED):
        runs = results[plant, case, method]
        r, q = printed.E_CASES[case]
        rows.append(
            [
                plant, f"{case}: r = {r:g}, q = {q:g}", method, spread(_arrivals(runs, 0, first)),
                spread(_arrivals(runs, first, third)) if plant == STEPPED else None, spread(_arrivals(runs, third, printed.E_SAMPLES + 1)),
                *(median_interval([float(run[k]) for run in runs]) for k in (first - 1, 75, third - 1, printed.E_SAMPLES)),
            ]
        )  # fmt: skip
    columns = (
        "plant", "case", "method", "start", "after 50", "after 150", "error at 49", "at 75", "at 149", "at 200",
    )  # fmt: skip
    return Table(
        "tracking", "Plant E: samples until arrival, and largest error of a parameter", columns, rows,
        {**dict.fromkeys(columns[3:6], ".0f"), **dict.fromkeys(columns[6:], ".2g")},
        note="Times: median [5 %, 95 %] of the runs that arrive before the next change. Errors: median with its 95 % interval.",
    )  # fmt: skip


def _precision_table(results: Results) -> Table:
    rows: list[list[Any]] = []
    for variances, method in product((SMALL, LARGE), (methods.SINGLE, methods.UD_SINGLE, PLID)):
        runs: list[PrecisionComparison] = results["precise", method, variances]
        rows.append(
            [
                *variances, method, spread([None if r.lost is None else float(r.lost) for r in runs]),
                median_interval([r.difference for r in runs]), max(r.difference for r in runs),
            ]
        )  # fmt: skip
    return Table(
        "precision", "Plant A in single precision, against U-D in double precision",
        ("r", "q", "form", "first negative eigenvalue of P at sample", "difference of a parameter", "largest"), rows,
        {"r": ".0e", "q": ".0e", "first negative eigenvalue of P at sample": ".0f", "difference of a parameter": ".1e", "largest": ".0e"},
        note=f"Differences at sample {PRECISE_SAMPLES}, median with its 95 % interval, and the largest over all runs. P starts at "
        f"{printed.PRIOR_VAR:g} I; the decisive factor is its reduction by the first readings: by {printed.PRIOR_VAR:g}/r.",
    )  # fmt: skip
