"""A constant command, and the zero command."""

from __future__ import annotations

import numpy as np

from flightbed.command.base import Command, Vector
from flightbed.config import kinds
from flightbed.core.units import DEG


def constant(*, amplitude_rad_s: float, start_s: float = 0.0) -> Command:
    """Hold one pitch rate from ``start_s`` on."""

    def command(t_s: Vector) -> Vector:
        return np.where(t_s >= start_s, amplitude_rad_s, 0.0)

    return command


def none() -> Command:
    """Command zero pitch rate: straight and level flight."""
    return constant(amplitude_rad_s=0.0)


def build(settings: kinds.Command) -> Command:
    """Hold amplitude_deg_s from start_s on: a step."""
    return constant(amplitude_rad_s=settings.amplitude_deg_s * DEG, start_s=settings.start_s)


def build_none(_settings: kinds.Command) -> Command:
    """Command zero pitch rate: straight and level flight."""
    return none()
