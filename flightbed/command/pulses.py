"""Pulses of equal height in a pattern of signs: the common part of doublet, 3-2-1-1 and binary sequence."""

from __future__ import annotations

from typing import Literal

import numpy as np
import numpy.typing as npt

from flightbed.command.base import ROUND_OFF_S, Command, Vector
from flightbed.config.kinds import ShapedCommand
from flightbed.config.table import NonNegative, Positive


def pulses(
    signs: npt.ArrayLike, *, amplitude_rad_s: float, period_s: float, count: float, start_s: float = 0.0
) -> Command:
    """Fly a pattern of signs ``count`` times from ``start_s`` on; zero before and after.

    Args:
        signs: (n,) of +1 and -1; each lasts period_s / n.
        amplitude_rad_s: height of the pulses.
        period_s: duration of the whole pattern.
        count: number of repetitions.
        start_s: start of the command.

    """
    levels = amplitude_rad_s * np.asarray(signs, dtype=float)

    def command(t_s: Vector) -> Vector:
        cycles = (t_s - start_s + ROUND_OFF_S) / period_s
        active = (cycles >= 0.0) & (cycles < count)
        part = np.minimum((cycles % 1.0 * len(levels)).astype(int), len(levels) - 1)
        return np.where(active, levels[part], 0.0)

    return command


def pulse_conflicts(key: str, value_s: float, *, pulses: int, control_hz: int) -> list[str]:
    """Return the problem of a duration of ``pulses`` pulses of which each is shorter than a tick, one line; ``key`` is its place."""
    if value_s * control_hz >= pulses - 1e-6:
        return []
    return [
        f"{key}: must be at least {pulses / control_hz:g}, so that each pulse lasts at least one tick (got {value_s:g})"
    ]


class Pulse(ShapedCommand):
    """One rectangular pulse of period_s."""

    kind: Literal["pulse"] = "pulse"
    period_s: Positive = 4.5
    """Duration of the pulse."""
    start_s: NonNegative = 0.0
    """Start."""

    def build(self, amplitude_rad_s: float) -> Command:
        """Return the command over time."""
        return pulses([1], amplitude_rad_s=amplitude_rad_s, period_s=self.period_s, count=1, start_s=self.start_s)
