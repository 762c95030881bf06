"""The plants of the five examples, sampled with held inputs."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from flightbed.air import standard_air
from flightbed.estimation.input_model import InputModel
from flightbed.short_period import zero_order_hold
from flightbed.studies.gupta import printed
from flightbed.units import FT, G0

Array = npt.NDArray[np.float64]

_SLUG = 14.593902937206364  # kg

# Air-to-air missile: Mracek and Cloutier, AIAA 97-3767 (1997), tables 1 and 3: geometry, and the slopes at alpha = 0 of
# C_z = a_n alpha^3 + b_n alpha |alpha| + c_n (2 - M/3) alpha + d_n delta and
# C_m = a_m alpha^3 + b_m alpha |alpha| + c_m (-7 + 8 M/3) alpha + d_m delta; axial force coefficient 0.3.
_AREA_M2, _DIAMETER_M = 0.44 * FT**2, 0.75 * FT
_MISSILE_KG, _INERTIA_KG_M2 = 13.98 * _SLUG, 182.5 * _SLUG * FT**2
_C_N, _D_N, _C_M, _D_M, _C_A = -9.717, -1.948, 2.922, -11.803, 0.3
MACH, ALTITUDE_FT = 3.0, 20000.0  # chosen: the paper prints no condition


def oscillator(damping: float, stiffness: float, period_s: float) -> InputModel:
    """Return m q'' + c q' + k q = u, position measured, (41)-(48), (51), (57).

    (47) lost its exponentials: A = [[1, (m/c)(1 - e)], [0, e]], e = exp(-c T/m). Here both come from one matrix exponential.

    Args:
        damping: c, N s/m; 0 with no stiffness is the rigid body of example 1.
        stiffness: k, N/m.
        period_s: T_s.

    """
    m = printed.MASS_KG
    step = zero_order_hold(np.array([[0.0, 1.0], [-stiffness / m, -damping / m]]), np.array([0.0, 1.0 / m]), period_s)
    return InputModel(step.A, step.b[:, None], np.array([[1.0, 0.0]]))


def missile_loop() -> tuple[Array, Array, Array]:
    """Return (A_c, B_c, C_c) of the closed loop in continuous time, (69)-(73): x = (A_z g, q rad/s, fin rad), input r (g), output A_z.

    The paper's aerodynamic values are in its reference 8, which we have not; those of an air-to-air missile of the same first author as
    that reference stand in, at Mach 3 and 20,000 ft, with the paper's gains K_opt: the loop that they close is stable here too.
    The accelerometer is at the c.g. (x-bar = 0), and A_X0 of (67) the deceleration by axial force, without thrust.
    """
    air = standard_air(ALTITUDE_FT * FT)
    pressure, speed = 0.7 * air.pressure_pa * MACH**2, MACH * air.sound_m_s  # Q-bar = gamma/2 p M^2
    force, moment = pressure * _AREA_M2 / _MISSILE_KG, pressure * _AREA_M2 * _DIAMETER_M / _INERTIA_KG_M2
    z_alpha, m_alpha = force * _C_N * (2.0 - MACH / 3.0), moment * _C_M * (-7.0 + 8.0 * MACH / 3.0)
    z_fin, m_fin, axial = force * _D_N, moment * _D_M, -force * _C_A
    A1 = np.array(
        [[(z_alpha - axial) / speed, 1.0, z_fin / speed], [m_alpha, 0.0, m_fin], [0.0, 0.0, 0.0]]
    )  # (64), (67)
    C1 = np.array([[z_alpha / G0, 0.0, z_fin / G0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])  # (65), (68)
    B1, gains = np.array([0.0, 0.0, 1.0]), np.array(printed.K_OPT)
    A = C1 @ (A1 @ np.linalg.inv(C1) + np.outer(B1, gains))  # (69)
    output = C1[0] @ np.linalg.inv(C1)  # (71)
    drive = C1 @ B1 * gains[0]
    steady = 1.0 / (output @ np.linalg.solve(A, drive))  # (72)
    return A, -drive * steady, output


def missile(period_s: float) -> InputModel:
    """Return the missile under its autopilot, sampled."""
    A, B, C = missile_loop()
    step = zero_order_hold(A, B, period_s)
    return InputModel(step.A, step.b[:, None], C[None, :])


def response(model: InputModel, rad_per_sample: float) -> complex:
    """Return C (e^jw I - A)^-1 B of one input and one output."""
    turn = np.exp(1j * rad_per_sample)
    return complex((model.C @ np.linalg.solve(turn * np.eye(model.states) - model.A, model.B))[0, 0])


def damping_limit(period_s: float, damping: float = printed.DAMPING, believed: float = printed.BELIEVED_3) -> float:
    """Return what (54) gives once the faster of the oscillator's two modes is gone and y^ = y exactly, N s/m.

    The model that is believed gets held inputs, while the damping that is missing acts all the time. With y = rho^k, rho = exp(s T) the
    slower mode's, u^ = rho^k / G(rho), and the velocity that goes with it is that of the model; for T -> 0 it is c.
    """
    slow = float(np.max(np.roots([1.0, damping / printed.MASS_KG, printed.STIFFNESS / printed.MASS_KG]).real))
    model = oscillator(believed, printed.STIFFNESS, period_s)
    state = np.linalg.solve(np.exp(slow * period_s) * np.eye(2) - model.A, model.B[:, 0])
    return float(believed - 1.0 / state[1])
