"""A constant command, and the zero command."""

from __future__ import annotations

import numpy as np

from flightbed.command.base import Command, Vector


def constant(*, amplitude_rad_s: float, start_s: float = 0.0) -> Command:
    """Hold one pitch rate from ``start_s`` on."""

    def command(t_s: Vector) -> Vector:
        return np.where(t_s >= start_s, amplitude_rad_s, 0.0)

    return command


def none() -> Command:
    """Command zero pitch rate: straight and level flight."""
    return constant(amplitude_rad_s=0.0)
