"""Cramer-Rao bound of K along the flown trajectory: the smallest variance of any unbiased estimator, from trace and model.

For a K that is constant over a stretch of N samples the readings are z_k = H x_k(x_0, K) + v_k. With exactly known dynamics, S_k =
d x_k / d (x_0, K) follows S+ = A S + [0, b u], S_0 = [I, 0], and the Fisher information is the sum of S' R^-1 S. The bound on the variance
of K is the last element of the inverse, without prior information on x_0 or K (Van Trees, Detection, Estimation, and Modulation
Theory I, S 2.4). Disturbances and model errors increase the variance: the bound holds for clean air and a true model.

Inverting the sum loses all digits within seconds, because the effect of x_0 grows with the aircraft's unstable mode. The module therefore
propagates the covariance of (present state, K), which gives the same bound on K: as a square root of the information until K is
observable, then as a square root of the covariance (Bierman, Factorization Methods for Discrete Sequential Estimation, 1977, ch. II and V).

This module uses the truth: it evaluates flights, and nothing on board may use it.
"""

from __future__ import annotations

import numpy as np

from flightbed.analysis.trace import Trace
from flightbed.avionics.pitch_kernels import local_models
from flightbed.avionics.schedule import Schedule
from flightbed.avionics.short_period import ShortPeriod
from flightbed.core.compiled import Array, compiled
from flightbed.core.signals import SensorNoise
from flightbed.core.units import DEG, FT


@compiled
def _add_sample(R: Array, std: Array) -> None:
    """Add a sample to the triangle R (3, 3) of the information R' R on (x, K): two rows, rotated in one after the other."""
    row = np.zeros(3)
    for read in range(2):
        row[:] = 0.0
        row[read] = 1.0 / std[read]
        for i in range(3):
            if row[i] != 0.0:
                length = np.hypot(R[i, i], row[i])
                c, s = R[i, i] / length, row[i] / length
                for j in range(i, 3):
                    R[i, j], row[j] = c * R[i, j] + s * row[j], c * row[j] - s * R[i, j]


@compiled
def _propagate_information(R: Array, m: Array, u: float) -> None:
    """Propagate the information to the next x: x' = A^-1 (x - b u K - c), and one rotation that restores the triangle."""
    det = m[0, 0] * m[1, 1] - m[0, 1] * m[1, 0]
    for i in range(2):
        alpha, q = R[i, 0], R[i, 1]
        R[i, 0], R[i, 1] = (alpha * m[1, 1] - q * m[1, 0]) / det, (q * m[0, 0] - alpha * m[0, 1]) / det
        R[i, 2] -= (R[i, 0] * m[0, 2] + R[i, 1] * m[1, 2]) * u
    length = np.hypot(R[0, 0], R[1, 0])
    c, s = R[0, 0] / length, R[1, 0] / length
    for j in range(3):
        R[0, j], R[1, j] = c * R[0, j] + s * R[1, j], c * R[1, j] - s * R[0, j]


@compiled
def _invert(R: Array, S: Array) -> None:
    """Set S (3, 3) to the inverse of the triangle R (3, 3)."""
    S[:] = 0.0
    for i in range(3):
        S[i, i] = 1.0 / R[i, i]
    S[0, 1] = -R[0, 1] * S[1, 1] / R[0, 0]
    S[1, 2] = -R[1, 2] * S[2, 2] / R[1, 1]
    S[0, 2] = -(R[0, 1] * S[1, 2] + R[0, 2] * S[2, 2]) / R[0, 0]


@compiled
def _put(square: Array, S: Array, at: int) -> None:
    """Set S[..., at] to a square root (3, 3); the assignment of an array to a slice would take seconds to compile."""
    for i in range(3):
        for j in range(3):
            S[i, j, at] = square[i, j]


@compiled
def _inform(R: Array, S: Array, models: Array, u: Array, std: Array, at: int, first: int) -> bool:
    """Add sample ``at`` to the information R; return whether K is observable, and then set S to the square root of the covariance."""
    if at > first:
        _propagate_information(R, models[at], u[at])
    _add_sample(R, std)
    observable = abs(R[2, 2]) > 1e-9 * np.sqrt(R[0, 2] ** 2 + R[1, 2] ** 2)
    if observable:
        _invert(R, S)
    return bool(observable)


@compiled
def _update_covariances(S: Array, begin: int, end: int, m: Array, u: float, std: Array) -> None:
    """Propagate square roots S (3, 3, n) of covariances S S' of (x, K) over a period and add the sample at its end (Potter).

    Those from ``begin`` to ``end - 1`` are updated; the processor overlaps their square roots and divisions.
    """
    m00, m01, m02u, m10, m11, m12u = m[0, 0], m[0, 1], m[0, 2] * u, m[1, 0], m[1, 1], m[1, 2] * u
    for i in range(begin, end):
        a0, a1, a2 = S[0, 0, i], S[0, 1, i], S[0, 2, i]
        q0, q1, q2 = S[1, 0, i], S[1, 1, i], S[1, 2, i]
        k0, k1, k2 = S[2, 0, i], S[2, 1, i], S[2, 2, i]
        a0, q0 = m00 * a0 + m01 * q0 + m02u * k0, m10 * a0 + m11 * q0 + m12u * k0
        a1, q1 = m00 * a1 + m01 * q1 + m02u * k1, m10 * a1 + m11 * q1 + m12u * k1
        a2, q2 = m00 * a2 + m01 * q2 + m02u * k2, m10 * a2 + m11 * q2 + m12u * k2
        f0, f1, f2 = a0, a1, a2
        var = f0 * f0 + f1 * f1 + f2 * f2 + std[0] ** 2
        share = 1.0 / (var + std[0] * np.sqrt(var))
        gain_a = share * (a0 * f0 + a1 * f1 + a2 * f2)
        gain_q = share * (q0 * f0 + q1 * f1 + q2 * f2)
        gain_k = share * (k0 * f0 + k1 * f1 + k2 * f2)
        a0, a1, a2 = a0 - gain_a * f0, a1 - gain_a * f1, a2 - gain_a * f2
        q0, q1, q2 = q0 - gain_q * f0, q1 - gain_q * f1, q2 - gain_q * f2
        k0, k1, k2 = k0 - gain_k * f0, k1 - gain_k * f1, k2 - gain_k * f2
        f0, f1, f2 = q0, q1, q2
        var = f0 * f0 + f1 * f1 + f2 * f2 + std[1] ** 2
        share = 1.0 / (var + std[1] * np.sqrt(var))
        gain_a = share * (a0 * f0 + a1 * f1 + a2 * f2)
        gain_q = share * (q0 * f0 + q1 * f1 + q2 * f2)
        gain_k = share * (k0 * f0 + k1 * f1 + k2 * f2)
        S[0, 0, i], S[0, 1, i], S[0, 2, i] = a0 - gain_a * f0, a1 - gain_a * f1, a2 - gain_a * f2
        S[1, 0, i], S[1, 1, i], S[1, 2, i] = q0 - gain_q * f0, q1 - gain_q * f1, q2 - gain_q * f2
        S[2, 0, i], S[2, 1, i], S[2, 2, i] = k0 - gain_k * f0, k1 - gain_k * f1, k2 - gain_k * f2


@compiled
def _windows(models: Array, u: Array, first: Array, std: Array, begin: int, end: int, out: Array) -> None:
    """Write the bounds of ticks ``begin`` to ``end - 1``, whose stretches all begin at other samples.

    All windows that contain a sample take it together.
    """
    n = end - begin
    S, since, R, own = np.zeros((3, 3, n)), np.zeros(n, dtype=np.int64), np.zeros((3, 3)), np.zeros((3, 3))
    rises = True
    for i in range(n):
        R[:], k, start = 0.0, begin + i, int(first[begin + i])
        since[i] = k + 1
        for j in range(start, k + 1):
            if _inform(R, own, models, u, std, j, start):
                since[i] = j
                _put(own, S, i)
                break
        rises = rises and (i == 0 or since[i] >= since[i - 1])
    if rises:
        ready = 0  # windows before this one have taken a sample before j
        for j in range(since[0], end):
            while ready < n and since[ready] < j:
                ready += 1
            _update_covariances(S, max(0, j - begin), ready, models[j], u[j], std)
    else:
        for i in range(n):
            for j in range(since[i] + 1, begin + i + 1):
                _update_covariances(S, i, i + 1, models[j], u[j], std)
    for i in range(n):
        if since[i] <= begin + i:
            out[begin + i] = np.sqrt(S[2, 0, i] ** 2 + S[2, 1, i] ** 2 + S[2, 2, i] ** 2)


@compiled
def _bounds(models: Array, u: Array, first: Array, std: Array) -> Array:
    """Return the bound on the standard deviation of K at every tick, from samples ``first[k]`` to k; inf where K is unobservable.

    Args:
        models: (T, 2, 4), [A | b | c] of the period that ends at each tick.
        u: (T,) deflection over that period, rad.
        first: (T,) index of the first sample used.
        std: (2,) standard deviations of the readings, rad and rad/s.

    """
    T = models.shape[0]
    out = np.full(T, np.inf)
    R, S, own, observable = np.zeros((3, 3)), np.zeros((3, 3, 1)), np.zeros((3, 3)), False
    k, only = T - T, S.shape[2] - 1  # 0 and 0; numba would compile functions of their own for literals
    while k < T:
        end = k
        while end < T and (end + 1 >= T or first[end + 1] != first[end]):  # stretches that no later tick continues
            end += 1
        if end > k:
            _windows(models, u, first, std, k, end, out)
            k = end
        else:
            R[:], observable = 0.0, False
            start = int(first[k])
            for j in range(start, T):
                if j > k and first[j] != first[k]:
                    break
                if observable:
                    _update_covariances(S, only, only + 1, models[j], u[j], std)
                else:
                    observable = _inform(R, own, models, u, std, j, start)
                    _put(own, S, only)
                if j >= k and observable:
                    out[j] = np.sqrt(S[2, 0, 0] ** 2 + S[2, 1, 0] ** 2 + S[2, 2, 0] ** 2)
            while end < T and first[end] == first[k]:
                end += 1
            k = end
    return out


def schedule_models(trace: Trace, schedule: Schedule, *, control_hz: int) -> Array:
    """Return (T, 2, 4), [A | b | c] of the period that ends at each tick: the schedule, linearized along the true motion."""
    K, u = trace["effectiveness_true"], trace["elevator_mean_meas_deg"] * DEG
    columns = ("alpha_deg", "q_deg_s", "mach", "altitude_ft", "theta_deg", "phi_deg")
    factors = (DEG, DEG, 1.0, FT, DEG, DEG)
    alpha, q, mach, altitude, theta, phi = (trace[c] * f for c, f in zip(columns, factors, strict=True))
    models = np.zeros((len(trace), 2, 4))
    local_models(schedule.packed(), models, K, 1.0 / control_hz, alpha, q, u, mach, altitude, theta, phi)
    return models


def design_models(trace: Trace, design: ShortPeriod, *, control_hz: int) -> Array:
    """Return (T, 2, 4), [A | b | c] of the period that ends at each tick: the short-period model, equal at all ticks."""
    discrete = design.discrete(control_hz)
    affine = -discrete.b * design.elevator_trim_rad
    return np.tile(np.column_stack([discrete.A, discrete.b, affine]), (len(trace), 1, 1))


def bound(trace: Trace, models: Array, noise: SensorNoise, *, window: int | None = None) -> Array:
    """Return the bound on the standard deviation of K at every tick of a flight, (T,); inf where K is unobservable.

    The time of the failure counts as known, and a change of K begins a new stretch (in a ramp at every tick, and two samples carry almost
    no information).

    Args:
        trace: the flight.
        models: (T, 2, 4), the true motion linearized over the period that ends at each tick, without model errors.
        noise: standard deviations of the sensors.
        window: number of last samples used; None for all since the last change of K.

    """
    K, u, T = trace["effectiveness_true"], trace["elevator_mean_meas_deg"] * DEG, len(trace)
    # K from tick k on affects the reading at k + 1: the reading at the change belongs to both stretches.
    changed = np.flatnonzero(np.diff(K) != 0.0) + 1
    since = np.zeros(T)
    for at in changed.tolist():
        since[at + 1 :] = at
    if window is not None:
        since = np.maximum(since, np.arange(T) - window)
    return _bounds(models, u, since, np.array([noise.alpha_rad, noise.q_rad_s]))
