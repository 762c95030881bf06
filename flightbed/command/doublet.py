"""Doublets: a pulse up, then the same pulse down."""

from __future__ import annotations

import numpy as np

from flightbed.command.base import Command, Vector

_ROUND_OFF_S = 1e-9  # t = k / hz can fall short of a switching time by round-off


def doublet(*, amplitude_rad_s: float, period_s: float, count: int, start_s: float = 0.0) -> Command:
    """Fly ``count`` doublets of +-amplitude, one after the other, then nothing (Sillence S 3.1)."""

    def command(t_s: Vector) -> Vector:
        cycles = (t_s - start_s + _ROUND_OFF_S) / period_s
        active = (cycles >= 0.0) & (cycles < count)
        return np.where(active, np.where(cycles % 1.0 < 0.5, amplitude_rad_s, -amplitude_rad_s), 0.0)

    return command
