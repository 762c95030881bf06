"""Array code of the estimators: written once, run compiled (numba, cached on disk) or plain (FLIGHTBED_PLAIN=1).

A bank holds W copies of the augmented filter of Theorem 1 side by side, the copies along the last axis so that the
innermost loops run over them. W = 1 is the ordinary recursive filter; W = N staggered copies are a moving window of N.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from math import sqrt
from typing import ParamSpec, TypeVar, cast

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Found = tuple[float, float, float, float, float, float, float, float, float, float, float, float]  # what a tick gives
P_ = ParamSpec("P_")
R_ = TypeVar("R_")

_IDENTITY = np.eye(2)  # compiled in as a constant
FIXED, ANCHORED, CORRECTED = 0.0, 1.0, 2.0  # how a filter starts
YOUNG = 15.0  # ticks after an alarm in which the time of the change is still looked for

PLAIN = os.environ.get("FLIGHTBED_PLAIN", "") not in ("", "0")


def compiled(function: Callable[P_, R_]) -> Callable[P_, R_]:
    """Compile at first call, unless FLIGHTBED_PLAIN is set; ``.py_func`` is the plain function either way."""
    if PLAIN:
        function.py_func = function  # type: ignore[attr-defined]
        return function
    from numba import njit

    return cast(Callable[P_, R_], njit(cache=True, error_model="numpy")(function))


@compiled
def predict(X: Array, P: Array, T: Array, model: Array, u: float, Q: Array, inflation: float) -> None:
    """x- = A x + b u K + c;  P- = inflation F P F' + Q,  F = [[A, b u], [0, 1]], for every filter of a bank.

    Pachter eqs (8)-(11), Sillence S eqs (39)-(45); c is the known affine term and inflation = 1/lambda the fading
    memory, neither of which is in the papers.

    Args:
        X: (n+1, W) states (x, K), updated in place.
        P: (n+1, n+1, W) covariances, updated in place.
        T: (n+2, n+1, W) scratch.
        model: (n, n+2), [A | b | c].
        u: the input over the period.
        Q: (n, n) covariance of Gamma w.
        inflation: at least 1.

    """
    n = model.shape[0]
    W = X.shape[1]
    for i in range(n):
        g = model[i, n] * u
        for w in range(W):
            T[i, 0, w] = model[i, n + 1] + g * X[n, w]
        for k in range(n):
            a = model[i, k]
            for w in range(W):
                T[i, 0, w] += a * X[k, w]
    for i in range(n):
        for w in range(W):
            X[i, w] = T[i, 0, w]
    # T = F P, then P = T F'; the last row of F is (0, 1).
    for i in range(n):
        g = model[i, n] * u
        for j in range(n + 1):
            for w in range(W):
                T[i, j, w] = g * P[n, j, w]
            for k in range(n):
                a = model[i, k]
                for w in range(W):
                    T[i, j, w] += a * P[k, j, w]
    for i in range(n):
        for j in range(i, n):
            g = model[j, n] * u
            for w in range(W):
                P[i, j, w] = g * T[i, n, w]
            for k in range(n):
                a = model[j, k]
                for w in range(W):
                    P[i, j, w] += T[i, k, w] * a
            for w in range(W):
                P[i, j, w] = inflation * P[i, j, w] + Q[i, j]
                P[j, i, w] = P[i, j, w]
        for w in range(W):
            P[i, n, w] = inflation * T[i, n, w]
            P[n, i, w] = P[i, n, w]
    for w in range(W):
        P[n, n, w] *= inflation


@compiled
def correct(X: Array, P: Array, T: Array, H: Array, r: Array, z: tuple[float, ...]) -> None:
    """Bayes update with m measurements z = H x + v, one at a time, for every filter of a bank.

    With R diagonal this equals the joint update of Pachter eqs (12)-(14), and each scalar step is his Corollary 6
    (eqs (42)-(49)): only scalars are inverted (his Remark 3). A full R is whitened by the caller.

    Args:
        X, P: as in predict, updated in place.
        T: scratch as in predict; on return T[n+1, 0] holds each filter's normalized innovation squared.
        H: (m, n) measurement matrix.
        r: (m,) variances.
        z: m readings.

    """
    n = H.shape[1]
    W = X.shape[1]
    for w in range(W):
        T[n + 1, 0, w] = 0.0
    for i in range(H.shape[0]):
        # T[:n+1, 0] = P h, T[0, 1] = innovation variance and then its inverse, T[n+1, 1] = innovation
        for j in range(n + 1):
            for w in range(W):
                T[j, 0, w] = 0.0
            for k in range(n):
                h = H[i, k]
                for w in range(W):
                    T[j, 0, w] += P[j, k, w] * h
        for w in range(W):
            T[0, 1, w] = r[i]
            T[n + 1, 1, w] = z[i]
        for k in range(n):
            h = H[i, k]
            for w in range(W):
                T[0, 1, w] += h * T[k, 0, w]
                T[n + 1, 1, w] -= h * X[k, w]
        for w in range(W):
            inverse = 1.0 / T[0, 1, w]
            T[n + 1, 0, w] += T[n + 1, 1, w] * T[n + 1, 1, w] * inverse
            T[0, 1, w] = inverse
        for j in range(n + 1):
            for w in range(W):
                X[j, w] += T[j, 0, w] * T[0, 1, w] * T[n + 1, 1, w]
            for k in range(j, n + 1):
                for w in range(W):
                    P[j, k, w] -= T[j, 0, w] * T[0, 1, w] * T[k, 0, w]
                    P[k, j, w] = P[j, k, w]


@compiled
def step(bank: Array, model: Array, u: float, Q: Array, inflation: float, r: Array, z0: float, z1: float) -> None:
    """Predict and correct every filter of a bank for two states that are both measured, in one pass over the filters.

    The same operations in the same order as ``predict`` and then ``correct`` with H = I, and so the same to the last bit; what is kept
    of a filter between them stays in registers. Nearly all of the time of a window's tick goes here.

    Args:
        bank: as ``new_bank``; X, P, normalized innovations squared (row 21), innovations and their variances are updated.
        model, u, Q, inflation, r: as in ``predict`` and ``correct``.
        z0, z1: the readings.

    """
    a00, a01, a10, a11 = model[0, 0], model[0, 1], model[1, 0], model[1, 1]
    g0, g1, c0, c1 = model[0, 2] * u, model[1, 2] * u, model[0, 3], model[1, 3]
    q00, q01, q11, r0, r1 = Q[0, 0], Q[0, 1], Q[1, 1], r[0], r[1]
    for w in range(bank.shape[1]):
        x0, x1, K = bank[0, w], bank[1, w], bank[2, w]
        p00, p01, p02, p11, p12, p22 = bank[3, w], bank[4, w], bank[5, w], bank[7, w], bank[8, w], bank[11, w]
        # x- = A x + b u K + c
        y0 = c0 + g0 * K + a00 * x0 + a01 * x1
        y1 = c1 + g1 * K + a10 * x0 + a11 * x1
        # T = F P, then P- = T F'
        t00, t01, t02 = g0 * p02 + a00 * p00 + a01 * p01, g0 * p12 + a00 * p01 + a01 * p11, g0 * p22 + a00 * p02 + a01 * p12
        t10, t11, t12 = g1 * p02 + a10 * p00 + a11 * p01, g1 * p12 + a10 * p01 + a11 * p11, g1 * p22 + a10 * p02 + a11 * p12
        m00 = inflation * (g0 * t02 + t00 * a00 + t01 * a01) + q00
        m01 = inflation * (g1 * t02 + t00 * a10 + t01 * a11) + q01
        m11 = inflation * (g1 * t12 + t10 * a10 + t11 * a11) + q11
        m02, m12, m22 = inflation * t02, inflation * t12, p22 * inflation
        bank[43, w], bank[44, w], bank[45, w], bank[46, w] = z0 - y0, z1 - y1, m00 + r0, m11 + r1
        # the first reading, then the second
        inverse, e = 1.0 / (r0 + m00), z0 - y0
        nis = e * e * inverse
        y0 += m00 * inverse * e
        y1 += m01 * inverse * e
        K += m02 * inverse * e
        n00, n01, n02 = m00 - m00 * inverse * m00, m01 - m00 * inverse * m01, m02 - m00 * inverse * m02
        n11, n12, n22 = m11 - m01 * inverse * m01, m12 - m01 * inverse * m02, m22 - m02 * inverse * m02
        inverse, e = 1.0 / (r1 + n11), z1 - y1
        bank[21, w] = nis + e * e * inverse
        bank[0, w] = y0 + n01 * inverse * e
        bank[1, w] = y1 + n11 * inverse * e
        bank[2, w] = K + n12 * inverse * e
        p00, p01, p02 = n00 - n01 * inverse * n01, n01 - n01 * inverse * n11, n02 - n01 * inverse * n12
        p11, p12, p22 = n11 - n11 * inverse * n11, n12 - n11 * inverse * n12, n22 - n12 * inverse * n12
        bank[3, w], bank[4, w], bank[5, w] = p00, p01, p02
        bank[6, w], bank[7, w], bank[8, w] = p01, p11, p12
        bank[9, w], bank[10, w], bank[11, w] = p02, p12, p22


@compiled
def start(X: Array, P: Array, slot: int, x0: Array, P0: Array, begin: float, z: tuple[float, ...], r: Array) -> None:
    """Start one filter of a bank from a prior; for a state other than fixed, H = I.

    Args:
        slot: which.
        x0: (n+1,) prior mean; P0: (n+1, n+1) prior covariance.
        begin: FIXED leaves the readings out; ANCHORED takes the state (not K) from them, with their variances, instead of from the
            prior; CORRECTED lets them correct the prior, as ``correct`` does.

    """
    n1 = X.shape[0]
    for i in range(n1):
        X[i, slot] = x0[i]
        for j in range(n1):
            P[i, j, slot] = P0[i, j]
    if begin == ANCHORED:
        for i in range(n1 - 1):
            X[i, slot] = z[i]
            for j in range(n1):
                P[i, j, slot] = 0.0
                P[j, i, slot] = 0.0
            P[i, i, slot] = r[i]
    elif begin == CORRECTED:
        correct(X[:, slot : slot + 1], P[:, :, slot : slot + 1], np.empty((n1 + 1, n1, 1)), np.eye(n1 - 1), r, z)


@compiled
def disturbance(bank: Array, settings: Array, model: Array, u: float, z: tuple[float, float], k: int, Q: Array) -> None:
    """Add to Q what the readings show of disturbances, so that sigma and alarms hold in rough air too.

    The residual of one step from reading to reading, e = z - (A z_last + b K u + c), sums up the disturbances; in a leaky sum over
    some 15 ticks the sensors' noise, which enters as differences, all but cancels, and gusts that last add up as they do in a
    window. Its mean square over the last seconds, less what the sensors explain, is the white noise that would do the same.

    """
    state = bank[24:, 0]
    leak, slow = 1.0 - 1.0 / 15.0, max(1.0 / 300.0, 1.0 / (k + 20.0))
    x0, x1 = state[12], state[13]
    for i in range(2):
        e = z[i] - (model[i, 0] * x0 + model[i, 1] * x1 + model[i, 2] * state[0] * u + model[i, 3])
        state[8 + i] = leak * state[8 + i] + e
        r = settings[21 + i]
        square = min(state[8 + i] * state[8 + i], 4.0 * (state[10 + i] + r))
        state[10 + i] += slow * (square - state[10 + i])
        Q[i, i] += max(0.0, (1.0 - leak * leak) * (state[10 + i] - 1.6 * r))


@compiled
def alarm(bank: Array, settings: Array, k: int) -> bool:
    """Test every filter of a window for a change of K against the level held so far; adopt the likeliest if it is one.

    Filter w has seen the data since its start alone. With I the information on K in them and k_w the K that they alone say,
    (k_w - level)^2 / (1/I + var level) is twice the log likelihood ratio for a change at its start, and the largest of them the
    generalized likelihood ratio over the time of the change (Willsky and Jones 1976), here from filters that run anyhow. Beyond the
    threshold the filter that has it gives the estimate until it has seen a full window; for a while a likelier start replaces it.

    """
    W = bank.shape[1]
    X, P, state = bank[0:3], bank[3:12].reshape((3, 3, -1)), bank[24:, 0]
    prior, prior_var, threshold, youngest = settings[6], settings[15], settings[31], settings[33]
    young = k - state[7] <= YOUNG
    level, level_var = (state[5], state[6]) if young else (state[1], state[2])
    highest, slot = 0.0, -1
    for w in range(W):
        age = (k - w) % W if k >= W else (k - w if w > 0 and k > w else k)
        if age == 0:
            age = W
        if age < youngest or (young and k - age < state[14]):
            continue
        information = 1.0 / P[2, 2, w] - 1.0 / prior_var
        if information <= 1e-9:
            continue
        said = (X[2, w] / P[2, 2, w] - prior / prior_var) / information
        ratio = (said - level) ** 2 / (1.0 / information + level_var)
        if ratio > highest:
            highest, slot = ratio, w
    raised = highest > threshold and not young
    if slot >= 0 and (raised or (young and highest > threshold)):
        age = (k - slot) % W if k >= W else (k - slot if slot > 0 and k > slot else k)
        if age == 0:
            age = W
        if raised:
            state[5], state[6], state[7] = state[1], state[2], float(k)
            state[14] = float(k - W)
            state[8], state[9] = 0.0, 0.0  # what they hold is the change of K, not the air
        state[3], state[4] = float(slot), float(k - age)
    return raised


@compiled
def tick(bank: Array, settings: Array, u: float, z0: float, z1: float, k: int) -> Found:
    """Advance a bank by one sample, both states measured, and return the estimate of the filter that has the most data.

    Tick 0 starts every filter. In a window (W > 1) filter k mod W has then seen exactly W samples: it gives the
    estimate and starts again; during the first W ticks filter 0 has the most data. With W = 1 nothing is restarted. After an
    alarm the filter that it adopted gives the estimate until it is as old.

    Few arguments, because each array costs the call from Python more than a filter's arithmetic does.

    Args:
        bank: the state, made by ``new_bank``.
        settings: as ``pack_settings`` lays them out; the model in it may be changed from tick to tick.
        u: input over the period that ends now.
        z0, z1: the readings of the two states.
        k: number of the tick.

    Returns:
        (K-hat in bounds, its standard deviation, smoothed K-hat, K-hat, state 0, state 1, normalized innovation squared, number of
        alarms so far, innovation of reading 0 and of 1, their standard deviations as the filter predicts them); at tick 0 the prior,
        with 0 for all of the innovation.

    """
    X, P, T = bank[0:3], bank[3:12].reshape((3, 3, -1)), bank[12:24].reshape((4, 3, -1))
    x0, P0 = settings[4:7], settings[7:16].reshape((3, 3))
    inflation, begin, keep, low, high = settings[16], settings[17], settings[18], settings[19], settings[20]
    r, model, z = settings[21:23], settings[23:31].reshape((2, 4)), (z0, z1)
    threshold, adaptive, hold = settings[31], settings[32] > 0.0, settings[34]
    state, innovations = bank[24:43, 0], bank[43:47]
    W = bank.shape[1]
    best = 0
    if k == 0:
        for w in range(W):
            start(X, P, w, x0, P0, begin, z, r)
        innovations[:] = 0.0
        T[3, 0, 0] = 0.0
        state[:] = 0.0
        state[0], state[1], state[2] = 1.0, x0[2], 0.0
        state[3], state[4], state[7] = -1.0, 0.0, -1e9
        state[10], state[11] = r[0], r[1]
    else:
        Q = settings[0:4].copy().reshape((2, 2))
        if adaptive:
            disturbance(bank, settings, model, u, z, k, Q)
        step(bank, model, u, Q, inflation, r, z0, z1)
        if k >= W:
            best = k % W
    state[12], state[13] = z0, z1
    raised = False
    if threshold > 0.0 and W > 1 and k > 0:
        raised = alarm(bank, settings, k)
        if state[3] >= 0.0:
            if k - state[4] < W:
                best = int(state[3])
            else:
                state[3] = -1.0
    gain, variance = X[2, best], P[2, 2, best]
    told = max(0.0, 1.0 / variance - 1.0 / P0[2, 2])  # information on K in the data alone, and times what they say
    said = gain / variance - x0[2] / P0[2, 2]
    if hold > 0.0:  # the last estimate, with this variance, in place of the prior of K
        variance = 1.0 / (told + 1.0 / hold)
        gain = variance * (said + state[0] / hold)
    bounded = min(max(gain, low), high)
    if threshold > 0.0:
        since = k - state[7]
        if raised:
            state[0], state[15] = bounded, state[15] + 1.0
        elif since <= YOUNG:
            share = max(1.0 - keep, 1.0 - since / YOUNG)
            state[0] += share * (bounded - state[0])
        elif hold > 0.0:
            # What is new in a window at a tick is a W-th of its information: the smoother follows that, and holds without it.
            share = min(1.0 - keep, state[18] / (state[18] + W / max(told, 1e-9)))
            state[0] += share * (said / max(told, 1e-9) - state[0])
            state[0] = min(max(state[0], low), high)
            state[18] = (1.0 - share) * state[18] + hold / 4000.0
        else:
            state[0] = keep * state[0] + (1.0 - keep) * bounded
        if since <= YOUNG:
            state[18] = variance
        if state[3] >= 0.0:
            state[1], state[2] = gain, variance
        else:
            state[1] += 0.02 * (gain - state[1])
            state[2] = max(0.1 * variance, 0.02 * 0.02)
    else:
        state[0] = keep * state[0] + (1.0 - keep) * bounded
    result = (
        bounded, sqrt(variance), state[0], gain, X[0, best], X[1, best], T[3, 0, best], state[15],
        innovations[0, best], innovations[1, best], sqrt(innovations[2, best]), sqrt(innovations[3, best]),
    )  # fmt: skip
    if W > 1 and k > 0:
        start(X, P, k % W, x0, P0, begin, z, r)
    return result


def new_bank(filters: int) -> Array:
    """Return room for the state of W filters of (alpha, q, K): X, P, scratch, and in column 0 of the last rows what they share.

    These are: 0 smoothed K-hat; level of K that alarms are raised against, 1 itself and 2 its variance; adopted filter, 3 which and
    4 the tick of its start; 5, 6 the level before the last alarm, 7 its tick, 14 the earliest start that may replace the adopted one;
    8, 9 leaky sums of residuals and 10, 11 their mean squares; 12, 13 last readings; 15 number of alarms; 16 leaky sum of the
    residuals of alpha from which the gust's pitch rate is told, 17 its mean square; 18 variance of the smoothed K-hat. The last four
    rows are each filter's innovations of the two readings and their variances.
    """
    return np.zeros((47, filters))


def pack_settings(
    *,
    Q: Array,
    x0: Array,
    P0: Array,
    inflation: float,
    begin: float,
    keep: float,
    bounds: tuple[float, float],
    r: Array,
    model: Array,
    threshold: float = 0.0,
    adaptive: bool = False,
    youngest: int = 3,
    hold_var: float = 0.0,
) -> Array:
    """Return the settings of ``tick`` as one array.

    Process noise, prior, memory, start, smoother, bounds, variances of the readings (2,), model (2, 4) = [A | b | c]; threshold of
    alarms (0: none), whether the process noise follows the disturbances, youngest filter that may raise an alarm, variance with which
    the last estimate is held (0: the prior is).
    """
    memory = [inflation, begin, keep, *bounds]
    return np.concatenate(
        [Q.ravel(), x0, P0.ravel(), memory, r, model.ravel(), [threshold, float(adaptive), youngest, hold_var]]
    )
