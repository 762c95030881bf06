"""Gusts as functions of time: vertical speed of the air, m/s, up positive. A gust wraps the previous ones and is zero before its start."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import cos, pi, sin
from typing import Annotated, Literal

from flightbed.config.kinds import GustSettings, Surroundings
from flightbed.config.table import NonNegative, Positive, example
from flightbed.core.units import FT

Gusts = Callable[[float], float]


def calm(_t_s: float) -> float:
    """Return the vertical speed of calm air, 0 m/s."""
    return 0.0


def one_minus_cosine(before: Gusts, *, at_s: float, up_m_s: float, rise_s: float, hold_s: float) -> Gusts:
    """Add a gust that rises, holds and falls.

    The rise is the discrete gust of MIL-F-8785C, 3.7.1.3, w = (w_m / 2) (1 - cos(pi x / d_m)) over the gust length d_m and w_m beyond,
    in time instead of distance: rise_s = d_m / V. The gust of the standard stays at its peak; this one falls after ``hold_s``, as the
    mirror image of the rise.

    Args:
        before: the previous gusts.
        at_s: start of the rise, s.
        up_m_s: peak, m/s.
        rise_s: duration of the rise and of the fall, s; above 0.
        hold_s: duration of the peak, s.

    """
    middle, half_s = at_s + rise_s + 0.5 * hold_s, 0.5 * hold_s

    def gusts(t_s: float) -> float:
        beside = abs(t_s - middle) - half_s  # time before or after the peak, s; the gust is symmetric
        if beside >= rise_s:
            return before(t_s)
        share = 1.0 if beside <= 0.0 else 0.5 * (1.0 + cos(pi * beside / rise_s))
        return before(t_s) + up_m_s * share

    return gusts


def sine(before: Gusts, *, at_s: float, up_m_s: float, frequency_hz: float) -> Gusts:
    """Add a harmonic gust that starts upwards and lasts to the end of the flight.

    Args:
        before: the previous gusts.
        at_s: start of the gust, s.
        up_m_s: amplitude, m/s.
        frequency_hz: frequency of encounter, Hz.

    """

    def gusts(t_s: float) -> float:
        if t_s <= at_s:
            return before(t_s)
        return before(t_s) + up_m_s * sin(2.0 * pi * frequency_hz * (t_s - at_s))

    return gusts


class OneMinusCosine(GustSettings):
    """A gust that rises as 1 - cos, holds, and falls."""

    shape: Literal["1-cos"] = "1-cos"
    rise_s: Annotated[Positive, example(0.5)]
    """Duration of the rise by (1 - cos)/2 of MIL-F-8785C; the fall mirrors it."""
    hold_s: NonNegative = 0.0
    """Duration of the peak."""

    def build(self, before: Gusts) -> Gusts:
        """Return the vertical speed of the air over time, m/s."""
        return one_minus_cosine(before, at_s=self.at_s, up_m_s=self.up_fps * FT, rise_s=self.rise_s, hold_s=self.hold_s)

    def in_words(self) -> str:
        """Return what happens at ``at_s``."""
        rising = f"rising for {self.rise_s:g} s" + (f", held for {self.hold_s:g} s" if self.hold_s else "")
        return f"a gust of {abs(self.up_fps):g} ft/s {'up' if self.up_fps >= 0.0 else 'down'}, {rising}"


class Sine(GustSettings):
    """A harmonic gust that starts upwards and lasts to the end of the flight."""

    shape: Literal["sine"] = "sine"
    frequency_hz: Annotated[Positive, example(0.5)]
    """Frequency of encounter, below half of rates.control_hz."""

    def build(self, before: Gusts) -> Gusts:
        """Return the vertical speed of the air over time, m/s."""
        return sine(before, at_s=self.at_s, up_m_s=self.up_fps * FT, frequency_hz=self.frequency_hz)

    def in_words(self) -> str:
        """Return what happens at ``at_s``."""
        return f"a harmonic gust of {abs(self.up_fps):g} ft/s begins, at {self.frequency_hz:g} Hz"

    def conflicts(self, place: str, surroundings: Surroundings) -> list[str]:
        """Return the problem of a frequency that the control rate cannot resolve."""
        hz = surroundings.control_hz
        if self.frequency_hz < hz / 2:
            return []
        return [
            f"{place}.frequency_hz: must be below half of rates.control_hz = {hz}, the Nyquist frequency (got {self.frequency_hz:g})"
        ]


def gusts(settings: Sequence[GustSettings]) -> Gusts:
    """Return the sum of all gusts, m/s over time."""
    air: Gusts = calm
    for gust in settings:
        air = gust.build(air)
    return air
