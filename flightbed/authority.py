"""How much elevator effectiveness is enough: to trim, and to hold an unstable short period within the stops."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flightbed.short_period import ShortPeriod
from flightbed.units import DEG


@dataclass(frozen=True)
class Authority:
    """Smallest effectiveness K of the elevator at a trim point.

    Attributes:
        trim: smallest K at which the trim deflection is within the stops.
        hold: smallest K at which the unstable mode can be brought back from ``alpha_rad`` off trim; None if there is no
            unstable mode. May be above 1: then the healthy aircraft cannot do it either.
        alpha_rad: the deviation that ``hold`` is about.

    """

    trim: float
    hold: float | None
    alpha_rad: float


def authority(
    design: ShortPeriod, stops: tuple[float, float], *, effectiveness: float = 1.0, alpha_rad: float = 1.0 * DEG
) -> Authority:
    """Compute both for the design model of a trim point.

    Trim needs the effective deflection d = K delta_trim of the point, so K >= d / stop on its side.

    Hold: the unstable mode obeys xi' = lambda xi + K beta u with u between the stops, less the trim deflection d / K. It can be
    brought back from xi_0 only while the elevator's largest push exceeds the mode's pull, K beta |u|max > lambda |xi_0|
    (the null-controllable set of an unstable mode under bounded input). xi_0 is that of ``alpha_rad`` at rest, nose up or down, whichever
    is worse. The actuator is taken as instantaneous: the bound is necessary, not sufficient.

    Args:
        design: short period and trim, at the effectiveness they were taken at.
        stops: of the elevator, in the unit of the model's input.
        effectiveness: that effectiveness.
        alpha_rad: deviation to recover from.

    """
    acting = effectiveness * design.elevator_trim_rad
    trim = acting / (stops[1] if acting > 0.0 else stops[0])
    values, right = np.linalg.eig(design.A)
    i = int(np.argmax(values.real))
    if values[i].real <= 0.0 or values[i].imag != 0.0:
        return Authority(trim, None, alpha_rad)
    left = np.linalg.inv(right)[i].real
    push = left @ design.b / effectiveness  # of a unit of effective deflection
    needed = float(values[i].real * abs(left[0]) * alpha_rad / abs(push))
    # Effective deflection d + needed one way, d - needed the other: K times the stop must reach either.
    return Authority(trim, max((acting + needed) / stops[1], (acting - needed) / stops[0]), alpha_rad)
