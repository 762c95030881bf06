"""The covariance of PLID as U D U': it stays positive under round-off, and single precision suffices (Kemp chapter 7).

Bierman's factors (Factorization Methods for Discrete Sequential Estimation, Academic Press, 1977): U unit upper triangular, D diagonal,
stored together with D on the diagonal. The prediction is Thornton's weighted Gram-Schmidt, the correction Bierman's update. D holds the
pivots of P, not its eigenvalues as stated in Kemp S 7.1.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from flightbed.core.compiled import compiled
from flightbed.estimation.plid.identify import (
    BLOCK_FADE,
    PROCESS_VAR,
    PSEUDONOISE_VAR,
    READING_VAR,
    TINY,
    WHOLE_FADE,
    Array,
    Form,
    Stored,
)


@compiled
def step(
    s: Stored,
    UD: Stored,
    gain: Stored,
    settings: Stored,
    y_before: float,
    u_before: float,
    y: float,
    u: float,
    first: bool,
) -> tuple[Any, Any, Any]:
    """Advance state and factors by one sample: equivalent to ``identify.step`` without forming P.

    The block fade, Kemp eqs (7.18)-(7.20), requires D_2' = alpha D_2, S' = S / alpha and the factors of U_1 D_1 U_1' + S (D_2 -
    D_2 / alpha) S'. Kemp inverts U_1, forms a product and factors it; here the columns of S join the Gram-Schmidt step of the rows above,
    which gives the same factors without inverse or product. Kemp replaces r = 0 by 1e-99; here r = 0 is used directly. A quotient 0 / 0
    in the correction belongs to a direction that is already known, which is not changed. The same holds for a pivot below the smallest
    normal number: with r = 0 and single precision pivots fall this low, and a division by a denormal pivot gives inf or nan.

    Args:
        s: (N,) extended state, updated.
        UD: (N, N) factors, D on the diagonal, updated; elements below the diagonal are not read.
        gain: (N,) Kalman gain, written.
        settings: as in ``identify.step``.
        y_before, u_before: output and input of the previous sample.
        y, u: output and, for feedthrough, input of this sample.
        first: whether this is the first sample.

    Returns:
        innovation, its variance, squared norm of the parameters' gains.

    """
    real = s.dtype.type
    zero, one = real(0.0), real(1.0)
    N = s.shape[0]
    n = N // 3
    r, q, whole, block, gamma = (
        settings[READING_VAR],
        settings[PROCESS_VAR],
        settings[WHOLE_FADE],
        settings[BLOCK_FADE],
        settings[PSEUDONOISE_VAR],
    )
    tiny = settings[TINY]
    yb, ub, yn, un = real(y_before), real(u_before), real(y), real(u)
    if not first:
        for i in range(n - 1, -1, -1):
            above = s[i - 1] if i > 0 else zero
            s[i] = above + yb * s[n + i] + ub * s[2 * n + i]
        # W = [F U, I, space for S], weights (whole D, Q', D_2 - D_2 / alpha)
        noise = N if gamma > zero else n
        columns = N + noise
        W = np.zeros((N, columns + N - n), s.dtype)
        weights = np.zeros(columns + N - n, s.dtype)
        for k in range(N):
            weights[k] = whole * UD[k, k]
            for i in range(k):
                W[i, k] = UD[i, k]
            W[k, k] = one
            for i in range(n - 1, -1, -1):
                above = W[i - 1, k] if i > 0 else zero
                W[i, k] = above + yb * W[n + i, k] + ub * W[2 * n + i, k]
        for k in range(noise):
            weights[N + k] = q if k < n else gamma
            W[k, N + k] = one
        width = columns
        for j in range(N - 1, -1, -1):
            if j == n - 1 and block > one:  # the rows of the parameters are done: fade them and add S to the rows above
                for k in range(n, N):
                    pivot = UD[k, k]
                    weights[columns + k - n] = pivot - pivot / block
                    UD[k, k] = block * pivot
                    for i in range(n):
                        W[i, columns + k - n] = UD[i, k]
                        UD[i, k] /= block
                width = columns + N - n
            pivot = zero
            for k in range(width):
                gain_k = weights[k] * W[j, k]
                pivot += gain_k * W[j, k]
            if pivot < tiny:
                pivot = zero
            UD[j, j] = pivot
            for i in range(j):
                shared = zero
                if pivot > zero:
                    for k in range(width):
                        shared += W[i, k] * weights[k] * W[j, k]
                    shared /= pivot
                    for k in range(width):
                        W[i, k] -= shared * W[j, k]
                UD[i, j] = shared
    feed = N % 3 == 1
    innovation = yn - s[n - 1]
    if feed:
        innovation -= un * s[N - 1]
    alpha = r
    for j in range(N):
        f = zero  # of U' h
        if j == n - 1:
            f = one
        elif j > n - 1:
            f = UD[n - 1, j]
        if feed and j == N - 1:
            f += un
        v = UD[j, j] * f
        before = alpha
        alpha += v * f
        if alpha > tiny:
            UD[j, j] *= before / alpha
        for i in range(j):
            old = UD[i, j]
            if before > tiny:  # gain / before is at most sqrt(P_ii / before); f / before itself can overflow
                UD[i, j] = old - gain[i] / before * f
            gain[i] += v * old
        gain[j] = v
    norm = zero
    for i in range(N):
        gain[i] = gain[i] / alpha if alpha > tiny else zero
        s[i] += gain[i] * innovation
        if i >= n:
            norm += gain[i] * gain[i]
    return innovation, alpha, norm


def covariance(UD: Array) -> Array:
    """Return P = U D U' of stored factors."""
    U = np.triu(UD, 1) + np.eye(len(UD))
    P: Array = (U * np.diag(UD)) @ U.T
    return P


FACTORED = Form(step, np.diag, covariance)
