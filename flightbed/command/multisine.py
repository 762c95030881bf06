"""Multisine: harmonics of equal power, phased for the smallest peak factor."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from math import ceil, inf, log2, pi
from typing import Literal

import numpy as np
import numpy.typing as npt

from flightbed.command.band import band_conflicts
from flightbed.command.base import ROUND_OFF_S, Command, Count, Vector, relative_peak_factor
from flightbed.config.kinds import ShapedCommand, Surroundings
from flightbed.config.table import NonNegative, Positive
from flightbed.core.harmonics import MOST_HARMONICS, harmonics

_CURVATURES = (1.0, 1.5, 2.0)  # of the initial phases; a single start sometimes ends in a poor local minimum
_NORMS = (4, 8, 16, 32, 64, 128, 256, 512)
_COARSE, _FINE = (
    16,
    256,
)  # samples per cycle of the highest harmonic: during the search, and to evaluate its result


def schroeder_phases(number: int, *, curvature: float = 1.0) -> Vector:
    """Return phases of cosines for a flat spectrum, (number,), rad: -pi c k (k + 1) / number, k from 0.

    Source:
        Schroeder (1970), IEEE Trans. Information Theory 16, 85-89, with c = 1. Other curvatures c only start the search.
    """
    k = np.arange(number)
    return -pi * curvature * k * (k + 1) / number


def flat_phases(numbers: Sequence[int]) -> Vector:
    """Return phases of cosines with a small relative peak factor; the sum crosses zero upwards at time 0.

    Minimizes ||u - c||_p over the phases and the offset c, for p = 4, 8, ... 512, each starting from the previous minimum: as p goes to
    infinity the norm tends to half of max u - min u, at constant rms. The search starts from Schroeder's phases and from two sets of
    higher curvature, and the best result is kept; no start is random. Time is then shifted to a rising zero crossing.

    Args:
        numbers: (n,) harmonic numbers, ascending.

    Returns:
        (n,) rad.

    Source:
        The criterion and the shift are Morelli's (Klein and Morelli, Aircraft System Identification, 2006, ch. 9), the norms of rising
        order Guillaume and others' (1991, IEEE Trans. Instrumentation and Measurement 40, 982-989). Departures: Morelli searches by a
        simplex, Guillaume by Gauss-Newton for the peak of abs(u), without c; here L-BFGS with the exact gradient, from FFTs.
    """
    return _flat_phases(tuple(numbers)).copy()


@cache
def _flat_phases(numbers: tuple[int, ...]) -> Vector:
    found = [_flattened(numbers, schroeder_phases(len(numbers), curvature=c)) for c in _CURVATURES]
    best = min(found, key=lambda phases: relative_peak_factor(one_period(numbers, phases)))
    n, u = np.array(numbers), one_period(numbers, best)
    i = int(np.flatnonzero((np.roll(u, 1) < -1e-6) & (np.roll(u, -1) > 1e-6))[0])  # beyond round-off on either side
    step = 2.0 * pi / len(u)
    from scipy.optimize import brentq  # slow to import

    turn = brentq(lambda x: float(np.sum(np.cos(n * x + best))), (i - 1) * step, (i + 1) * step, xtol=1e-14)
    return (best + n * turn) % (2.0 * pi)


def one_period(numbers: Sequence[int], phases: Vector, *, per_cycle: int = _FINE) -> Vector:
    """Return one period of the sum of unit cosines, at least ``per_cycle`` samples per cycle of the highest harmonic."""
    return _sampled(np.array(numbers), phases, _samples(numbers, per_cycle))


def _samples(numbers: Sequence[int], per_cycle: int) -> int:
    return int(2 ** ceil(log2(per_cycle * max(numbers))))


def _sampled(n: npt.NDArray[np.int_], phases: Vector, samples: int) -> Vector:
    spectrum = np.zeros(samples // 2 + 1, dtype=complex)
    spectrum[n] = 0.5 * samples * np.exp(1j * phases)
    return np.fft.irfft(spectrum, samples)


def _flattened(numbers: Sequence[int], phases: Vector) -> Vector:
    from scipy.optimize import minimize  # slow to import

    n, samples = np.array(numbers), _samples(numbers, _COARSE)
    x = np.append(phases, 0.0)
    for p in _NORMS:
        x = minimize(_norm, x, args=(n, samples, p), jac=True, method="L-BFGS-B", options={"maxiter": 200}).x
    return x[:-1]


def _norm(x: Vector, n: npt.NDArray[np.int_], samples: int, p: int) -> tuple[float, Vector]:
    """Return (mean of (u - c)^p)^(1/p), p even, and its gradient over the phases and c; x = (phases, c)."""
    v = _sampled(n, x[:-1], samples) - x[-1]
    peak = float(np.max(np.abs(v)))
    v /= peak  # prevents overflow of v**p
    mean = float(np.mean(v**p))
    weight = v ** (p - 1) * mean ** (1.0 / p - 1.0) / samples  # weight of each sample in the gradient
    by_phase = (np.exp(1j * x[:-1]) * np.conj(np.fft.rfft(weight)[n])).imag  # the sum of weight * sin(n t + phase)
    return peak * mean ** (1.0 / p), -np.append(by_phase, np.sum(weight))


def multisine(
    *, amplitude_rad_s: float, low_hz: float, high_hz: float, period_s: float, count: float, start_s: float = 0.0
) -> Command:
    """Fly ``count`` periods of a low-peak-factor sum of all harmonics of 1 / period_s in the band; zero before and after.

    u = A / peak * sum over n of cos(2 pi n tau / period_s + phase_n), with the phases of `flat_phases`: all harmonics have the same
    power, the mean is zero, and the command starts and ends at a zero crossing, without a jump.

    Args:
        amplitude_rad_s: largest abs(u), with a relative error of 1e-4; not the amplitude of a single harmonic.
        low_hz: lower end of the band, included.
        high_hz: upper end of the band, included.
        period_s: period of the fundamental.
        count: number of periods; ``math.inf`` for dither.
        start_s: start of the command.

    Raises:
        ValueError: the band has no harmonic.

    """
    numbers = harmonics(low_hz=low_hz, high_hz=high_hz, period_s=period_s)
    if not numbers:
        raise ValueError(f"no multiple of 1/{period_s:g} Hz lies between {low_hz:g} and {high_hz:g} Hz; widen the band")
    phases = flat_phases(numbers)
    each = amplitude_rad_s / float(np.max(np.abs(one_period(numbers, phases))))

    def command(t_s: Vector) -> Vector:
        since = t_s - start_s
        turn = 2.0 * pi * (since / period_s % 1.0)
        total = np.zeros_like(turn)
        for n, phase in zip(numbers, phases, strict=True):
            total += np.cos(n * turn + phase)
        active = (since >= 0.0) & (since < count * period_s - ROUND_OFF_S)
        return np.where(active, each * total, 0.0)

    return command


class Dither(ShapedCommand):
    """A multisine of small amplitude from start_s to the end of the flight, which excites level flight."""

    kind: Literal["dither"] = "dither"
    amplitude_deg_s: float = 0.5
    """Peak of a commanded rate."""
    period_s: Positive = 4.5
    """Period of the fundamental."""
    start_s: NonNegative = 0.0
    """Start."""
    low_hz: NonNegative = 0.2
    """Lower end of the band, included."""
    high_hz: Positive = 2.0
    """Upper end of the band, included."""

    def build(self, amplitude_rad_s: float) -> Command:
        """Return the command over time."""
        return multisine(
            amplitude_rad_s=amplitude_rad_s,
            low_hz=self.low_hz,
            high_hz=self.high_hz,
            period_s=self.period_s,
            count=inf,
            start_s=self.start_s,
        )

    def conflicts(self, place: str, surroundings: Surroundings) -> list[str]:
        """Return the problems of the band and of its number of harmonics."""
        return _band_conflicts(self, place, surroundings.control_hz)


class Multisine(ShapedCommand):
    """All harmonics of 1/period_s in the band, phased for a small peak factor, count periods."""

    kind: Literal["multisine"] = "multisine"
    period_s: Positive = 4.5
    """Period of the fundamental."""
    count: Count = 3
    """Number of periods."""
    start_s: NonNegative = 0.0
    """Start."""
    low_hz: NonNegative = 0.2
    """Lower end of the band, included."""
    high_hz: Positive = 2.0
    """Upper end of the band, included."""

    def build(self, amplitude_rad_s: float) -> Command:
        """Return the command over time."""
        return multisine(
            amplitude_rad_s=amplitude_rad_s,
            low_hz=self.low_hz,
            high_hz=self.high_hz,
            period_s=self.period_s,
            count=self.count,
            start_s=self.start_s,
        )

    def conflicts(self, place: str, surroundings: Surroundings) -> list[str]:
        """Return the problems of the band and of its number of harmonics."""
        return _band_conflicts(self, place, surroundings.control_hz)


def _band_conflicts(settings: Dither | Multisine, place: str, control_hz: int) -> list[str]:
    low_hz, high_hz = settings.low_hz, settings.high_hz
    problems = band_conflicts(place, low_hz=low_hz, high_hz=high_hz, control_hz=control_hz)
    if low_hz > high_hz:
        return problems
    found = len(harmonics(low_hz=low_hz, high_hz=high_hz, period_s=settings.period_s))
    if not 1 <= found <= MOST_HARMONICS:
        cure = "widen the band or lengthen the period" if found == 0 else "narrow the band or shorten the period"
        problems.append(
            f"{place}.period_s: the band from low_hz to high_hz must hold 1 to {MOST_HARMONICS} multiples of 1/period_s "
            f"(got {found}); {cure}"
        )
    return problems
