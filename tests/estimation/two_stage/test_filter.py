"""The two-stage filter against the Kalman filter of the augmented state, and the laws of its forgetting."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chi2

from flightbed.estimation.two_stage import filter as two_stage
from flightbed.estimation.two_stage.filter import (
    ConstantForgetting,
    Forgetting,
    NoForgetting,
    TwoStageConfig,
    TwoStageFilter,
    VariableForgetting,
    forget,
)

Array = np.ndarray[Any, np.dtype[np.float64]]
SAMPLES, NONE = 60, NoForgetting()


def _positive(rng: np.random.Generator, size: int, scale: float) -> Array:
    root = rng.standard_normal((size, size))
    return scale * (root @ root.T / size + 0.1 * np.eye(size))


def _config(rng: np.random.Generator, n: int, m: int, inputs: int, forgetting: Forgetting = NONE) -> TwoStageConfig:
    return TwoStageConfig(
        Q=_positive(rng, n, 0.01), R=_positive(rng, m, 0.1), Q_gamma=_positive(rng, inputs, 1e-3),
        state=rng.standard_normal(n), state_covariance=_positive(rng, n, 1.0),
        gamma=0.1 * rng.standard_normal(inputs), gamma_covariance=_positive(rng, inputs, 0.5), forgetting=forgetting,
    )  # fmt: skip


class _Augmented:
    """filterpy's Kalman filter of (x, gamma), made from the same config."""

    def __init__(self, config: TwoStageConfig) -> None:
        n, inputs, m = len(config.state), len(config.gamma), len(config.R)
        self.n, self.inputs, self.Q = n, inputs, config.Q
        self.filter = KalmanFilter(dim_x=n + inputs, dim_z=m)
        self.filter.x = np.concatenate([config.state, config.gamma])
        self.filter.P = np.block([
            [config.state_covariance, np.zeros((n, inputs))], [np.zeros((inputs, n)), config.gamma_covariance]
        ])  # fmt: skip
        self.filter.R = config.R

    def step(self, A: Array, B: Array, C: Array, u: Array, y: Array, c: Array, Q_gamma: Array) -> None:
        n, inputs, f = self.n, self.inputs, self.filter
        F = np.block([[A, B @ np.diag(u)], [np.zeros((inputs, n)), np.eye(inputs)]])
        Q = np.zeros((n + inputs, n + inputs))
        Q[:n, :n], Q[n:, n:] = self.Q, Q_gamma
        f.predict(F=F, Q=Q, B=np.eye(n + inputs), u=np.concatenate([B @ u + c, np.zeros(inputs)]))
        f.H = np.hstack([C, np.zeros((len(y), inputs))])
        f.update(y)


def _compare(rng: np.random.Generator, config: TwoStageConfig, *, equivalent: bool = False) -> None:
    n, inputs, m = len(config.state), len(config.gamma), len(config.R)
    ours, theirs = TwoStageFilter(config), _Augmented(config)
    for _ in range(SAMPLES):
        A, B, C = (
            rng.standard_normal((n, n)) / np.sqrt(n),
            rng.standard_normal((n, inputs)),
            rng.standard_normal((m, n)),
        )
        u, y, c = rng.standard_normal(inputs), rng.standard_normal(m), 0.1 * rng.standard_normal(n)
        P = ours.estimate.gamma_covariance
        more = forget(P, config.forgetting.packed()) - P if equivalent else 0.0
        estimate = ours.step(A, B, C, u, y, c)
        theirs.step(A, B, C, u, y, c, config.Q_gamma + more)
        f = theirs.filter
        pairs: list[tuple[Any, Any]] = [
            (estimate.state, f.x[:n]), (estimate.gamma, f.x[n:]), (estimate.state_covariance, f.P[:n, :n]), (estimate.gamma_covariance, f.P[n:, n:]),
            (estimate.innovation, f.y), (estimate.innovation_covariance, f.S), (estimate.nis, f.y @ np.linalg.solve(f.S, f.y)),
            (estimate.effectiveness, 1.0 + f.x[n:]),
        ]  # fmt: skip
        for mine, other in pairs:
            np.testing.assert_allclose(mine, other, rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize("inputs", [1, 2, 3])
@pytest.mark.parametrize("n", [2, 3, 4, 5, 6])
def test_without_forgetting_it_is_the_augmented_kalman_filter(rng: np.random.Generator, n: int, inputs: int) -> None:
    for m in {1, 2, n}:
        _compare(rng, _config(rng, n, m, inputs))


@pytest.mark.parametrize(
    "forgetting", [ConstantForgetting(0.9), VariableForgetting(0.01, 0.3)], ids=["constant", "variable"]
)
def test_forgetting_is_noise_of_gamma_with_a_varying_covariance(
    rng: np.random.Generator, forgetting: Forgetting
) -> None:
    """W S 3: the factors stand for a noise of covariance sum of (1/lambda - 1) alpha e e'."""
    for inputs in (1, 2, 3):
        _compare(rng, _config(rng, 4, 2, inputs, forgetting), equivalent=True)


def test_a_factor_of_one_forgets_nothing(rng: np.random.Generator) -> None:
    P = _positive(rng, 3, 1.0)
    np.testing.assert_array_equal(forget(P, ConstantForgetting(1.0).packed()), P)
    np.testing.assert_array_equal(forget(P, NoForgetting().packed()), P)
    np.testing.assert_allclose(forget(P, ConstantForgetting(0.5).packed()), 2.0 * P, rtol=1e-15)


def test_variable_factors_are_those_of_the_paper(rng: np.random.Generator) -> None:
    """W eqs (30)-(32), term by term."""
    low, high = 0.01, 0.5
    for _ in range(20):
        P = _positive(rng, 3, 10.0 ** rng.uniform(-4, 1))
        values, vectors = np.linalg.eigh(P)
        wanted = np.zeros((3, 3))
        for alpha, e in zip(values, vectors.T, strict=True):
            factor = 1.0 if alpha > high else alpha / (low + (high - low) / high * alpha)
            assert 0.0 < factor <= 1.0
            wanted += alpha / factor * np.outer(e, e)
        np.testing.assert_allclose(forget(P, VariableForgetting(low, high).packed()), wanted, rtol=1e-12, atol=1e-15)


@given(
    seed=st.integers(0, 2**32 - 1), inputs=st.integers(1, 3), n=st.integers(1, 5), least=st.floats(-5.0, -0.5),
    ratio=st.floats(0.1, 5.0), loud=st.floats(-3.0, 3.0),
)  # fmt: skip
def test_variances_stay_within_the_bounds_without_noise_of_gamma(
    seed: int, inputs: int, n: int, least: float, ratio: float, loud: float
) -> None:
    """W eq (29), with Q_gamma = 0 and a prior within the bounds."""
    rng = np.random.default_rng(seed)
    low = 10.0**least
    forgetting = VariableForgetting(low, low * (1.0 + 10.0**ratio))
    high = forgetting.variance_max
    config = _config(rng, n, 1, inputs, forgetting)
    prior = config.gamma_covariance * high / np.linalg.norm(config.gamma_covariance, 2)
    ours = TwoStageFilter(
        TwoStageConfig(**{**vars(config), "Q_gamma": np.zeros((inputs, inputs)), "gamma_covariance": prior})
    )
    for _ in range(25):
        A, B, C = rng.standard_normal((n, n)) / n, rng.standard_normal((n, inputs)), rng.standard_normal((1, n))
        P = ours.step(A, B, C, 10.0**loud * rng.standard_normal(inputs), rng.standard_normal(1)).gamma_covariance
        values = np.linalg.eigvalsh(forget(P, forgetting.packed()))
        assert low * (1.0 - 1e-9) <= values[0]
        assert values[-1] <= high * (1.0 + 1e-9)


def test_a_variance_above_the_bound_is_not_forgotten() -> None:
    """The printed upper bound does not hold for a wide prior: forgetting only adds nothing to it."""
    P = np.diag([10.0, 0.5])
    adjusted = forget(P, VariableForgetting(0.001, 1.0).packed())
    assert adjusted[0, 0] == pytest.approx(10.0, rel=1e-15)
    assert adjusted[1, 1] == pytest.approx(0.001 + 0.999 * 0.5, rel=1e-14)


def test_kernels_do_the_same_compiled_and_plain(rng: np.random.Generator) -> None:
    n, m, inputs = 3, 2, 2
    plain = {name: getattr(two_stage, name).py_func for name in ("predict", "correct")}
    for forgetting in (NoForgetting(), ConstantForgetting(0.95), VariableForgetting(0.01, 0.3)):
        c = _config(rng, n, m, inputs, forgetting)
        A, B, C = rng.standard_normal((n, n)), rng.standard_normal((n, inputs)), rng.standard_normal((m, n))
        V, u, y = rng.standard_normal((n, inputs)), rng.standard_normal(inputs), rng.standard_normal(m)
        given_ = (c.state, V, c.state_covariance, c.gamma, c.gamma_covariance)
        ahead = (*given_, A, B, u, np.ones(n), c.Q, c.Q_gamma, forgetting.packed())
        for mine, other in zip(two_stage.predict(*ahead), plain["predict"](*ahead), strict=True):
            np.testing.assert_allclose(mine, other, rtol=1e-12, atol=1e-13)
        for mine, other in zip(
            two_stage.correct(*given_, C, c.R, y), plain["correct"](*given_, C, c.R, y), strict=True
        ):
            np.testing.assert_allclose(mine, other, rtol=1e-12, atol=1e-13)


def test_before_the_first_correction_the_estimate_is_the_prior(rng: np.random.Generator) -> None:
    config = _config(rng, 3, 2, 2)
    prior = TwoStageFilter(config).estimate
    np.testing.assert_array_equal(prior.state, config.state)
    np.testing.assert_array_equal(prior.gamma_covariance, config.gamma_covariance)
    assert prior.nis == 0.0
    assert not np.any(prior.innovation)


def test_errors_in_a_closed_loop_are_as_large_as_predicted(rng: np.random.Generator) -> None:
    """NEES of (x, gamma) and NIS are chi-square if truth is drawn from the prior, also for inputs computed from the estimates."""
    n, inputs, m, runs = 3, 2, 2, 300
    A = np.array([[0.9, 0.2, 0.0], [-0.1, 0.95, 0.1], [0.0, 0.1, 0.8]])
    B, C = np.array([[0.0, 0.3], [0.5, 0.0], [0.2, 0.4]]), np.eye(2, 3)
    c = TwoStageConfig(
        0.01 * np.eye(n),
        0.04 * np.eye(m),
        1e-4 * np.eye(inputs),
        np.zeros(n),
        np.eye(n),
        np.zeros(inputs),
        0.09 * np.eye(inputs),
    )
    whole, of_gamma, nis = [], [], []
    for _ in range(runs):
        x, gamma, kalman = rng.standard_normal(n), 0.3 * rng.standard_normal(inputs), TwoStageFilter(c)
        for k in range(40):
            u = np.array([np.sin(0.3 * k), np.cos(0.5 * k)]) - 0.2 * kalman.estimate.state[:2]
            x = A @ x + B @ ((1.0 + gamma) * u) + 0.1 * rng.standard_normal(n)
            gamma = gamma + 0.01 * rng.standard_normal(inputs)
            estimate = kalman.step(A, B, C, u, C @ x + 0.2 * rng.standard_normal(m))
        whole.append((estimate.state - x) @ np.linalg.solve(estimate.state_covariance, estimate.state - x))
        of_gamma.append((estimate.gamma - gamma) @ np.linalg.solve(estimate.gamma_covariance, estimate.gamma - gamma))
        nis.append(estimate.nis)
    for values, degrees in ((whole, n), (of_gamma, inputs), (nis, m)):
        low, high = chi2.ppf([0.0005, 0.9995], runs * degrees) / runs
        assert low < np.mean(values) < high, (degrees, np.mean(values))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"Q": np.eye(2)}, r"Q: must have the shape \(3, 3\)"),
        ({"R": np.array([[1.0, 0.5], [0.0, 1.0]])}, "R: must be symmetric"),
        ({"R": np.diag([1.0, 0.0])}, "R: must be positive definite"),
        ({"gamma_covariance": np.diag([0.0, 1.0])}, "gamma_covariance: must be positive definite"),
        ({"Q_gamma": np.diag([-1.0, 1.0])}, "Q_gamma: must be positive semidefinite"),
    ],
)
def test_an_invalid_covariance_is_refused(rng: np.random.Generator, change: dict[str, Array], message: str) -> None:
    config = _config(rng, 3, 2, 2)
    with pytest.raises(ValueError, match=message):
        TwoStageConfig(**{**vars(config), **change})


@pytest.mark.parametrize("factor", [0.0, -0.5, 1.1])
def test_factors_outside_0_to_1_are_refused(factor: float) -> None:
    with pytest.raises(ValueError, match="forgetting factor: must be in"):
        ConstantForgetting(factor)


@pytest.mark.parametrize("bounds", [(0.0, 1.0), (1.0, 0.5), (0.1, np.inf)])
def test_bounds_that_are_none_are_refused(bounds: tuple[float, float]) -> None:
    with pytest.raises(ValueError, match="bounds of the variance"):
        VariableForgetting(*bounds)
