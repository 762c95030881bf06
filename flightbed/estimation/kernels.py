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
P_ = ParamSpec("P_")
R_ = TypeVar("R_")

_IDENTITY = np.eye(2)  # compiled in as a constant

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
def start(X: Array, P: Array, slot: int, x0: Array, P0: Array, anchor: bool, z: tuple[float, ...], r: Array) -> None:
    """Start one filter of a bank from a prior.

    Args:
        slot: which.
        x0: (n+1,) prior mean; P0: (n+1, n+1) prior covariance.
        anchor: take the state (not K) from the readings instead, with their variances; needs H = I.

    """
    n1 = X.shape[0]
    for i in range(n1):
        X[i, slot] = x0[i]
        for j in range(n1):
            P[i, j, slot] = P0[i, j]
    if anchor:
        for i in range(n1 - 1):
            X[i, slot] = z[i]
            for j in range(n1):
                P[i, j, slot] = 0.0
                P[j, i, slot] = 0.0
            P[i, i, slot] = r[i]


@compiled
def tick(
    bank: Array, settings: Array, u: float, z0: float, z1: float, k: int
) -> tuple[float, float, float, float, float, float, float]:
    """Advance a bank by one sample, both states measured, and return the estimate of the filter that has the most data.

    Tick 0 starts every filter. In a window (W > 1) filter k mod W has then seen exactly W samples: it gives the
    estimate and starts again; during the first W ticks filter 0 has the most data. With W = 1 nothing is restarted.

    Few arguments, because each array costs the call from Python more than a filter's arithmetic does.

    Args:
        bank: the state, made by ``new_bank``; its last row holds the smoothed K-hat in column 0.
        settings: as ``pack_settings`` lays them out; the model in it may be changed from tick to tick.
        u: input over the period that ends now.
        z0, z1: the readings of the two states.
        k: number of the tick.

    Returns:
        (K-hat in bounds, its standard deviation, smoothed K-hat, K-hat, state 0, state 1, normalized innovation squared);
        at tick 0 the prior, with 0 for the last.

    """
    X, P, T = bank[0:3], bank[3:12].reshape((3, 3, -1)), bank[12:24].reshape((4, 3, -1))
    Q, x0, P0 = settings[0:4].reshape((2, 2)), settings[4:7], settings[7:16].reshape((3, 3))
    inflation, anchor, keep, low, high = settings[16], settings[17] > 0.0, settings[18], settings[19], settings[20]
    r, model, z = settings[21:23], settings[23:31].reshape((2, 4)), (z0, z1)
    W = bank.shape[1]
    best = 0
    if k == 0:
        for w in range(W):
            start(X, P, w, x0, P0, anchor, z, r)
        T[3, 0, 0] = 0.0
        bank[24, 0] = 1.0
    else:
        predict(X, P, T, model, u, Q, inflation)
        correct(X, P, T, _IDENTITY, r, z)
        if k >= W:
            best = k % W
    gain = X[2, best]
    bounded = min(max(gain, low), high)
    smoothed = keep * bank[24, 0] + (1.0 - keep) * bounded
    bank[24, 0] = smoothed
    result = (bounded, sqrt(P[2, 2, best]), smoothed, gain, X[0, best], X[1, best], T[3, 0, best])
    if W > 1 and k > 0:
        start(X, P, k % W, x0, P0, anchor, z, r)
    return result


def new_bank(filters: int) -> Array:
    """Return room for the state of W filters of (alpha, q, K): X, P, scratch, and a row for the smoother."""
    return np.zeros((25, filters))


def pack_settings(
    *,
    Q: Array,
    x0: Array,
    P0: Array,
    inflation: float,
    anchor: bool,
    keep: float,
    bounds: tuple[float, float],
    r: Array,
    model: Array,
) -> Array:
    """Return the settings of ``tick`` as one array.

    Process noise, prior, memory, start, smoother, bounds, variances of the readings (2,), and model (2, 4) = [A | b | c].
    """
    return np.concatenate([Q.ravel(), x0, P0.ravel(), [inflation, float(anchor), keep, *bounds], r, model.ravel()])
