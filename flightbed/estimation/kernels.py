"""Array code of the estimators: written once, run compiled (numba, cached on disk) or plain (FLIGHTBED_PLAIN=1).

A bank holds W copies of the augmented filter of Theorem 1 side by side, the copies along the last axis so that the
innermost loops run over them. W = 1 is the ordinary recursive filter; W = N staggered copies are a moving window of N.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import ParamSpec, TypeVar, cast

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
P_ = ParamSpec("P_")
R_ = TypeVar("R_")

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
    X: Array,
    P: Array,
    T: Array,
    model: Array,
    u: float,
    Q: Array,
    inflation: float,
    H: Array,
    r: Array,
    z: tuple[float, ...],
    k: int,
    x0: Array,
    P0: Array,
    anchor: bool,
) -> tuple[float, float, float, float, float]:
    """Advance a bank by one sample, and return the estimate of the filter that has the most data.

    Tick 0 starts every filter. In a window (W > 1) filter k mod W has then seen exactly W samples: it gives the
    estimate and starts again; during the first W ticks filter 0 has the most data. With W = 1 nothing is restarted.

    Returns:
        (K-hat, its variance, x-hat 0, x-hat 1, normalized innovation squared); at tick 0 the prior, with 0 for the last.

    """
    n = H.shape[1]
    W = X.shape[1]
    if k == 0:
        for w in range(W):
            start(X, P, w, x0, P0, anchor, z, r)
        return X[n, 0], P[n, n, 0], X[0, 0], X[n - 1, 0], 0.0
    predict(X, P, T, model, u, Q, inflation)
    correct(X, P, T, H, r, z)
    slot = k % W
    best = slot if k >= W else 0
    result = (X[n, best], P[n, n, best], X[0, best], X[n - 1, best], T[n + 1, 0, best])
    if W > 1:
        start(X, P, slot, x0, P0, anchor, z, r)
    return result
