"""Gusts as functions of time: vertical speed of the air, m/s, up positive. A gust wraps the previous ones and is zero before its start."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import cos, pi, sin

from flightbed.config import kinds
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


def gusts(settings: Sequence[kinds.GustSettings]) -> Gusts:
    """Return the sum of all gusts, m/s over time."""
    air: Gusts = calm
    for gust in settings:
        if gust.shape == "sine":
            air = sine(air, at_s=gust.at_s, up_m_s=gust.up_fps * FT, frequency_hz=gust.frequency_hz)
            continue
        air = one_minus_cosine(air, at_s=gust.at_s, up_m_s=gust.up_fps * FT, rise_s=gust.rise_s, hold_s=gust.hold_s)
    return air
