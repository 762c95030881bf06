"""Plants of the five examples, discretized for held inputs."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from flightbed.avionics.short_period import zero_order_hold
from flightbed.core.atmosphere import standard_air
from flightbed.core.units import FT, G0
from flightbed.estimation.reconstruction.input_model import InputModel
from flightbed.studies.gupta import printed

Array = npt.NDArray[np.float64]

_SLUG = 14.593902937206364  # kg

# Air-to-air missile: Mracek and Cloutier, AIAA 97-3767 (1997), tables 1 and 3: geometry, and the derivatives at alpha = 0 of
# C_z = a_n alpha^3 + b_n alpha |alpha| + c_n (2 - M/3) alpha + d_n delta and
# C_m = a_m alpha^3 + b_m alpha |alpha| + c_m (-7 + 8 M/3) alpha + d_m delta; axial force coefficient 0.3.
_AREA_M2, _DIAMETER_M = 0.44 * FT**2, 0.75 * FT
_MISSILE_KG, _INERTIA_KG_M2 = 13.98 * _SLUG, 182.5 * _SLUG * FT**2
_C_N, _D_N, _C_M, _D_M, _C_A = -9.717, -1.948, 2.922, -11.803, 0.3
MACH, ALTITUDE_FT = 3.0, 20000.0  # our choice; the paper prints no flight condition


def oscillator(damping: float, stiffness: float, period_s: float) -> InputModel:
    """Return the model of m q'' + c q' + k q = u with measured position, (41)-(48), (51), (57).

    (47) is printed without its exponentials: A = [[1, (m/c)(1 - e)], [0, e]], e = exp(-c T/m). Here A and B follow from one matrix
    exponential.

    Args:
        damping: c, N s/m; 0 without stiffness gives the rigid body of example 1.
        stiffness: k, N/m.
        period_s: T_s, s.

    """
    m = printed.MASS_KG
    step = zero_order_hold(np.array([[0.0, 1.0], [-stiffness / m, -damping / m]]), np.array([0.0, 1.0 / m]), period_s)
    return InputModel(step.A, step.b[:, None], np.array([[1.0, 0.0]]))


def missile_loop() -> tuple[Array, Array, Array]:
    """Return (A_c, B_c, C_c) of the closed loop in continuous time, (69)-(73): x = (A_z g, q rad/s, fin rad), input r (g), output A_z.

    Departure from the paper: its aerodynamic data are in its reference 8, which is not available to us. The data of an air-to-air missile
    by the same first author replace them, at Mach 3 and 20,000 ft, with the paper's gains K_opt; the closed loop is stable with them too.
    The accelerometer is at the c.g. (x-bar = 0); A_X0 of (67) is the deceleration by the axial force, without thrust.
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
    """Return the missile with its autopilot, discretized with the period, s."""
    A, B, C = missile_loop()
    step = zero_order_hold(A, B, period_s)
    return InputModel(step.A, step.b[:, None], C[None, :])


def response(model: InputModel, rad_per_sample: float) -> complex:
    """Return the frequency response C (e^jw I - A)^-1 B of a model with one input and one output; w in rad/sample."""
    turn = np.exp(1j * rad_per_sample)
    return complex((model.C @ np.linalg.solve(turn * np.eye(model.states) - model.A, model.B))[0, 0])


def damping_limit(
    period_s: float, damping: float = printed.DAMPING, model_damping: float = printed.MODEL_DAMPING_3
) -> float:
    """Return the limit of the damping estimate (54), N s/m, after the decay of the oscillator's faster mode, with y^ = y exactly.

    The estimator's model has held inputs, whereas the missing damping force acts continuously. With y = rho^k, rho = exp(s T) for the
    slower mode s, the input is u^ = rho^k / G(rho), and the velocity is that of the model; for T -> 0 the limit is c.

    Args:
        period_s: T_s, s.
        damping: true damping c, N s/m.
        model_damping: damping of the estimator's model, N s/m.

    """
    slow = float(np.max(np.roots([1.0, damping / printed.MASS_KG, printed.STIFFNESS / printed.MASS_KG]).real))
    model = oscillator(model_damping, printed.STIFFNESS, period_s)
    state = np.linalg.solve(np.exp(slow * period_s) * np.eye(2) - model.A, model.B[:, 0])
    return float(model_damping - 1.0 / state[1])
