"""3-2-1-1: alternating pulses of 3, 2, 1 and 1 units."""

from __future__ import annotations

from flightbed.command.base import Command
from flightbed.command.pulses import pulses
from flightbed.config import kinds
from flightbed.core.units import DEG

SIGNS = (1, 1, 1, -1, -1, 1, -1)


def three_two_one_one(*, amplitude_rad_s: float, period_s: float, count: int, start_s: float = 0.0) -> Command:
    """Fly ``count`` sequences of 3 units up, 2 down, 1 up, 1 down; zero before and after. A unit is period_s / 7.

    Each sequence holds the positive sign one unit longer than the negative, so it raises the commanded pitch attitude by
    amplitude * period_s / 7. This is the usual form of the signal; unequal heights would balance it.

    Source:
        The DFVLR signal of Koehler and Wilhelm (1977), as given by Jategaonkar, Flight Vehicle System Identification (2006), ch. 2.
    """
    return pulses(SIGNS, amplitude_rad_s=amplitude_rad_s, period_s=period_s, count=count, start_s=start_s)


def build(settings: kinds.Command) -> Command:
    """Alternate pulses of +-amplitude_deg_s, 3, 2, 1 and 1 sevenths of period_s long, count sequences."""
    return three_two_one_one(
        amplitude_rad_s=settings.amplitude_deg_s * DEG,
        period_s=settings.period_s,
        count=settings.count,
        start_s=settings.start_s,
    )
