"""Theorem 1 against an independent Kalman filter, its special cases as printed, and the batch regression."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter

from flightbed.studies.methods import joint
from flightbed.studies.methods.record import batch_estimate, estimate_record


class System(NamedTuple):
    A: np.ndarray
    b: np.ndarray
    C: np.ndarray
    Q: np.ndarray
    R: np.ndarray
    u: np.ndarray
    z: np.ndarray
    x0: np.ndarray
    P0: np.ndarray


def _covariance(rng: np.random.Generator, n: int) -> np.ndarray:
    root = rng.standard_normal((n, n))
    return root @ root.T + 0.1 * np.eye(n)


def _system(rng: np.random.Generator, n: int, m: int, N: int = 60) -> System:
    """A random system with full covariances, and a record of it. The spectral radius is 0.99."""
    A = rng.standard_normal((n, n))
    A *= 0.99 / np.max(np.abs(np.linalg.eigvals(A)))
    b, C = rng.standard_normal(n), rng.standard_normal((m, n))
    Q, R = 0.01 * _covariance(rng, n), 0.1 * _covariance(rng, m)
    u, K = rng.standard_normal(N), rng.uniform(0.1, 1.0)
    x, z = rng.standard_normal(n), np.empty((N, m))
    for k in range(N):
        x = A @ x + K * b * u[k] + rng.multivariate_normal(np.zeros(n), Q)
        z[k] = C @ x + rng.multivariate_normal(np.zeros(m), R)
    return System(A, b, C, Q, R, u, z, np.append(rng.standard_normal(n), 0.8), _covariance(rng, n + 1))


def _filterpy(s: System) -> tuple[np.ndarray, np.ndarray]:
    n, m = s.A.shape[0], s.C.shape[0]
    filter_ = KalmanFilter(dim_x=n + 1, dim_z=m)
    filter_.x, filter_.P, filter_.R = s.x0.copy(), s.P0.copy(), s.R
    filter_.H = np.hstack([s.C, np.zeros((m, 1))])
    filter_.Q = np.zeros((n + 1, n + 1))
    filter_.Q[:n, :n] = s.Q
    xs, Ps = [], []
    for u, z in zip(s.u, s.z, strict=True):
        F = np.eye(n + 1)
        F[:n, :n], F[:n, n] = s.A, s.b * u
        filter_.F = F
        filter_.predict()
        filter_.update(z)
        xs.append(filter_.x.ravel().copy())
        Ps.append(filter_.P.copy())
    return np.array(xs), np.array(Ps)


@pytest.mark.parametrize(("n", "m"), [(1, 1), (2, 1), (2, 2), (3, 2), (4, 3)])
@pytest.mark.parametrize("draw", range(4))
def test_equals_filterpy_on_random_systems(rng: np.random.Generator, n: int, m: int, draw: int) -> None:
    s = _system(rng, n, m)
    ours = estimate_record(**s._asdict())
    xs, Ps = _filterpy(s)
    scale = max(1.0, float(np.max(np.abs(xs))))
    np.testing.assert_allclose(np.column_stack([ours.x, ours.effectiveness]), xs, rtol=0, atol=1e-10 * scale)
    np.testing.assert_allclose(ours.P, Ps, rtol=0, atol=1e-10 * float(np.max(np.abs(s.P0))))


def test_scalar_measurement_equals_the_printed_special_case(rng: np.random.Generator) -> None:
    """Sillence eqs (64)-(71), letter for letter (with Pachter's brackets in X)."""
    s = _system(rng, 2, 1)
    A, b, C, R = s.A, s.b, s.C[0], float(s.R[0, 0])
    P0 = s.P0.copy()
    P0[:2, 2] = P0[2, :2] = 0.0  # his initial cross-covariance
    ours = estimate_record(**{**s._asdict(), "P0": P0})
    x, K, Pxx, pxK, pKK = s.x0[:2], s.x0[2], P0[:2, :2], P0[:2, 2], P0[2, 2]
    for k, (u, z) in enumerate(zip(s.u, s.z[:, 0], strict=True)):
        M = A @ Pxx @ A.T + u * (np.outer(A @ pxK, b) + np.outer(b, A @ pxK)) + u**2 * pKK * np.outer(b, b) + s.Q
        Cb, CAp = C @ b, C @ A @ pxK
        X = C @ A @ Pxx @ A.T @ C + 2 * u * Cb * CAp + u**2 * Cb**2 * pKK + C @ s.Q @ C + R
        numerator = A @ Pxx @ A.T @ C + u * (Cb * (A @ pxK) + CAp * b) + u**2 * Cb * pKK * b + s.Q @ C
        gain_x, gain_K = numerator / X, (CAp + u * Cb * pKK) / X
        innovation = z - C @ A @ x - K * Cb * u
        x, K = A @ x + K * b * u + gain_x * innovation, K + gain_K * innovation
        Pxx, pxK, pKK = (
            np.linalg.inv(np.linalg.inv(M) + np.outer(C, C) / R),
            A @ pxK + u * pKK * b - (CAp + u * Cb * pKK) / X * numerator,
            pKK - (CAp + u * Cb * pKK) ** 2 / X,
        )
        assert ours.x[k] == pytest.approx(x, rel=1e-9, abs=1e-10)
        assert ours.effectiveness[k] == pytest.approx(K, rel=1e-9, abs=1e-10)
        np.testing.assert_allclose(ours.P[k][:2, :2], Pxx, rtol=1e-8, atol=1e-10)
        np.testing.assert_allclose(ours.P[k][:2, 2], pxK, rtol=1e-8, atol=1e-10)
        assert ours.P[k][2, 2] == pytest.approx(pKK, rel=1e-8, abs=1e-10)


def test_known_gain_is_the_classical_filter(rng: np.random.Generator) -> None:
    """Pachter's Corollary 4: with p_KK(0) = 0 the classical Kalman filter comes out, K never moves."""
    s = _system(rng, 3, 2)
    P0 = s.P0.copy()
    P0[3, :] = P0[:, 3] = 0.0
    ours = estimate_record(**{**s._asdict(), "P0": P0})
    classical = KalmanFilter(dim_x=3, dim_z=2, dim_u=1)
    classical.x, classical.P, classical.F, classical.H = s.x0[:3].copy(), P0[:3, :3].copy(), s.A, s.C
    classical.B, classical.Q, classical.R = (s.b * s.x0[3])[:, None], s.Q, s.R
    classical.x = classical.x[:, None]
    for k, (u, z) in enumerate(zip(s.u, s.z, strict=True)):
        classical.predict(u=np.array([[u]]))
        classical.update(z[:, None])
        np.testing.assert_allclose(ours.x[k], classical.x.ravel(), rtol=0, atol=1e-10)
    assert np.all(ours.effectiveness == s.x0[3])
    assert np.all(ours.P[:, 3, :] == 0.0)


@pytest.mark.parametrize("draw", range(4))
def test_recursion_equals_batch_regression_with_full_covariance(rng: np.random.Generator, draw: int) -> None:
    """Sillence S 4.4: one regression over the record gives the same K-hat and variance as the recursion."""
    s = _system(rng, 2, 2, N=40)
    ours = estimate_record(**s._asdict())
    theta, covariance = batch_estimate(**s._asdict())
    assert ours.effectiveness[-1] == pytest.approx(theta[2], abs=1e-9)
    assert ours.P[-1][2, 2] == pytest.approx(covariance[2, 2], rel=1e-8)


def _batch_as_printed(s: System) -> np.ndarray:
    """Eqs (76), (77) to the letter: the covariance of V~ taken as diagonal blocks r_k = sum C A^i Q A'^i C' + R."""
    n, m, N = 2, 2, len(s.u)
    H, W, z = np.zeros((N * m, n + 1)), np.zeros((N * m, N * m)), s.z.ravel()
    power, forced, r = np.eye(n), np.zeros(n), s.R.copy()
    for k in range(N):
        r = r + s.C @ power @ s.Q @ power.T @ s.C.T
        power, forced = s.A @ power, s.A @ forced + s.b * s.u[k]
        rows = slice(k * m, (k + 1) * m)
        H[rows, :n], H[rows, n], W[rows, rows] = s.C @ power, s.C @ forced, np.linalg.inv(r)
    prior = np.linalg.inv(s.P0)
    return np.linalg.solve(prior + H.T @ W @ H, prior @ s.x0 + H.T @ W @ z)


def test_batch_with_the_printed_diagonal_covariance_holds_without_process_noise_only(rng: np.random.Generator) -> None:
    s = _system(rng, 2, 2, N=40)
    quiet = s._replace(Q=np.zeros((2, 2)))
    assert estimate_record(**quiet._asdict()).effectiveness[-1] == pytest.approx(_batch_as_printed(quiet)[2], abs=1e-8)
    noisy = estimate_record(**s._asdict())
    assert abs(noisy.effectiveness[-1] - _batch_as_printed(s)[2]) > 0.01 * np.sqrt(noisy.P[-1][2, 2])


@pytest.mark.parametrize("forgetting", [0.9, 0.99])
def test_fading_memory_equals_filterpys(rng: np.random.Generator, forgetting: float) -> None:
    """filterpy's alpha^2 scales F P F', as our 1/lambda does."""
    s = _system(rng, 2, 2)
    r = np.diag(s.R).copy()
    theirs = KalmanFilter(dim_x=3, dim_z=2)
    theirs.x, theirs.P, theirs.R, theirs.H, theirs.Q = (
        s.x0.copy(),
        s.P0.copy(),
        np.diag(r),
        np.hstack([s.C, np.zeros((2, 1))]),
        np.zeros((3, 3)),
    )
    theirs.Q[:2, :2] = s.Q
    theirs.alpha = forgetting**-0.5
    X, P, T = s.x0[:, None].copy(), s.P0[:, :, None].copy(), np.zeros((4, 3, 1))
    model = np.column_stack([s.A, s.b, np.zeros(2)])
    for u, z in zip(s.u, s.z, strict=True):
        joint.predict(X, P, T, model, float(u), s.Q, 1.0 / forgetting)
        joint.correct(X, P, T, s.C, r, tuple(z.tolist()))
        theirs.F = np.block([[s.A, (s.b * u)[:, None]], [np.zeros((1, 2)), np.ones((1, 1))]])
        theirs.predict()
        theirs.update(z)
        np.testing.assert_allclose(X[:, 0], theirs.x.ravel(), rtol=0, atol=1e-9)
        np.testing.assert_allclose(P[:, :, 0], theirs.P, rtol=0, atol=1e-9)


def test_compiled_and_plain_kernels_agree(rng: np.random.Generator) -> None:
    s = _system(rng, 2, 2)
    X, P, T = s.x0[:, None].copy(), s.P0[:, :, None].copy(), np.zeros((4, 3, 1))
    X2, P2, T2 = X.copy(), P.copy(), T.copy()
    model = np.column_stack([s.A, s.b, np.zeros(2)])
    for u, z in zip(s.u, s.z, strict=True):
        joint.predict(X, P, T, model, float(u), s.Q, 1.1)
        joint.correct(X, P, T, s.C, np.diag(s.R).copy(), tuple(z.tolist()))
        joint.predict.py_func(X2, P2, T2, model, float(u), s.Q, 1.1)
        joint.correct.py_func(X2, P2, T2, s.C, np.diag(s.R).copy(), tuple(z.tolist()))
    np.testing.assert_allclose(X, X2, rtol=1e-12)
    np.testing.assert_allclose(P, P2, rtol=1e-11)
