"""End conditions of a flight: departure and ground; one source for both flight computers."""

from __future__ import annotations

from math import isfinite
from types import MappingProxyType
from typing import Literal

from flightbed.core.compiled import compiled
from flightbed.core.units import DEG

Ended = Literal["time", "departed", "ground"]

# Deviation of alpha from trim, or sideslip beta where aileron and rudder are commanded, that counts as a departure.
DEPARTURE_RAD = 25.0 * DEG
FLIES, DEPARTED, GROUND = 0.0, 1.0, 2.0  # values of ``ending``
NAMES: MappingProxyType[float, Ended] = MappingProxyType({DEPARTED: "departed", GROUND: "ground"})


@compiled
def ending(alpha_from_trim_rad: float, q_rad_s: float, altitude_m: float, floor_m: float, beta_rad: float) -> float:
    """Return the end condition that holds at a true state: FLIES, DEPARTED or GROUND.

    Args:
        alpha_from_trim_rad, q_rad_s, altitude_m: true values.
        floor_m: altitude of the ground.
        beta_rad: true sideslip where aileron and rudder are commanded, otherwise 0.

    """
    if not abs(alpha_from_trim_rad) <= DEPARTURE_RAD or not isfinite(q_rad_s):
        return DEPARTED
    if altitude_m < floor_m:
        return GROUND
    return FLIES if abs(beta_rad) <= DEPARTURE_RAD else DEPARTED
