"""Claims of the paper, each judged by the 95 % interval of a computed quantity."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

from flightbed.document.document import Claim, Section
from flightbed.statistics.intervals import median_interval
from flightbed.studies.base import Part, Trials, keyed_part
from flightbed.studies.gupta import printed
from flightbed.studies.gupta.rivals import HARMONIC, rivals
from flightbed.studies.gupta.tables import LARGE, SMALL
from flightbed.studies.gupta.trials import (
    EXAMPLES,
    LAST,
    WITHIN,
    Case,
    RunMeasures,
    as_printed,
    forgetful,
    initial_std,
    measure,
)

_RIGID, _DAMPED, _NEAR, _FAR, _MISSILE = EXAMPLES
_EXACT = 1e-6  # an estimate without noise is exact if its error, as a share of the amplitude, is below this
_FINE_S = 0.02  # the shorter period of the claim on sampling
_AS_PRINTED = {_RIGID: "1", _DAMPED: "2", _MISSILE: "5"}


def cases() -> dict[str, Case]:
    """Return the cases of the claims, by name."""
    three = as_printed("3")
    fine = replace(three, period_s=_FINE_S, samples=round(three.samples * three.period_s / _FINE_S))
    quiet = 1e-4 * three.initial_covariance  # small enough for convergence of all runs
    found = {
        "unregularized": replace(EXAMPLES[_RIGID], regularization=0.0),
        "damping, large": replace(three, initial_scale=LARGE),
        "damping, small": replace(three, initial_scale=SMALL),
        "damping, coarse": replace(three, initial_covariance=quiet, initial_scale=SMALL),
        "damping, fine": replace(fine, initial_covariance=quiet, initial_scale=SMALL),
    }
    for name, case in EXAMPLES.items():
        found[name], found[f"{name}, forgetting"] = case, forgetful(case)
    return found


def claims(runs: int) -> Part:
    """Run the cases of the claims and judge the claims."""
    jobs: dict[str, Trials] = {name: Trials(measure, (case,), runs) for name, case in cases().items()}
    jobs["rivals"] = Trials(rivals, (EXAMPLES[_RIGID],), runs)

    def build(results: Mapping[str, list[Any]]) -> Section:
        return Section(
            "Claims",
            [
                f"Claims of the paper's text and figures, {runs} initial states and phases each. An input is reconstructed if the RMS "
                f"error over the last {LAST} samples is below {WITHIN:.0%} of the amplitude. Intervals: 95 %, of the median, between "
                "order statistics. A claim holds if the whole interval meets its condition, and does not hold if no part of the interval "
                "does; otherwise it is open.",
            ],
            list(judge(results)),
        )

    return keyed_part(jobs, build)


def _below(key: str, text: str, measured: str, values: Sequence[float], limit: float = WITHIN) -> Claim:
    found = median_interval(values)
    return Claim(key, text, measured, found, True if found.high < limit else False if found.low >= limit else None)


def _above(key: str, text: str, measured: str, values: Sequence[float], limit: float) -> Claim:
    found = median_interval(values)
    return Claim(key, text, measured, found, True if found.low > limit else False if found.high <= limit else None)


def judge(results: Mapping[str, list[Any]]) -> Iterator[Claim]:
    """Judge all claims, from the results of ``cases`` by name and of the rivals on example 1 under ``"rivals"``."""
    for name, number in _AS_PRINTED.items():
        made: list[RunMeasures] = results[name]
        yield _below(
            f"input_{number}", f"Example {name}: the input is reconstructed, with the settings printed.",
            "error of the input, shares of its amplitude", [m.error for m in made],
        )  # fmt: skip
        yield _below(
            f"states_{number}", f"Example {name}: the states are reconstructed.",
            "largest error of a state, shares of its RMS under the input alone", [m.state_error for m in made],
        )  # fmt: skip
    yield _above(
        "needs_regularization", "Example 1 needs the regularization: with eta = 0 it does not converge.", "error without it",
        [m.error for m in results["unregularized"]], WITHIN,
    )  # fmt: skip
    yield _above(
        "kalman_nonminimum_phase",
        "Introduction: for a nonminimum-phase plant a Kalman filter cannot be asymptotically exact. Here example 1, and a filter with "
        "the frequency of the input.",
        f"error of this filter, shares of the amplitude; not exact above {_EXACT:g}",
        [float(run[HARMONIC]) for run in results["rivals"]],
        _EXACT,
    )
    yield from _damping(results)
    yield from _mismatch(results)


def _damping(results: Mapping[str, list[Any]]) -> Iterator[Claim]:
    for size in ("large", "small"):
        scale = f"{initial_std(cases()[f'damping, {size}'])[0]:g} m"
        off = [abs(m.damping / printed.DAMPING - 1.0) for m in results[f"damping, {size}"]]
        yield _below(
            f"damping_{size}", f"Example 3: the damping is identified within 2 %, P(0) = I, initial states of about {scale}.",
            "relative error of the damping", off,
        )  # fmt: skip
    pairs = zip(results["damping, fine"], results["damping, coarse"], strict=True)
    yield _below(
        "damping_period",
        f"Example 3: the accuracy depends on the sample period: {_FINE_S:g} s is better than 0.1 s (small P(0): all runs converge).",
        "absolute error of the damping, 0.02 s less 0.1 s, N s/m",
        [abs(a.damping - printed.DAMPING) - abs(b.damping - printed.DAMPING) for a, b in pairs], 0.0,
    )  # fmt: skip


def _mismatch(results: Mapping[str, list[Any]]) -> Iterator[Claim]:
    for name, word in ((_NEAR, "near"), (_FAR, "far")):
        for settings, suffix in (("as printed", ""), ("with forgetting", ", forgetting")):
            made: list[RunMeasures] = results[name + suffix]
            key = f"{word}_{settings.rpartition(' ')[2]}"
            if word == "near":
                yield _below(
                    f"input_4_{key}", f"Example {name}, {settings}: the input is reconstructed, with a damping close to the true one.",
                    "error of the input, shares of its amplitude", [m.error for m in made],
                )  # fmt: skip
            yield _below(
                f"equivalent_4_{key}", f"Example {name}, {settings}: the equivalent input of the wrong model is reconstructed.",
                "error against the equivalent input, shares of the input's amplitude", [m.equivalent_error for m in made],
            )  # fmt: skip
    near, far = results[f"{_NEAR}, forgetting"], results[f"{_FAR}, forgetting"]
    yield _below(
        "nearer_better", "Example 4: the closer the damping of the model to the true one, the smaller the error: 4 against 10 N s/m.",
        "error of the input with c_0 = 4 less that with 10", [a.error - b.error for a, b in zip(near, far, strict=True)], 0.0,
    )  # fmt: skip
