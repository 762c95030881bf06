"""Roll and yaw tabulated over Mach number and angle of attack."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from flightbed.avionics.lateral import LateralTables
from flightbed.core.atmosphere import standard_air
from flightbed.core.units import DEG
from flightbed.models.tabulate import nodes
from flightbed.plant.base import Airframe, Controls, Motion

Matrix = npt.NDArray[np.float64]


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
