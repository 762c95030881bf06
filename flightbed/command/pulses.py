"""Pulses of equal height in a pattern of signs: the common part of doublet, 3-2-1-1 and binary sequence."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from flightbed.command.base import ROUND_OFF_S, Command, Vector
from flightbed.config import kinds
from flightbed.core.units import DEG


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


def build(settings: kinds.Command) -> Command:
    """Hold amplitude_deg_s for period_s from start_s on: a rectangular build."""
    return pulses(
        [1],
        amplitude_rad_s=settings.amplitude_deg_s * DEG,
        period_s=settings.period_s,
        count=1,
        start_s=settings.start_s,
    )
