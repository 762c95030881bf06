"""Pitch dynamics and load factor at one dynamic pressure."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from flightbed.core.atmosphere import standard_air
from flightbed.core.signals import Measurement

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PitchPoint:
    """Short period and load factor at a trim point, in deviations: x' = A x + b u, a_n = c x + d u, x = (alpha, q). SI, radians, g.

    Attributes:
        dynamic_pressure_pa: dynamic pressure of the trim point.
        A: (2, 2).
        b: (2,), per rad of elevator.
        c: (2,), g per rad and per rad/s.
        d: g per rad of elevator.
        level: whether the trim is level flight; otherwise it is a push-over, whose gains must not be flown.

    """

    dynamic_pressure_pa: float
    A: Array
    b: Array
    c: Array
    d: float
    level: bool = True


def dynamic_pressure_pa(measurement: Measurement) -> float:
    """Return the dynamic pressure 0.7 p M^2 from air data, Pa."""
    return 0.7 * standard_air(measurement.altitude_m).pressure_pa * measurement.mach**2
