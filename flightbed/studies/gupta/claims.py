"""What the paper argues from, each as a claim that the computation bears out or does not, with its interval."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

from flightbed.document import Claim, Section
from flightbed.statistics import median_interval
from flightbed.studies.base import Part, Trials, keyed
from flightbed.studies.gupta import printed
from flightbed.studies.gupta.rivals import HARMONIC, rivals
from flightbed.studies.gupta.tables import LARGE, SMALL
from flightbed.studies.gupta.trials import (
    EXAMPLES,
    LAST,
    WITHIN,
    Case,
    Measured,
    as_printed,
    forgetful,
    initial_std,
    measured,
)

_RIGID, _DAMPED, _NEAR, _FAR, _MISSILE = EXAMPLES
_EXACT = 1e-6  # of the amplitude: below it an estimate without noise is called exact
_FINE_S = 0.02  # the shorter period of the claim on sampling
_AS_PRINTED = {_RIGID: "1", _DAMPED: "2", _MISSILE: "5"}


def cases() -> dict[str, Case]:
    """Return what the claims are judged by."""
    three = as_printed("3")
    fine = replace(three, period_s=_FINE_S, samples=round(three.samples * three.period_s / _FINE_S))
    quiet = 1e-4 * three.initial_covariance  # so small that all runs converge
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
    """Run what the claims need, and judge them."""
    jobs: dict[str, Trials] = {name: Trials(measured, (case,), runs) for name, case in cases().items()}
    jobs["rivals"] = Trials(rivals, (EXAMPLES[_RIGID],), runs)

    def build(results: Mapping[str, list[Any]]) -> Section:
        return Section(
            "Claims",
            [
                f"What the paper's text and figures say, over {runs} initial states and phases each. An input is reconstructed if the "
                f"error over the last {LAST} samples is below {WITHIN:.0%} of the amplitude, RMS. Intervals are of 95 %, of the median, "
                "between order statistics; a claim holds if the whole interval lies on its side, and does not if none of it does.",
            ],
            list(judged(results)),
        )

    return keyed(jobs, build)


def _below(key: str, text: str, measured: str, values: Sequence[float], limit: float = WITHIN) -> Claim:
    found = median_interval(values)
    return Claim(key, text, measured, found, True if found.high < limit else False if found.low >= limit else None)


def _above(key: str, text: str, measured: str, values: Sequence[float], limit: float) -> Claim:
    found = median_interval(values)
    return Claim(key, text, measured, found, True if found.low > limit else False if found.high <= limit else None)


def judged(results: Mapping[str, list[Any]]) -> Iterator[Claim]:
    """Judge all claims by the runs of ``cases`` and the rivals on example 1."""
    for name, number in _AS_PRINTED.items():
        made: list[Measured] = results[name]
        yield _below(
            f"input_{number}", f"Example {name}: the input is reconstructed, with the settings printed.",
            "error of the input, shares of its amplitude", [m.error for m in made],
        )  # fmt: skip
        yield _below(
            f"states_{number}", f"Example {name}: so are the states.", "largest error of a state, shares of the RMS the input gives it",
            [m.state_error for m in made],
        )  # fmt: skip
    yield _above(
        "needs_regularization", "Example 1 needs the regularization: with eta = 0 it does not converge.", "error without it",
        [m.error for m in results["unregularized"]], WITHIN,
    )  # fmt: skip
    yield _above(
        "kalman_nonminimum_phase",
        "Introduction: where the plant is nonminimum-phase a Kalman filter cannot be asymptotically exact. Example 1, a filter that has "
        "the input's frequency:",
        f"error of that filter, shares of the amplitude; above {_EXACT:g} is not exact",
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
            f"damping_{size}", f"Example 3: the damping is found within 2 %, P(0) = I, from initial states of about {scale}.",
            "relative error of the damping", off,
        )  # fmt: skip
    pairs = zip(results["damping, fine"], results["damping, coarse"], strict=True)
    yield _below(
        "damping_period", f"Example 3: how well depends on the sampling: {_FINE_S:g} s is better than 0.1 s (P(0) small: all converge).",
        "absolute error of the damping, 0.02 s less 0.1 s, N s/m",
        [abs(a.damping - printed.DAMPING) - abs(b.damping - printed.DAMPING) for a, b in pairs], 0.0,
    )  # fmt: skip


def _mismatch(results: Mapping[str, list[Any]]) -> Iterator[Claim]:
    for name, word in ((_NEAR, "near"), (_FAR, "far")):
        for settings, suffix in (("as printed", ""), ("with forgetting", ", forgetting")):
            made: list[Measured] = results[name + suffix]
            key = f"{word}_{settings.rpartition(' ')[2]}"
            if word == "near":
                yield _below(
                    f"input_4_{key}", f"Example {name}, {settings}: the input is reconstructed, the damping being near enough.",
                    "error of the input, shares of its amplitude", [m.error for m in made],
                )  # fmt: skip
            yield _below(
                f"equivalent_4_{key}", f"Example {name}, {settings}: what is reconstructed is the equivalent input of the wrong model.",
                "error against that, shares of the input's amplitude", [m.equivalent_error for m in made],
            )  # fmt: skip
    near, far = results[f"{_NEAR}, forgetting"], results[f"{_FAR}, forgetting"]
    yield _below(
        "nearer_better", "Example 4: the nearer the believed damping to the true one, the better: 4 against 10 N s/m.",
        "error of the input with c_0 = 4 less that with 10", [a.error - b.error for a, b in zip(near, far, strict=True)], 0.0,
    )  # fmt: skip
