"""Roll and yaw: the design model LateralDirectional, from a LinearModel, and LateralTables over Mach number and alpha, from an Airframe."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Matrix = npt.NDArray[np.float64]

STATES = ("beta", "p", "r")
INPUTS = ("aileron", "rudder")


@dataclass(frozen=True, eq=False)
class LateralDirectional:
    """(beta', p', r') = A (beta, p, r) + B (aileron, rudder) + g phi e_1, about symmetric flight; SI, radians.

    Attributes:
        A: (3, 3); B: (3, 2).
        gravity: d beta'/d phi, 1/s; approximately g/V.
        alpha_trim_rad: angle of attack of the trim point.
        actuators_rad_s: bandwidths of the actuators of aileron and rudder.
        tables: the model over Mach number and alpha, used on board.

    """

    A: Matrix
    B: Matrix
    gravity: float
    alpha_trim_rad: float
    actuators_rad_s: tuple[float, float]
    tables: LateralTables

    def with_actuators(self, effectiveness: tuple[float, float] = (1.0, 1.0)) -> tuple[Matrix, Matrix]:
        """Return A (5, 5) and B (5, 2) of (beta, p, r, aileron, rudder); the inputs are the commands of surfaces with this K."""
        lag = np.diag(self.actuators_rad_s)
        A = np.block([[self.A, self.B * effectiveness], [np.zeros((2, 3)), -lag]])
        return A, np.vstack([np.zeros((3, 2)), lag])


@dataclass(frozen=True, eq=False)
class LateralTables:
    """Roll and yaw derivatives over Mach number and alpha at small sideslip, and the coupling of rotations. SI, radians.

    Attributes:
        mach: (M,) nodes; alpha_rad: (N,).
        coefficients: (M, N, 3, 5): rows beta', p', r'; columns beta, p, r, aileron, rudder. Per unit of dynamic pressure and
            independent of airspeed: the first row is multiplied by V, the columns of p and r by another V. Kinematic terms are excluded.
        bent: (M, N, 3, 2): change of the columns of aileron and rudder per rad of |beta|; their tables have a kink at 0.
        coupling: (3, 2): coefficients of p q and q r in p' and r' (rows 0, 1), and of p r and p^2 - r^2 in q' (row 2).

    """

    mach: Matrix
    alpha_rad: Matrix
    coefficients: Matrix
    sideslip_slopes: Matrix
    coupling: Matrix

    def packed(self) -> Matrix:
        """Return all tables as one array, in the layout of ``avionics.lateral_kernels``."""
        parts = (
            self.coupling.ravel(),
            self.mach,
            self.alpha_rad,
            np.concatenate([self.coefficients, self.sideslip_slopes], axis=3).ravel(),
        )
        return np.concatenate([[float(len(self.mach)), float(len(self.alpha_rad))], *parts])
