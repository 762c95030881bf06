"""Doublets: a pulse up, followed by an equal pulse down."""

from __future__ import annotations

from typing import Literal

from flightbed.command.base import Command, Count
from flightbed.command.pulses import pulse_conflicts, pulses
from flightbed.config.kinds import ShapedCommand, Surroundings
from flightbed.config.table import NonNegative, Positive


def doublet(*, amplitude_rad_s: float, period_s: float, count: int, start_s: float = 0.0) -> Command:
    """Fly ``count`` consecutive doublets of +-amplitude; zero before and after (Sillence S 3.1)."""
    return pulses((1, -1), amplitude_rad_s=amplitude_rad_s, period_s=period_s, count=count, start_s=start_s)


class Doublet(ShapedCommand):
    """Doublets: a pulse up and an equal pulse down in each period_s, count times."""

    kind: Literal["doublet"] = "doublet"
    period_s: Positive = 4.5
    """Duration of a doublet."""
    count: Count = 3
    """Number of doublets."""
    start_s: NonNegative = 0.0
    """Start."""

    def build(self, amplitude_rad_s: float) -> Command:
        """Return the command over time."""
        return doublet(amplitude_rad_s=amplitude_rad_s, period_s=self.period_s, count=self.count, start_s=self.start_s)

    def conflicts(self, place: str, surroundings: Surroundings) -> list[str]:
        """Return the problem of pulses shorter than a tick."""
        return pulse_conflicts(f"{place}.period_s", self.period_s, pulses=2, control_hz=surroundings.control_hz)
