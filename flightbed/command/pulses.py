"""Pulses of one height, up and down in a pattern: what doublet, 3-2-1-1 and the binary sequence have in common."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from flightbed.command.base import ROUND_OFF_S, Command, Vector


def pulses(
    signs: npt.ArrayLike, *, amplitude_rad_s: float, period_s: float, count: float, start_s: float = 0.0
) -> Command:
    """Fly a pattern of signs ``count`` times from ``start_s`` on, then nothing.

    Args:
        signs: (n,) of +1 and -1, one for each n-th part of the period.
        amplitude_rad_s: height of the pulses.
        period_s: length of the whole pattern.

    """
    levels = amplitude_rad_s * np.asarray(signs, dtype=float)

    def command(t_s: Vector) -> Vector:
        cycles = (t_s - start_s + ROUND_OFF_S) / period_s
        active = (cycles >= 0.0) & (cycles < count)
        part = np.minimum((cycles % 1.0 * len(levels)).astype(int), len(levels) - 1)
        return np.where(active, levels[part], 0.0)

    return command
