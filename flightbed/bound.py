"""Trace + model -> the Cramer-Rao bound of K along the flown trajectory: what no unbiased estimator can beat.

For a K that is constant over a stretch of N samples the readings are z_k = H x_k(x_0, K) + v_k. With dynamics taken for certain, S_k =
d x_k / d (x_0, K) follows S+ = A S + [0, b u], S_0 = [I, 0], and the Fisher information is the sum of S' R^-1 S. The bound on the variance
of K is the last element of its inverse; nothing is known beforehand of x_0 or K (Van Trees, Detection, Estimation, and Modulation
Theory I, S 2.4). Disturbances and model errors only make things worse: it is a bound for clean air and a true model.

This module sees the truth: it judges flights, and nothing on board may use it.
"""

from __future__ import annotations

import numpy as np

from flightbed.compiling import Array, compiled
from flightbed.estimation.pitch_model import local_models
from flightbed.schedule import Schedule
from flightbed.sensors import SensorNoise
from flightbed.short_period import ShortPeriod
from flightbed.trace import Trace
from flightbed.units import DEG, FT


@compiled
def _bounds(models: Array, u: Array, first: Array, r: Array) -> Array:
    """Return the bound on the standard deviation of K at every tick, from the samples ``first[k]`` to k; inf where it is not told.

    Args:
        models: (T, 2, 4), [A | b | c] of the period that ends at each tick.
        u: (T,) deflection over that period.
        first: (T,) index of the first sample that counts.
        r: (2,) variances of the readings.

    """
    T = models.shape[0]
    out = np.full(T, np.inf)
    S, J = np.zeros((2, 3)), np.zeros((3, 3))
    for k in range(T):
        begin = int(first[k])
        if k > 0 and first[k] == first[k - 1]:  # the same stretch, one sample more
            begin = k
        else:
            S[:], J[:] = 0.0, 0.0
            S[0, 0], S[1, 1] = 1.0, 1.0
        for j in range(begin, k + 1):
            if j > int(first[k]):
                m = models[j]
                for a in range(
                    3
                ):  # S+ = A S + [0, b u], written out: a library's product costs more, and keeps all cores busy
                    top, low = S[0, a], S[1, a]
                    S[0, a] = m[0, 0] * top + m[0, 1] * low
                    S[1, a] = m[1, 0] * top + m[1, 1] * low
                S[0, 2] += m[0, 2] * u[j]
                S[1, 2] += m[1, 2] * u[j]
            for i in range(2):
                for a in range(3):
                    for b in range(3):
                        J[a, b] += S[i, a] * S[i, b] / r[i]
        # Schur complement: the information on K that is left when x_0 has to be found too.
        det = J[0, 0] * J[1, 1] - J[0, 1] * J[1, 0]
        if det > 0.0:
            spent = (
                J[2, 0] * (J[1, 1] * J[0, 2] - J[0, 1] * J[1, 2]) + J[2, 1] * (J[0, 0] * J[1, 2] - J[1, 0] * J[0, 2])
            ) / det
            left = J[2, 2] - spent
            if left > 1e-9 * J[2, 2] and left > 0.0:
                out[k] = 1.0 / np.sqrt(left)
    return out


def schedule_models(trace: Trace, schedule: Schedule, *, control_hz: int) -> Array:
    """Return (T, 2, 4), [A | b | c] of the period that ends at each tick, linearized along the true motion on the schedule."""
    K, u = trace["effectiveness_true"], trace["elevator_mean_meas_deg"] * DEG
    columns = ("alpha_deg", "q_deg_s", "mach", "altitude_ft", "theta_deg", "phi_deg")
    factors = (DEG, DEG, 1.0, FT, DEG, DEG)
    alpha, q, mach, altitude, theta, phi = (trace[c] * f for c, f in zip(columns, factors, strict=True))
    models = np.zeros((len(trace), 2, 4))
    local_models(schedule.packed(), models, K, 1.0 / control_hz, alpha, q, u, mach, altitude, theta, phi)
    return models


def design_models(trace: Trace, design: ShortPeriod, *, control_hz: int) -> Array:
    """Return (T, 2, 4), [A | b | c] of the period that ends at each tick: the short period, the same at all of them."""
    discrete = design.discrete(control_hz)
    affine = -discrete.b * design.elevator_trim_rad
    return np.tile(np.column_stack([discrete.A, discrete.b, affine]), (len(trace), 1, 1))


def bound(trace: Trace, models: Array, noise: SensorNoise, *, window: int | None = None) -> Array:
    """Return the bound on the standard deviation of K at every tick of a flight.

    The failure's time is taken for known, and a change of K begins a new stretch (in a ramp every tick does, and two samples say next to
    nothing).

    Args:
        trace: the flight.
        models: (T, 2, 4), the true motion linearized over the period that ends at each tick; without errors.
        noise: standard deviations of the sensors.
        window: only the last so many samples count; None for all since K last changed.

    """
    K, u, T = trace["effectiveness_true"], trace["elevator_mean_meas_deg"] * DEG, len(trace)
    # The share that acts from tick k on moves what is read at k + 1: the reading at the change still belongs to both stretches.
    changed = np.flatnonzero(np.diff(K) != 0.0) + 1
    since = np.zeros(T)
    for at in changed.tolist():
        since[at + 1 :] = at
    if window is not None:
        since = np.maximum(since, np.arange(T) - window)
    return _bounds(models, u, since, np.array([noise.alpha_rad**2, noise.q_rad_s**2]))
