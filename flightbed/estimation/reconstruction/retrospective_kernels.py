"""Compiled arithmetic of retrospective-cost input reconstruction: one sample, from output to reconstruction.

Histories have the newest value first. With k the present sample, ``U[i]`` is u-hat(k-1-i), ``Z[i]`` is z(k-i), ``H[d]`` are the Markov
parameters of sample k-d, and ``As[i]``, ``Bs[i]`` are the model of sample k-1-i.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from flightbed.core.compiled import compiled

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

# Indices into the numbers of ``take``: eta, forgetting, saturation, bound of P, |U* - U-hat|^2 of the last sample, number of samples.
REGULARIZATION, FORGETTING, LOWEST, HIGHEST, COVARIANCE_BOUND, CHANGE, TICKS = range(7)
CONSTANT, PERFORMANCE, ERROR = 0, 1, 2  # rules of the regularization, see ``regularization``
ADAPTS = True  # whether least squares runs; a literal argument would be compiled as a function of its own


@compiled
def push(history: Array, newest: Array) -> None:
    """Insert a value at the front of a history (depth, ...); the oldest value is dropped."""
    for i in range(history.shape[0] - 1, 0, -1):
        history[i] = history[i - 1]
    history[0] = newest


@compiled
def markov(C: Array, As: Array, Bs: Array, found: Array) -> None:
    """Compute the Markov parameters of y(k) with respect to u-hat(k-i), i = 1 ... r: C A(k-1) ... A(k-i+1) B(k-i), eq (7), time-varying.

    Args:
        C: (p, n) of sample k.
        As, Bs: (r, n, n), (r, n, m), newest first.
        found: (r, p, m), written.

    """
    row = C.copy()
    for i in range(found.shape[0]):
        found[i] = row @ Bs[i]
        row = row @ As[i]


@compiled
def stack(
    H: Array, Z: Array, U: Array, delays: Indices, retained: Indices, lags: Indices
) -> tuple[Array, Array, Array]:
    """Return H~ (s p, g m), Z (s p,) and U-hat~ (g m,) of eqs (17)-(20).

    Because z = y - y^, past inputs enter with a minus, missing in (9)-(12): H~ has blocks -H_i.

    Args:
        H: (depth, r, p, m); Z: (depth, p); U: (depth, m).
        delays: (s,) k_j.
        retained: (s, r), 1 where block j optimizes the input of H_i.
        lags: (g,) q_1 < ... < q_g.

    """
    p, m, r = H.shape[2], H.shape[3], H.shape[1]
    wide, z, u = np.zeros((delays.size * p, lags.size * m)), np.empty(delays.size * p), np.empty(lags.size * m)
    for column in range(lags.size):
        u[column * m : (column + 1) * m] = U[lags[column] - 1]
    for j in range(delays.size):
        z[j * p : (j + 1) * p] = Z[delays[j]]
        for i in range(r):
            if retained[j, i] == 1:
                for column in range(lags.size):
                    if lags[column] == delays[j] + i + 1:
                        wide[j * p : (j + 1) * p, column * m : (column + 1) * m] = -H[delays[j], i]
    return wide, z, u


@compiled
def optimum(H: Array, z: Array, u: Array, R1: Array, R2: Array, eta: float) -> Array:
    """Return the retrospectively optimized inputs U*, the minimum of the cost (25), Gupta et al. eqs (24)-(30).

    J = Z^' R1 Z^ + eta U*' R2 U*, Z^ = Z - H~ U-hat + H~ U*; so U* = -(H~' R1 H~ + eta R2)^-1 H~' R1 (Z - H~ U-hat). With more inputs than
    performances it is computed as -R2^-1 H~' (H~ R2^-1 H~' + eta R1^-1)^-1 (Z - H~ U-hat), which is equal for eta > 0 and stays well
    conditioned as an eta that follows the performance goes to 0: the limit is the minimum with the smallest R2 norm.

    Args:
        H: (s p, g m); z: (s p,); u: (g m,) applied inputs.
        R1: (s p, s p), R2: (g m, g m), positive definite.
        eta: regularization, >= 0.

    """
    free, best = z - H @ u, np.empty(u.size)
    if H.shape[1] <= H.shape[0]:
        weighted = H.T @ R1
        best[:] = -np.linalg.solve(weighted @ H + eta * R2, weighted @ free)
        return best
    back = np.linalg.solve(R2, np.ascontiguousarray(H.T))
    best[:] = -back @ np.linalg.solve(H @ back + eta * np.linalg.inv(R1), free)
    return best


@compiled
def scalar_optimum(h: float, z: float, u: float, r1: float, r2: float, eta: float) -> float:
    """Return ``optimum`` for one input and one performance, H~ = -C B, as in the paper's examples."""
    return -h * r1 * (z - h * u) / (h * r1 * h + eta * r2)


@compiled
def regressor(U: Array, Z: Array, lag: int, order: int) -> Array:
    """Return phi(k-q-1) = (u-hat(k-q-1) ... u-hat(k-q-n_c), z(k-q-1) ... z(k-q-n_c)), q the lag.

    Eq (37) prints y instead of z, which (6) feeds back; z is correct.
    """
    m, p = U.shape[1], Z.shape[1]
    phi = np.empty(order * (m + p))
    for i in range(order):
        phi[i * m : (i + 1) * m] = U[lag + i]
        phi[order * m + i * p : order * m + (i + 1) * p] = Z[lag + 1 + i]
    return phi


@compiled
def least_squares(theta: Array, P: Array, phi: Array, target: Array, forgetting: float, bound: float) -> None:
    """Update theta (m, L) and P (L, L) by one regressor (L,) and target (m,), in place: eqs (39), (40).

    (39) lacks a minus: theta moves towards the target. Forgetting stops while the mean of P's diagonal is above the bound; otherwise
    directions that phi does not excite grow as forgetting^-k and overflow. The bound is an addition to the paper.
    """
    if np.trace(P) > bound * P.shape[0]:
        forgetting = 1.0
    g = P @ phi
    gain = g / (phi @ g + forgetting)
    error = target - theta @ phi
    for i in range(theta.shape[0]):
        for j in range(theta.shape[1]):
            theta[i, j] += error[i] * gain[j]
    for i in range(P.shape[0]):
        for j in range(i + 1):
            P[i, j] = (P[i, j] - gain[i] * g[j]) / forgetting
            P[j, i] = P[i, j]


@compiled
def regularization(rule: int, eta: float, z: Array, last_error: float) -> float:
    """Return eta(k): constant, eta_0 |Z|^2 (31), or eta_0 |U*(k-2) - U-hat(k-2)|^2 (32)."""
    if rule == PERFORMANCE:
        return eta * float(np.sum(z * z))
    return eta * last_error if rule == ERROR else eta


@compiled
def take(
    y: Array, model: tuple[Array, Array, Array], known: Array, memory: tuple[Array, ...], shape: tuple[Indices, ...],
    weights: tuple[Array, Array], numbers: Array, order: int, rule: int, adapt: bool,
) -> tuple[Array, Array]:  # fmt: skip
    """Take the output of one sample: retrospective optimum, least squares, reconstruction, and the next state.

    Args:
        y: (p,).
        model: A, B, C of this sample; known: (n,) G v.
        memory: x (n,), theta, P, U, Z, H, As, Bs; all updated.
        shape: delays, retained, lags, as in ``stack``; and the indices of the lags whose inputs least squares fits.
        weights: R1, R2.
        numbers: eta, forgetting, lower and upper saturation, bound of P; |U* - U-hat|^2 of the last sample, number of samples, both
            updated.
        order: n_c.
        rule: CONSTANT, PERFORMANCE or ERROR.
        adapt: whether least squares runs, beta of (39).

    Returns:
        z (p,) and U* (g m,).

    """
    A, B, C = model
    x, theta, P, U, Z, H, As, Bs = memory
    delays, retained, lags, fitted = shape
    R1, R2 = weights
    z = y - C @ x
    push(Z, z)
    here = np.empty(H.shape[1:])
    markov(C, As, Bs, here)
    push(H, here)
    wide, performance, applied = stack(H, Z, U, delays, retained, lags)
    eta = regularization(rule, numbers[REGULARIZATION], performance, numbers[CHANGE])
    best = np.empty(applied.size)
    if wide.size == 1:
        best[0] = scalar_optimum(wide[0, 0], performance[0], applied[0], R1[0, 0], R2[0, 0], eta)
    else:
        best = optimum(wide, performance, applied, R1, R2, eta)
    m = U.shape[1]
    best = np.minimum(np.maximum(best, numbers[LOWEST]), numbers[HIGHEST])  # (33), (34)
    numbers[CHANGE] = np.sum((best - applied) ** 2)
    if adapt and numbers[TICKS] > lags[-1]:
        forgetting = numbers[FORGETTING]
        for column in fitted:
            phi = regressor(U, Z, lags[column], order)
            least_squares(theta, P, phi, best[column * m : (column + 1) * m], forgetting, numbers[COVARIANCE_BOUND])
            forgetting = 1.0  # forget once per sample, at any number of inputs
    u = theta @ regressor(U, Z, 0, order)
    push(U, u)
    push(As, A)
    push(Bs, B)
    x[:] = A @ x + B @ u + known
    numbers[TICKS] += 1.0
    return z, best
