"""3-2-1-1: alternating pulses of 3, 2, 1 and 1 units."""

from __future__ import annotations

from flightbed.command.base import Command
from flightbed.command.pulses import pulses

SIGNS = (1, 1, 1, -1, -1, 1, -1)


def three_two_one_one(*, amplitude_rad_s: float, period_s: float, count: int, start_s: float = 0.0) -> Command:
    """Fly ``count`` sequences of 3 units up, 2 down, 1 up, 1 down, then nothing; a unit is period_s / 7.

    Each sequence is one unit longer up than down and so asks for amplitude * period_s / 7 more of pitch attitude: the signal as it is
    usually flown, not balanced by unequal heights.

    Source:
        The DFVLR signal of Koehler and Wilhelm (1977), as in Jategaonkar, Flight Vehicle System Identification (2006), ch. 2.
    """
    return pulses(SIGNS, amplitude_rad_s=amplitude_rad_s, period_s=period_s, count=count, start_s=start_s)
