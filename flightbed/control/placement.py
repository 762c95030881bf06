"""Pole placement with one input, by orthogonal transformations only.

Ackermann's formula k = e_n' [b, Ab, ... A^(n-1) b]^-1 p(A) gives the same, unique gains, but it forms powers of A and solves with the
controllability matrix, whose columns become nearly parallel as n grows: its condition number amplifies errors even where the problem
is well posed. Here A and b are reduced to controller-Hessenberg form, b = (beta, 0, ...), in which the controllability matrix is
triangular and need not be formed, and the poles are deflated one after the other by an RQ step (Miminis and Paige,
Int. J. Control 35 (1982) 341 and Automatica 24 (1988) 343; backward stable: Arnold and Datta, SIAM J. Matrix Anal. Appl. 19 (1998) 447).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

Matrix = npt.NDArray[np.float64]
Poles = npt.NDArray[np.complex128]

UNCONTROLLABLE = 1e-12  # values of ``assign`` below this are round-off


def assign(A: Matrix, b: Matrix, poles: Poles, k: Matrix) -> float:
    """Compute the gains for which the eigenvalues of A - b k are the poles; numba can compile this function.

    After the first m poles are placed, the remaining pair (H, beta e_1) is again Hessenberg. For a pole p, R Q = H - p I: the first
    column x of Q* satisfies (H - p I) x = r_11 e_1, so it is an eigenvector of the closed loop if beta k x = r_11. In the basis of Q it
    is the first unit vector, and the deflated pair, H <- Q H Q*, beta <- beta q_21, is Hessenberg.

    Args:
        A: (n, n).
        b: (n,).
        poles: (n,) complex poles with their conjugates.
        k: (n,) gains, written; meaningless if the pair is uncontrollable.

    Returns:
        the smallest of beta and the subdiagonals of the Hessenberg form, relative to the norm of [A b]: 0 if the pair is
        uncontrollable, otherwise an upper bound of the distance to the nearest uncontrollable pair.

    """
    n = b.shape[0]
    H, T = A.astype(np.complex128), np.eye(n).astype(np.complex128)
    column = b.astype(np.complex128)
    size = np.sqrt(np.sum(A * A) + np.sum(b * b))
    least = np.inf
    beta = 0.0 + 0.0j
    for step in range(n):  # Householder reflections of b, then of the columns of H: zero all elements below the first
        length = np.sqrt(np.sum(np.abs(column[step:]) ** 2))
        least = min(least, length)
        if not (size < np.inf and length > 1e-100 * size):  # also true for nan
            return 0.0
        v = np.zeros(n, dtype=np.complex128)
        v[step:] = column[step:]
        v[step] += length if column[step].real >= 0.0 else -length
        target = -length if column[step].real >= 0.0 else length
        square = np.sum(np.abs(v) ** 2)
        for j in range(n):
            share = 2.0 * np.sum(v * H[:, j]) / square
            H[:, j] -= share * v
            share = 2.0 * np.sum(v * T[:, j]) / square
            T[:, j] -= share * v
        for i in range(n):
            share = 2.0 * np.sum(H[i] * v) / square
            H[i] -= share * v
        if step == 0:
            beta += target
        if step < n - 1:
            column = H[:, step].copy()
            column[: step + 1] = 0.0
    for i in range(n):
        for j in range(i - 1):
            H[i, j] = 0.0
    found = np.zeros(n, dtype=np.complex128)  # gains in the basis of T; the first m are final
    for m in range(n):
        pole = poles[m]
        for i in range(m, n):
            H[i, i] -= pole
        # H = R Q by rotations of neighbouring columns from the last row up; the same rotations on the rows then give Q R + p I.
        cosines, sines = np.zeros(n), np.zeros(n, dtype=np.complex128)
        for j in range(n - 1, m, -1):
            below, left = H[j, j], H[j, j - 1]
            length = np.sqrt(np.abs(below) ** 2 + np.abs(left) ** 2)
            phase = below / np.abs(below) if np.abs(below) > 0.0 else 1.0 + 0.0j
            c, s = np.abs(below) / length, phase * np.conj(left) / length
            cosines[j], sines[j] = c, s
            for i in range(m, j + 1):
                first, second = H[i, j - 1], H[i, j]
                H[i, j - 1] = c * first - np.conj(s) * second
                H[i, j] = s * first + c * second
        corner = H[m, m]
        for j in range(n - 1, m, -1):
            c, s = cosines[j], sines[j]
            for i in range(m, n):
                first, second = H[j - 1, i], H[j, i]
                H[j - 1, i] = c * first - s * second
                H[j, i] = np.conj(s) * first + c * second
            for i in range(n):
                first, second = T[j - 1, i], T[j, i]
                T[j - 1, i] = c * first - s * second
                T[j, i] = np.conj(s) * first + c * second
        for i in range(m, n):
            H[i, i] += pole
        found[m] = corner / beta
        if m < n - 1:  # in the new basis b = beta e_1 is beta (q_11, q_21, 0, ...); component m affects no later pole
            beta *= np.conj(sines[m + 1])
    # k x = found in the basis of T
    for i in range(n):
        total = 0.0 + 0.0j
        for j in range(n):
            total += found[j] * T[j, i]
        k[i] = total.real
    return float(least / size)


def gains(A: Matrix, b: Matrix, poles: Sequence[complex]) -> Matrix:
    """Return the gains k, (n,), for which the eigenvalues of A - b k are the poles.

    Args:
        A: (n, n).
        b: (n,).
        poles: n poles, complex ones with their conjugates.

    Raises:
        ValueError: the number of poles is not n, complex poles are not in conjugate pairs, or the pair (A, b) is uncontrollable.

    """
    if len(poles) != len(b):
        raise ValueError(f"the loop has {len(b)} states, {len(poles)} poles are given")
    wanted = np.array(poles, dtype=np.complex128)
    if not has_conjugate_pairs(wanted):
        raise ValueError("complex poles must come in conjugate pairs")
    k = np.zeros(len(b))
    if assign(np.asarray(A, dtype=np.float64), np.asarray(b, dtype=np.float64), wanted, k) < UNCONTROLLABLE:
        raise ValueError("the input does not control the model")
    return k


def has_conjugate_pairs(poles: Poles) -> bool:
    """Return whether complex poles come with their conjugates, to round-off."""
    polynomial = np.poly(poles)
    return bool(np.max(np.abs(np.imag(polynomial))) <= 1e-9 * np.max(np.abs(polynomial)))
