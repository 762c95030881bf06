"""3-2-1-1: alternating pulses of 3, 2, 1 and 1 units."""

from __future__ import annotations

from typing import Literal

from flightbed.command.base import Command, Count
from flightbed.command.pulses import pulse_conflicts, pulses
from flightbed.config.kinds import ShapedCommand, Surroundings
from flightbed.config.table import NonNegative, Positive

SIGNS = (1, 1, 1, -1, -1, 1, -1)


def three_two_one_one(*, amplitude_rad_s: float, period_s: float, count: int, start_s: float = 0.0) -> Command:
    """Fly ``count`` sequences of 3 units up, 2 down, 1 up, 1 down; zero before and after. A unit is period_s / 7.

    Each sequence holds the positive sign one unit longer than the negative, so it raises the commanded pitch attitude by
    amplitude * period_s / 7. This is the usual form of the signal; unequal heights would balance it.

    Source:
        The DFVLR signal of Koehler and Wilhelm (1977), as given by Jategaonkar, Flight Vehicle System Identification (2006), ch. 2.
    """
    return pulses(SIGNS, amplitude_rad_s=amplitude_rad_s, period_s=period_s, count=count, start_s=start_s)


class ThreeTwoOneOne(ShapedCommand):
    """Alternating pulses of 3, 2, 1 and 1 sevenths of period_s, count times."""

    kind: Literal["3-2-1-1"] = "3-2-1-1"
    period_s: Positive = 4.5
    """Duration of a sequence."""
    count: Count = 3
    """Number of sequences."""
    start_s: NonNegative = 0.0
    """Start."""

    def build(self, amplitude_rad_s: float) -> Command:
        """Return the command over time."""
        return three_two_one_one(
            amplitude_rad_s=amplitude_rad_s, period_s=self.period_s, count=self.count, start_s=self.start_s
        )

    def conflicts(self, place: str, surroundings: Surroundings) -> list[str]:
        """Return the problem of pulses shorter than a tick."""
        return pulse_conflicts(f"{place}.period_s", self.period_s, pulses=7, control_hz=surroundings.control_hz)
