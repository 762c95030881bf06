"""The on-board schedule, compiled: the pitch motion, linearized and discretized at a measurement."""

from __future__ import annotations

from math import cos, sin

import numpy as np

from flightbed.core.atmosphere import air
from flightbed.core.compiled import Array, compiled
from flightbed.core.units import G0

# Indices into ``Schedule.packed()``: numbers of nodes, accelerations per N of thrust, wing span, start of the nodes. Named indices,
# because a record costs a fifth of the time of ``rates``.
MACHS, ALPHAS, ELEVATORS, ALTITUDES, FORCE_X, FORCE_Z, MOMENT, SPAN, NODES = range(9)


@compiled
def cell(nodes: Array, at: int, count: int, value: float) -> tuple[int, float]:
    """Return the interval of ``value`` among the nodes ``nodes[at : at + count]``, and its position in it, 0 to 1 between the nodes.

    Beyond the ends the nearest interval is used. Offset and count select the nodes, because a slice takes longer than the search.
    """
    low, high = 0, count - 1
    while high - low > 1:
        middle = (low + high) // 2
        if nodes[at + middle] <= value:
            low = middle
        else:
            high = middle
    return low, (value - nodes[at + low]) / (nodes[at + low + 1] - nodes[at + low])


@compiled
def rates(
    schedule: Array,
    out: Array,
    alpha: float,
    q: float,
    acting: float,
    mach: float,
    altitude_m: float,
    theta: float,
    phi: float,
) -> None:
    """Write alpha', q' and their derivatives into ``out``: (2, 4), [value | d/d alpha | d/d q | d/d deflection].

    Args:
        schedule: ``Schedule.packed()``.
        out: (2, 4).
        alpha, q: point of linearization, rad, rad/s.
        acting: the effective deflection, K times position, rad.
        mach, altitude_m, theta, phi: air data and attitude.

    """
    M, N, E, H = int(schedule[MACHS]), int(schedule[ALPHAS]), int(schedule[ELEVATORS]), int(schedule[ALTITUDES])
    force_x, force_z, moment = schedule[FORCE_X], schedule[FORCE_Z], schedule[MOMENT]
    machs = NODES
    alphas = machs + M
    elevators = alphas + N
    altitudes = elevators + E
    thrusts = altitudes + H
    table = thrusts + M * H
    width = 4 + 2 * E

    pressure, sound = air(altitude_m)
    speed = mach * sound
    qbar = 0.7 * pressure * mach * mach
    i, x = cell(schedule, machs, M, mach)
    j, y = cell(schedule, alphas, N, min(max(alpha, schedule[alphas]), schedule[alphas + N - 1]))
    e, z = cell(schedule, elevators, E, acting)
    h, t = cell(schedule, altitudes, H, altitude_m)
    dy = 1.0 / (schedule[alphas + j + 1] - schedule[alphas + j])
    dz = 1.0 / (schedule[elevators + e + 1] - schedule[elevators + e])
    here = thrusts + i * H + h
    thrust = (1.0 - x) * ((1.0 - t) * schedule[here] + t * schedule[here + 1]) + x * (
        (1.0 - t) * schedule[here + H] + t * schedule[here + H + 1]
    )
    low_low = table + (i * N + j) * width  # the corners of the cell of Mach number and alpha
    high_low, low_high, high_high = low_low + N * width, low_low + width, low_low + (N + 1) * width
    for row in range(2):
        c = 2 * row
        low = (1.0 - x) * schedule[low_low + c] + x * schedule[high_low + c]
        high = (1.0 - x) * schedule[low_high + c] + x * schedule[high_high + c]
        damp_low = (1.0 - x) * schedule[low_low + c + 1] + x * schedule[high_low + c + 1]
        damp_high = (1.0 - x) * schedule[low_high + c + 1] + x * schedule[high_high + c + 1]
        d = 4 + row * E + e
        left_low = (1.0 - x) * schedule[low_low + d] + x * schedule[high_low + d]
        left_high = (1.0 - x) * schedule[low_high + d] + x * schedule[high_high + d]
        right_low = (1.0 - x) * schedule[low_low + d + 1] + x * schedule[high_low + d + 1]
        right_high = (1.0 - x) * schedule[low_high + d + 1] + x * schedule[high_high + d + 1]
        scale = qbar / speed if row == 0 else qbar
        damping = scale / speed * ((1.0 - y) * damp_low + y * damp_high)
        surface_low = (1.0 - z) * left_low + z * right_low
        surface_high = (1.0 - z) * left_high + z * right_high
        out[row, 0] = scale * ((1.0 - y) * (low + surface_low) + y * (high + surface_high)) + damping * q
        out[row, 1] = (
            scale * dy * (high - low + surface_high - surface_low) + scale / speed * dy * (damp_high - damp_low) * q
        )
        out[row, 2] = damping
        out[row, 3] = scale * dz * ((1.0 - y) * (right_low - left_low) + y * (right_high - left_high))
    ca, sa, ct, st = cos(alpha), sin(alpha), cos(theta), sin(theta)
    level = ct * cos(phi)
    out[0, 0] += q + (G0 * (ca * level + sa * st) + thrust * (force_z * ca - force_x * sa)) / speed
    out[0, 1] += (G0 * (ca * st - sa * level) - thrust * (force_z * sa + force_x * ca)) / speed
    out[0, 2] += 1.0
    out[1, 0] += thrust * moment


@compiled
def local_model(
    schedule: Array, model: Array, work: Array, effectiveness: float, dt: float, alpha: float, q: float, elevator: float,
    mach: float, altitude_m: float, theta: float, phi: float, q_gust: float,
) -> float:  # fmt: skip
    """Write the model of one period into ``model``: (2, 4), [A | b | c] of x+ = A x + b K u + c, x = (alpha, q), u the deflection.

    Linearized at the measurement at the start of the period and at the deflection ``effectiveness`` times ``elevator``; discretized for
    held inputs by the series of the matrix exponential to third order (the remainder is below 1e-6 at 100 Hz). The surrounding air
    rotates at q_gust, and damping acts on the difference. ``work`` is scratch, (2, 4). Returns the damping, d q'/d q, 1/s.

    """
    rates(schedule, work, alpha, q, effectiveness * elevator, mach, altitude_m, theta, phi)
    a00, a01, a10, a11 = work[0, 1], work[0, 2], work[1, 1], work[1, 2]
    # S = I dt + A dt^2/2 + A^2 dt^3/6, so that e^(A dt) = I + A S.
    s2, s3 = dt * dt / 2.0, dt * dt * dt / 6.0
    s00 = dt + s2 * a00 + s3 * (a00 * a00 + a01 * a10)
    s01 = s2 * a01 + s3 * (a00 * a01 + a01 * a11)
    s10 = s2 * a10 + s3 * (a10 * a00 + a11 * a10)
    s11 = dt + s2 * a11 + s3 * (a10 * a01 + a11 * a11)
    work[0, 0] -= (work[0, 2] - 1.0) * q_gust
    work[1, 0] -= work[1, 2] * q_gust
    c0 = work[0, 0] - a00 * alpha - a01 * q - work[0, 3] * effectiveness * elevator
    c1 = work[1, 0] - a10 * alpha - a11 * q - work[1, 3] * effectiveness * elevator
    model[0, 0], model[0, 1] = 1.0 + a00 * s00 + a01 * s10, a00 * s01 + a01 * s11
    model[1, 0], model[1, 1] = a10 * s00 + a11 * s10, 1.0 + a10 * s01 + a11 * s11
    model[0, 2], model[1, 2] = s00 * work[0, 3] + s01 * work[1, 3], s10 * work[0, 3] + s11 * work[1, 3]
    model[0, 3], model[1, 3] = s00 * c0 + s01 * c1, s10 * c0 + s11 * c1
    return float(work[1, 2])


@compiled
def local_models(
    schedule: Array, models: Array, effectiveness: Array, dt: float, alpha: Array, q: Array, elevator: Array, mach: Array,
    altitude_m: Array, theta: Array, phi: Array,
) -> None:  # fmt: skip
    """Write the models of the periods that end at ticks 1, 2, ... into ``models``: (T, 2, 4), each as ``local_model``, in calm air.

    ``effectiveness``, alpha and so on are (T,), at the start of a period; the elevator's mean over a period is at the end of the period.
    """
    work = np.empty((2, 4))
    for k in range(1, models.shape[0]):
        i = k - 1
        local_model(
            schedule, models[k], work, effectiveness[i], dt, alpha[i], q[i], elevator[k], mach[i], altitude_m[i], theta[i], phi[i], 0.0
        )  # fmt: skip
