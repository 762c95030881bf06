"""The covariance of PLID as U D U': it stays positive, whatever round-off does, and half the digits do (Kemp chapter 7).

Bierman's factors (Factorization Methods for Discrete Sequential Estimation, Academic Press, 1977): U unit upper triangular, D diagonal,
stored together with D on the diagonal. Thornton's weighted Gram-Schmidt for the prediction, Bierman's update for the correction. D holds
the pivots of P; eigenvalues, as Kemp S 7.1 has it, they are not.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from flightbed.compiling import compiled
from flightbed.estimation.plid import Array, Form, Stored


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
    """Advance state and factors by one sample: what ``plid.step`` does, without ever forming P.

    The block fade, Kemp eqs (7.18)-(7.20), wants D_2' = alpha D_2, S' = S / alpha and the factors of U_1 D_1 U_1' + S (D_2 - D_2 / alpha)
    S'. He inverts U_1, forms a product and factors it; here the columns of S join the Gram-Schmidt of the rows above, which gives the
    same factors with neither. r = 0, which he replaces by 1e-99, is taken as it is: a quotient 0 / 0 in the correction belongs to a
    direction that is known already and is left alone. So is one whose pivot falls below the smallest normal number: with r = 0 pivots go
    there in single precision, and what is divided by one that lost its digits is no number.

    Args:
        s: (N,) extended state, updated.
        UD: (N, N) factors, D on the diagonal, updated; below it nothing is read.
        gain: (N,) Kalman gain, written.
        settings: as in ``plid.step``.
        y_before, u_before: output and input of the sample before.
        y, u: output and, for feedthrough, input of this sample.
        first: no sample was before.

    Returns:
        innovation, its variance, squared norm of the parameters' gains.

    """
    real = s.dtype.type
    zero, one = real(0.0), real(1.0)
    N = s.shape[0]
    n = N // 3
    r, q, whole, block, gamma = settings[0], settings[1], settings[2], settings[3], settings[4]
    tiny = settings[5]
    yb, ub, yn, un = real(y_before), real(u_before), real(y), real(u)
    if not first:
        for i in range(n - 1, -1, -1):
            above = s[i - 1] if i > 0 else zero
            s[i] = above + yb * s[n + i] + ub * s[2 * n + i]
        # W = [F U, I, room for S], weights (whole D, Q', D_2 - D_2 / alpha)
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
            if j == n - 1 and block > one:  # the parameters are done: fade them, and let S in above
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
            if before > tiny:  # gain / before is at most the root of P_ii / before: f / before itself may overflow
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
