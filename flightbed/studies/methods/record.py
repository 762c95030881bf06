"""Theorem 1 over a whole record, for any linear system: the recursive reference form, and the equivalent batch form."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from flightbed.studies.methods import joint

Array = npt.NDArray[np.float64]


class Recursion(NamedTuple):
    """Joint estimates after each of N samples.

    Attributes:
        x: (N, n) states; effectiveness: (N,) K-hat.
        P: (N, n+1, n+1) covariances of (x, K).
        nis: (N,) normalized innovation squared, chi-square with m degrees of freedom.

    """

    x: Array
    effectiveness: Array
    P: Array
    nis: Array


def estimate_record(
    A: Array, b: Array, C: Array, *, Q: Array, R: Array, u: Array, z: Array, x0: Array, P0: Array
) -> Recursion:
    """Run the joint filter for x+ = A x + K b u + w, z = C x + v over a record (Sillence eqs (31)-(37)).

    Sillence eq (35) misprints u_k for u_k^2; this is Pachter's eq (35). A full R is first whitened by its Cholesky factor, so that only
    scalars are inverted.

    Args:
        A: (n, n); b: (n,); C: (m, n).
        Q: (n, n) covariance of the process noise (Gamma Q Gamma' of the papers); R: (m, m) of the measurement noise.
        u: (N,), u[k] acts from sample k to k+1; z: (N, m), z[k] measures x at k+1.
        x0: (n+1,) prior of (x, K) at 0; P0: (n+1, n+1) its covariance.

    """
    n, N = A.shape[0], len(u)
    whiten = np.linalg.inv(np.linalg.cholesky(R))
    H, r, Z = np.ascontiguousarray(whiten @ C), np.ones(len(R)), z @ whiten.T
    X, P, T = x0[:, None].copy(), P0[:, :, None].copy(), np.zeros((n + 2, n + 1, 1))
    model = np.column_stack([A, b, np.zeros(n)])
    out = Recursion(np.empty((N, n)), np.empty(N), np.empty((N, n + 1, n + 1)), np.empty(N))
    for k in range(N):
        joint.predict(X, P, T, model, float(u[k]), Q, 1.0)
        joint.correct(X, P, T, H, r, tuple(Z[k].tolist()))
        out.x[k], out.effectiveness[k], out.P[k], out.nis[k] = X[:n, 0], X[n, 0], P[:, :, 0], T[n + 1, 0, 0]
    return out


def batch_estimate(
    A: Array, b: Array, C: Array, *, Q: Array, R: Array, u: Array, z: Array, x0: Array, P0: Array
) -> tuple[Array, Array]:
    """Estimate (x_0, K) by one weighted regression over the record (Sillence S 4.4, eqs (72)-(81)).

    The rows of his V~ share past process noise, so their covariance is full; his eqs (76), (77) hold for Q = 0 only. Arguments as in
    ``estimate_record``.

    Returns:
        (n+1,) estimate of (x at 0, K), and its (n+1, n+1) covariance.

    """
    n, m, N = A.shape[0], C.shape[0], len(u)
    powers = [np.eye(n)]
    for _ in range(N):
        powers.append(A @ powers[-1])
    H = np.zeros((N * m, n + 1))
    G = np.zeros((N * m, N * n))  # of the process noise
    forced = np.zeros(n)
    for k in range(N):
        rows = slice(k * m, (k + 1) * m)
        forced = A @ forced + b * u[k]
        H[rows, :n], H[rows, n] = C @ powers[k + 1], C @ forced
        for i in range(k + 1):
            G[rows, i * n : (i + 1) * n] = C @ powers[k - i]
    noise = np.kron(np.eye(N), R) + G @ np.kron(np.eye(N), Q) @ G.T
    information = np.linalg.inv(P0) + H.T @ np.linalg.solve(noise, H)
    covariance = np.linalg.inv(information)
    theta = covariance @ (np.linalg.solve(P0, x0) + H.T @ np.linalg.solve(noise, z.ravel()))
    return theta, covariance
