"""Gusts: functions of time that compose, the vertical speed of the air in m/s, up positive; calm air before their start."""

from __future__ import annotations

from collections.abc import Callable
from math import cos, pi, sin

Gusts = Callable[[float], float]


def calm(_t_s: float) -> float:
    """Air at rest."""
    return 0.0


def one_minus_cosine(before: Gusts, *, at_s: float, up_m_s: float, rise_s: float, hold_s: float) -> Gusts:
    """Add to the air so far a gust that rises, holds and falls.

    The rise is the discrete gust of MIL-F-8785C, 3.7.1.3, w = (w_m / 2) (1 - cos(pi x / d_m)) over the gust length d_m and w_m beyond,
    in time instead of distance: rise_s = d_m / V. The standard's gust stays; this one falls again after ``hold_s``, by
    the rise's mirror image.

    Args:
        before: the air so far.
        at_s: time at which it begins to rise, s.
        up_m_s: its peak, m/s.
        rise_s: time of the rise, and of the fall, s; above 0.
        hold_s: time at the peak, s.

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
    """Add to the air so far a harmonic gust that begins with a rise and goes on to the end of the flight.

    Args:
        before: the air so far.
        at_s: time at which it begins, s.
        up_m_s: its amplitude, m/s.
        frequency_hz: its frequency as the aircraft meets it, Hz.

    """

    def gusts(t_s: float) -> float:
        if t_s <= at_s:
            return before(t_s)
        return before(t_s) + up_m_s * sin(2.0 * pi * frequency_hz * (t_s - at_s))

    return gusts
