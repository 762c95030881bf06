"""The banded covariance of S 2.4 against samples and against scipy, and weighted least squares against scipy's."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal
from scipy.linalg import toeplitz

from flightbed.studies.methods.least_squares import difference_noise_covariance, least_squares


def test_the_two_parameter_example_is_the_printed_band() -> None:
    a, std = 0.7, 0.3
    R = difference_noise_covariance(np.array([a]), std, 6)
    assert pytest.approx(std**2 * toeplitz([1 + a * a, -a, 0, 0, 0, 0])) == R


def test_higher_orders_are_the_autocorrelation_of_the_filter() -> None:
    a = np.array([1.2, -0.5, 0.1])
    taps = np.append(1.0, -a)
    lags = signal.correlate(taps, taps)[len(a) :]
    assert difference_noise_covariance(a, 2.0, 7) == pytest.approx(4.0 * toeplitz(np.append(lags, np.zeros(3))))


def test_it_is_the_covariance_of_samples(rng: np.random.Generator) -> None:
    a, runs = np.array([0.9, -0.4]), 40000
    v = rng.normal(scale=0.5, size=(runs, 7))
    V = v[:, 2:] - a[0] * v[:, 1:-1] - a[1] * v[:, :-2]
    sample = V.T @ V / runs
    # A sample covariance has a standard deviation of at most sqrt(2/runs) R_00; 25 of them are looked at.
    R = difference_noise_covariance(a, 0.5, 5)
    assert np.max(np.abs(sample - R)) < 5.0 * np.sqrt(2.0 / runs) * R[0, 0]


def test_the_weighted_estimate_has_the_least_variance_and_predicts_it(rng: np.random.Generator) -> None:
    """y+ = a y + b u, outputs known, noise as in S 2.4: the weighted estimate beats the plain one, with the variance it claims."""
    N, runs, b = 60, 400, np.array([0.5, -1.0])
    H = np.column_stack([np.ones(N), np.sin(0.3 * np.arange(N))])
    R = difference_noise_covariance(np.array([0.9]), 0.2, N)
    noise = rng.multivariate_normal(np.zeros(N), R, size=runs)
    _, covariance = least_squares(H, noise[0], R)
    weighted = np.array([least_squares(H, H @ b + v, R)[0] for v in noise])
    plain = np.array([least_squares(H, H @ b + v, 0.04 * np.eye(N))[0] for v in noise])
    assert plain == pytest.approx((H @ b + noise) @ np.linalg.pinv(H).T, abs=1e-12)
    ratio = weighted.var(axis=0) / np.diag(covariance)
    assert ratio == pytest.approx([1.0, 1.0], abs=5.0 * np.sqrt(2.0 / runs))
    assert (weighted.var(axis=0) < plain.var(axis=0)).all()
