"""Doublets: a pulse up, followed by an equal pulse down."""

from __future__ import annotations

from flightbed.command.base import Command
from flightbed.command.pulses import pulses


def doublet(*, amplitude_rad_s: float, period_s: float, count: int, start_s: float = 0.0) -> Command:
    """Fly ``count`` consecutive doublets of +-amplitude; zero before and after (Sillence S 3.1)."""
    return pulses((1, -1), amplitude_rad_s=amplitude_rad_s, period_s=period_s, count=count, start_s=start_s)
