"""On-board model of all three axes, compiled: alpha, q, beta, p, r, linearized and discretized at a measurement."""

from __future__ import annotations

from math import cos, sin, tan

from flightbed.avionics.pitch_kernels import cell, rates
from flightbed.core.atmosphere import air
from flightbed.core.compiled import Array, compiled
from flightbed.core.units import G0

# Indices into ``LateralTables.packed()``: numbers of nodes, the coefficients of ``coupling``, start of the nodes.
MACHS, ALPHAS, ROLL_PQ, ROLL_QR, YAW_PQ, YAW_QR, PITCH_PR, PITCH_SQUARES, NODES = range(9)


@compiled
def lateral_rates(tables: Array, A: Array, B: Array, alpha: float, beta: float, mach: float, altitude_m: float) -> None:
    """Write roll and yaw into the lower right of A (5, 5) and the last columns of B (5, 3), about flight at this alpha and sideslip.

    Args:
        tables: ``LateralTables.packed()``.
        A, B: continuous-time matrices; states alpha, q, beta, p, r, and inputs elevator, aileron, rudder.
        alpha, beta, mach, altitude_m: point of linearization; only the columns of aileron and rudder depend on beta.

    """
    machs, alphas = int(tables[MACHS]), int(tables[ALPHAS])
    table = NODES + machs + alphas
    pressure, sound = air(altitude_m)
    speed, qbar = mach * sound, 0.7 * pressure * mach * mach
    low, high = tables[NODES + machs], tables[NODES + machs + alphas - 1]
    i, x = cell(tables, NODES, machs, mach)
    j, y = cell(tables, NODES + machs, alphas, min(max(alpha, low), high))
    here = table + 21 * (i * alphas + j)
    there = here + 21 * alphas
    for row in range(3):
        for column in range(7):
            at = 7 * row + column
            slow = (1.0 - y) * tables[here + at] + y * tables[here + at + 21]
            fast = (1.0 - y) * tables[there + at] + y * tables[there + at + 21]
            value = qbar * ((1.0 - x) * slow + x * fast)
            if row == 0:
                value /= speed
            if column == 1 or column == 2:
                value /= speed
            if column < 3:
                A[2 + row, 2 + column] = value
            elif column < 5:
                B[2 + row, column - 2] = value
            else:
                B[2 + row, column - 4] += value * abs(beta)
    A[2, 3] += sin(alpha)
    A[2, 4] -= cos(alpha)


@compiled
def local_model(
    schedule: Array, tables: Array, work: Array, effectiveness: float, dt: float, elevator: float,
    alpha: float, q: float, mach: float, altitude_m: float, theta: float, phi: float, beta: float, p: float, r: float,
) -> None:  # fmt: skip
    """Write the model of one period: x+ = A x + B K u + c, x = (alpha, q, beta, p, r), u deflections of elevator, aileron, rudder.

    Linearized at the measurement at the start of the period, the pitch axis also at the deflection ``effectiveness`` times ``elevator``.
    The coupling of the axes (kinematics, inertia, gravity at an angle of bank) is computed from the measurements and enters c. Discretized
    by the series of the matrix exponential to third order.

    Args:
        schedule: ``Schedule.packed()``; tables: ``LateralTables.packed()``.
        work: (10, 9): on return rows 0 to 4 are [A | B | c]; rows 5 to 9 are scratch.
        effectiveness: K of the elevator for the linearization.
        dt: the period, s.
        elevator: mean deflection over the period, rad.
        alpha, q, mach, altitude_m, theta, phi, beta, p, r: measured at the period's start.

    """
    G = work[5:10]
    A, B = G[:, 0:5], G[:, 5:8]
    G[:, :] = 0.0
    pitch = work[0:2, 0:4]
    rates(schedule, pitch, alpha, q, effectiveness * elevator, mach, altitude_m, theta, phi)
    for i in range(2):
        A[i, 0], A[i, 1], B[i, 0] = pitch[i, 1], pitch[i, 2], pitch[i, 3]
        G[i, 8] = pitch[i, 0] - pitch[i, 1] * alpha - pitch[i, 2] * q - pitch[i, 3] * effectiveness * elevator
    lateral_rates(tables, A, B, alpha, beta, mach, altitude_m)
    speed = mach * air(altitude_m)[1]
    G[0, 8] -= (p * cos(alpha) + r * sin(alpha)) * tan(beta)
    G[1, 8] += tables[PITCH_PR] * p * r + tables[PITCH_SQUARES] * (p * p - r * r)
    G[2, 8] += G0 / speed * cos(theta) * sin(phi)
    G[3, 8] += tables[ROLL_PQ] * p * q + tables[ROLL_QR] * q * r
    G[4, 8] += tables[YAW_PQ] * p * q + tables[YAW_QR] * q * r
    # S = I dt + A dt^2/2 + A^2 dt^3/6, so that e^(A dt) = I + S A; held inputs enter through S.
    s2, s3 = dt * dt / 2.0, dt * dt * dt / 6.0
    S = work[0:5, 0:5]
    for i in range(5):
        for j in range(5):
            square = 0.0
            for k in range(5):
                square += A[i, k] * A[k, j]
            S[i, j] = s2 * A[i, j] + s3 * square + (dt if i == j else 0.0)
    for i in range(5):
        held = (S[i, 0], S[i, 1], S[i, 2], S[i, 3], S[i, 4])
        for j in range(9):
            total = 1.0 if i == j else 0.0
            for k in range(5):
                total += held[k] * G[k, j]
            work[i, j] = total
