"""Control authority: the smallest elevator effectiveness that trims, and that holds an unstable short period within the stops."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flightbed.avionics.short_period import ShortPeriod
from flightbed.core.units import DEG


@dataclass(frozen=True)
class Authority:
    """Smallest effectiveness K of the elevator at a trim point.

    Attributes:
        trim: smallest K at which the trim deflection is within the stops.
        hold: smallest K at which the elevator can recover the unstable mode from a deviation ``alpha_rad``; None without an
            unstable mode. Above 1 the healthy aircraft cannot recover either.
        alpha_rad: deviation from the trim angle of attack for ``hold``, rad.

    """

    trim: float
    hold: float | None
    alpha_rad: float


def authority(
    design: ShortPeriod, stops: tuple[float, float], *, effectiveness: float = 1.0, alpha_rad: float = 1.0 * DEG
) -> Authority:
    """Compute the smallest effectiveness for trim and for hold from the design model of a trim point.

    Trim requires the effective deflection d = K delta_trim of the point, so K >= d / stop on its side.

    Hold: the unstable mode obeys xi' = lambda xi + K beta u with u between the stops, less the trim deflection d / K. Recovery from
    xi_0 requires K beta |u|max > lambda |xi_0| (the null-controllable set of an unstable mode under bounded input). xi_0 is the mode's
    value at a deviation ``alpha_rad`` with q = 0, nose up or down, whichever needs the larger K. The actuator is taken as instantaneous:
    the bound is necessary, not sufficient.

    Args:
        design: short period and trim at ``effectiveness``.
        stops: stops of the elevator, in the unit of the model's input.
        effectiveness: K at which ``design`` was computed.
        alpha_rad: deviation from the trim angle of attack to recover from, rad.

    """
    acting = effectiveness * design.elevator_trim_rad
    trim = acting / (stops[1] if acting > 0.0 else stops[0])
    values, right = np.linalg.eig(design.A)
    i = int(np.argmax(values.real))
    if values[i].real <= 0.0 or values[i].imag != 0.0:
        return Authority(trim, None, alpha_rad)
    left = np.linalg.inv(right)[i].real
    push = left @ design.b / effectiveness  # per unit of effective deflection
    needed = float(values[i].real * abs(left[0]) * alpha_rad / abs(push))
    # K times the stop must reach the effective deflection d + needed on one side and d - needed on the other.
    return Authority(trim, max((acting + needed) / stops[1], (acting - needed) / stops[0]), alpha_rad)
