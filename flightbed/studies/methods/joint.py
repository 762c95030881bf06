"""The augmented filter of Theorem 1 for any number of states and measurements: prediction and correction, compiled or plain.

A bank holds W filters, along the last axis so that the innermost loops run over the filters. The filters of the aircraft, with two
measured states, use ``filter_bank.step``, which gives bit-identical results.
"""

from __future__ import annotations

from flightbed.core.compiled import Array, compiled


@compiled
def predict(X: Array, P: Array, T: Array, model: Array, u: float, Q: Array, inflation: float) -> None:
    """x- = A x + b u K + c;  P- = inflation F P F' + Q,  F = [[A, b u], [0, 1]], for every filter of a bank.

    Pachter eqs (8)-(11), Sillence eqs (39)-(45); the known affine term c and the fading memory, inflation = 1/lambda, are additions to
    the papers.

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
    """Bayes update by m measurements z = H x + v, one after the other, for every filter of a bank.

    For diagonal R this equals the joint update of Pachter eqs (12)-(14); each scalar step is his Corollary 6 (eqs (42)-(49)), which
    inverts scalars only (his Remark 3). The caller whitens a full R.

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
