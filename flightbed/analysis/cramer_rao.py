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
def _update_covariance(S: Array, m: Array, u: float, std: Array) -> None:
    """Propagate the square root S (3, 3) of the covariance S S' of (x, K) over a period and add the sample at its end (Potter)."""
    for j in range(3):
        alpha, q = S[0, j], S[1, j]
        S[0, j] = m[0, 0] * alpha + m[0, 1] * q + m[0, 2] * u * S[2, j]
        S[1, j] = m[1, 0] * alpha + m[1, 1] * q + m[1, 2] * u * S[2, j]
    for read in range(2):
        f0, f1, f2 = S[read, 0], S[read, 1], S[read, 2]
        var = f0 * f0 + f1 * f1 + f2 * f2 + std[read] ** 2
        share = 1.0 / (var + std[read] * np.sqrt(var))
        for i in range(3):
            gain = share * (S[i, 0] * f0 + S[i, 1] * f1 + S[i, 2] * f2)
            S[i, 0] -= gain * f0
            S[i, 1] -= gain * f1
            S[i, 2] -= gain * f2


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
    R, S, observable = np.zeros((3, 3)), np.zeros((3, 3)), False
    for k in range(T):
        begin = int(first[k])
        if k > 0 and first[k] == first[k - 1]:  # the same stretch with one additional sample
            begin = k
        else:
            R[:], observable = 0.0, False
        for j in range(begin, k + 1):
            if observable:
                _update_covariance(S, models[j], u[j], std)
                continue
            if j > int(first[k]):
                _propagate_information(R, models[j], u[j])
            _add_sample(R, std)
            observable = abs(R[2, 2]) > 1e-9 * np.sqrt(R[0, 2] ** 2 + R[1, 2] ** 2)
            if observable:
                _invert(R, S)
        if observable:
            out[k] = np.sqrt(S[2, 0] ** 2 + S[2, 1] ** 2 + S[2, 2] ** 2)
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
