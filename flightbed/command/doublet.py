"""Doublets: a pulse up, followed by an equal pulse down."""

from __future__ import annotations

from flightbed.command.base import Command
from flightbed.command.pulses import pulses
from flightbed.config import kinds
from flightbed.core.units import DEG


def doublet(*, amplitude_rad_s: float, period_s: float, count: int, start_s: float = 0.0) -> Command:
    """Fly ``count`` consecutive doublets of +-amplitude; zero before and after (Sillence S 3.1)."""
    return pulses((1, -1), amplitude_rad_s=amplitude_rad_s, period_s=period_s, count=count, start_s=start_s)


def build(settings: kinds.Command) -> Command:
    """Doublets of +-amplitude_deg_s, each period_s long, count of them from start_s on."""
    return doublet(
        amplitude_rad_s=settings.amplitude_deg_s * DEG,
        period_s=settings.period_s,
        count=settings.count,
        start_s=settings.start_s,
    )
