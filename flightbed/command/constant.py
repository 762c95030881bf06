"""A constant command, and the zero command."""

from __future__ import annotations

from typing import Literal

import numpy as np

from flightbed.command.base import Command, Vector
from flightbed.config.kinds import CommandSettings, ShapedCommand
from flightbed.config.table import NonNegative


def constant(*, amplitude_rad_s: float, start_s: float = 0.0) -> Command:
    """Hold one pitch rate from ``start_s`` on."""

    def command(t_s: Vector) -> Vector:
        return np.where(t_s >= start_s, amplitude_rad_s, 0.0)

    return command


def none() -> Command:
    """Command zero pitch rate: straight and level flight."""
    return constant(amplitude_rad_s=0.0)


class Constant(ShapedCommand):
    """A step: a constant value from start_s on."""

    kind: Literal["constant"] = "constant"
    start_s: NonNegative = 0.0
    """Start."""

    def build(self, amplitude_rad_s: float) -> Command:
        """Return the command over time."""
        return constant(amplitude_rad_s=amplitude_rad_s, start_s=self.start_s)


class Silent(CommandSettings):
    """No command: zero throughout, straight and level flight."""

    kind: Literal["none"] = "none"

    def build(self, amplitude_rad_s: float) -> Command:  # noqa: ARG002
        """Return the command over time."""
        return none()
