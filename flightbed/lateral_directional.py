"""Roll and yaw: the design model LateralDirectional, from a LinearModel, and LateralTables over Mach number and alpha, from an Airframe."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from flightbed.core.atmosphere import standard_air
from flightbed.core.units import DEG
from flightbed.linearize import LinearModel
from flightbed.plant.base import Airframe, Controls, Motion
from flightbed.schedule import nodes

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
        """Return all tables as one array, in the layout of ``estimation.surfaces_model``."""
        parts = (
            self.coupling.ravel(),
            self.mach,
            self.alpha_rad,
            np.concatenate([self.coefficients, self.sideslip_slopes], axis=3).ravel(),
        )
        return np.concatenate([[float(len(self.mach)), float(len(self.alpha_rad))], *parts])


_ALPHAS_RAD = (-10.0 * DEG, 30.0 * DEG)
_FILL_RAD, _MACHS = (
    2.0 * DEG,
    0.3,
)  # largest distance of nodes in alpha; range of Mach numbers on either side of the condition
_STEPS = (0.2 * DEG, 0.02, 0.02, 0.5 * DEG, 0.5 * DEG)  # steps of beta, p, r, aileron, rudder
_SLIP = 3.0 * DEG  # sideslip of the second evaluation of the surfaces
_SPIN = 0.1  # rad/s, step of the rotation rates for the coupling


def tabulate(airframe: Airframe, *, throttle: float) -> LateralTables:
    """Tabulate roll and yaw of an airframe at its altitude, over alpha and around its Mach number; about 4000 evaluations, 0.1 s."""
    sound, pressure = airframe.airspeed_m_s / airframe.mach, standard_air(airframe.altitude_m).pressure_pa

    def rates(speed: float, alpha: float, x: Matrix, q: float = 0.0) -> Matrix:
        beta, p, r, aileron, rudder = x.tolist()
        motion = Motion(speed, alpha, alpha, q, airframe.altitude_m, beta, 0.0, p, r)
        found = airframe.respond(motion, Controls(0.0, throttle, aileron, rudder)).rates
        return np.array([found.beta, found.p, found.r, found.q])

    mach = nodes(airframe.breakpoints("mach"), (max(0.1, airframe.mach - _MACHS), airframe.mach + _MACHS), None)
    alphas = nodes(airframe.breakpoints("alpha"), _ALPHAS_RAD, _FILL_RAD)
    table, sideslip_slopes = np.empty((len(mach), len(alphas), 3, 5)), np.empty((len(mach), len(alphas), 3, 2))
    for i, M in enumerate(mach.tolist()):
        speed = M * sound
        for k, alpha in enumerate(alphas.tolist()):
            here = table[i, k]
            for j, step in enumerate(_STEPS):
                x = np.zeros(5)
                x[j] = step
                here[:, j] = (rates(speed, alpha, x) - rates(speed, alpha, -x))[:3] / (2.0 * step)
            for j in (3, 4):
                slipping, x = np.array([_SLIP, 0.0, 0.0, 0.0, 0.0]), np.zeros(5)
                x[j] = _STEPS[j]
                slope = (rates(speed, alpha, slipping + x) - rates(speed, alpha, slipping - x))[:3] / (2.0 * _STEPS[j])
                sideslip_slopes[i, k, :, j - 3] = (slope - here[:, j]) / _SLIP
            here[0, 1] -= np.sin(alpha)
            here[0, 2] += np.cos(alpha)
        table[i] /= 0.7 * pressure * M * M
        sideslip_slopes[i] /= 0.7 * pressure * M * M
        table[i, :, 0, :] *= speed
        sideslip_slopes[i, :, 0, :] *= speed
        table[i, :, :, 1:3] *= speed

    def spun(p: float, q: float, r: float) -> Matrix:
        return rates(airframe.airspeed_m_s, 0.0, np.array([0.0, p, r, 0.0, 0.0]), q)

    # Mixed differences: the terms linear in the rates cancel.
    s = _SPIN
    by_pq, by_qr = (
        (spun(*a) - spun(*b)) / (2.0 * s * s) for a, b in (((s, s, 0), (s, -s, 0)), ((0, s, s), (0, -s, s)))
    )
    even = 0.5 * (spun(s, 0, s) + spun(-s, 0, -s) - spun(s, 0, -s) - spun(-s, 0, s)) / (2.0 * s * s)
    square = 0.25 * (spun(s, 0, 0) + spun(-s, 0, 0) - spun(0, 0, s) - spun(0, 0, -s)) / (s * s)
    coupling = np.array([[by_pq[1], by_qr[1]], [by_pq[2], by_qr[2]], [even[3], square[3]]])
    return LateralTables(mach, alphas, table, sideslip_slopes, coupling)


def lateral_directional(
    model: LinearModel, airframe: Airframe, *, actuators_rad_s: tuple[float, float]
) -> LateralDirectional:
    """Return the design model, with its tables, of an overlay aircraft whose aileron and rudder are inputs in rad."""
    A, B = model.part(STATES, INPUTS)
    banked, _ = model.part(("beta", "phi"), ())
    tables = tabulate(airframe, throttle=model.trim.throttle_norm)
    return LateralDirectional(A, B, float(banked[0, 1]), model.trim.alpha_rad, actuators_rad_s, tables)
