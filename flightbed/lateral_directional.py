"""LinearModel -> LateralDirectional: the design model of roll and yaw."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from flightbed.linearize import LinearModel
from flightbed.short_period import zero_order_hold

Matrix = npt.NDArray[np.float64]

STATES = ("beta", "p", "r")
INPUTS = ("aileron", "rudder")


@dataclass(frozen=True, eq=False)
class LateralDirectional:
    """(beta', p', r') = A (beta, p, r) + B (aileron, rudder) + g phi e_1, about symmetric flight; SI, radians.

    Attributes:
        A: (3, 3); B: (3, 2).
        gravity: d beta'/d phi, 1/s: near g/V.
        alpha_trim_rad: angle of attack of the trim point.
        actuators_rad_s: bandwidths of the actuators of aileron and rudder.

    """

    A: Matrix
    B: Matrix
    gravity: float
    alpha_trim_rad: float
    actuators_rad_s: tuple[float, float]

    def with_actuators(self) -> tuple[Matrix, Matrix]:
        """Return A (5, 5) and B (5, 2) of (beta, p, r, aileron, rudder), the inputs commands."""
        lag = np.diag(self.actuators_rad_s)
        return np.block([[self.A, self.B], [np.zeros((2, 3)), -lag]]), np.vstack([np.zeros((3, 2)), lag])

    def discrete(self, hz: float) -> tuple[Matrix, Matrix, Matrix]:
        """Return A (3, 3), B (3, 2) and the column of phi (3,) over one period with all inputs held."""
        phi, gamma = zero_order_hold(self.A, np.column_stack([self.B, [self.gravity, 0.0, 0.0]]), 1.0 / hz)
        return phi, gamma[:, :2], gamma[:, 2]


def lateral_directional(model: LinearModel, *, actuators_rad_s: tuple[float, float]) -> LateralDirectional:
    """Return the design model of an overlay aircraft whose aileron and rudder are inputs in rad."""
    A, B = model.part(STATES, INPUTS)
    banked, _ = model.part(("beta", "phi"), ())
    return LateralDirectional(A, B, float(banked[0, 1]), model.trim.alpha_rad, actuators_rad_s)
