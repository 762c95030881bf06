"""Retrospective cost: algebra against independent minimizers, recursion against the batch solution, reconstruction against the truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import minimize

from flightbed.estimation.reconstruction import retrospective_kernels as kernels
from flightbed.estimation.reconstruction.input_model import InputModel
from flightbed.estimation.reconstruction.retrospective_cost import (
    Reconstruction,
    RetrospectiveConfig,
    RetrospectiveCost,
)
from tests.estimation.random_models import oscillator, random_model

# Two inputs, two outputs, zeros inside the unit circle.
TWO = InputModel(
    np.array([[0.9, 0.1, 0.0], [-0.1, 0.8, 0.05], [0.0, -0.05, 0.7]]),
    np.array([[1.0, 0.2], [0.0, 1.0], [0.3, 0.0]]),
    np.eye(3)[:2],
)
SEEDS = st.integers(0, 2**32 - 1)


def _positive(rng: np.random.Generator, n: int) -> np.ndarray:
    root = rng.standard_normal((n, n))
    return root @ root.T + 0.5 * np.eye(n)


@given(SEEDS, st.integers(1, 6), st.integers(1, 6), st.floats(1e-3, 10.0))
def test_the_optimum_is_the_minimum_of_the_cost(seed: int, performances: int, inputs: int, eta: float) -> None:
    """(25) as a weighted least-squares problem of its own: rows L1' Z^ and sqrt(eta) L2' U*, R = L L'."""
    rng = np.random.default_rng(seed)
    H, z, u = (
        rng.standard_normal((performances, inputs)),
        rng.standard_normal(performances),
        rng.standard_normal(inputs),
    )
    R1, R2 = _positive(rng, performances), _positive(rng, inputs)
    ours = kernels.optimum(H, z, u, R1, R2, eta)
    one, two = np.linalg.cholesky(R1).T, np.sqrt(eta) * np.linalg.cholesky(R2).T
    rows, right = np.vstack([one @ H, two]), np.append(one @ (H @ u - z), np.zeros(inputs))
    np.testing.assert_allclose(ours, np.linalg.lstsq(rows, right, rcond=None)[0], rtol=1e-6, atol=1e-8)


@given(SEEDS, st.integers(1, 4), st.integers(1, 4))
def test_no_direct_search_finds_less(seed: int, performances: int, inputs: int) -> None:
    rng = np.random.default_rng(seed)
    H, z, u = (
        rng.standard_normal((performances, inputs)),
        rng.standard_normal(performances),
        rng.standard_normal(inputs),
    )
    R1, R2 = _positive(rng, performances), _positive(rng, inputs)

    def cost(candidate: np.ndarray) -> float:
        error = z - H @ u + H @ candidate
        return float(error @ R1 @ error + 0.1 * candidate @ R2 @ candidate)

    ours = kernels.optimum(H, z, u, R1, R2, 0.1)
    searched = minimize(cost, np.zeros(inputs), method="BFGS", options={"gtol": 1e-9})
    assert cost(ours) <= searched.fun * (1.0 + 1e-9)
    np.testing.assert_allclose(ours, searched.x, atol=1e-4 * (1.0 + np.abs(ours).max()))


@given(SEEDS, st.floats(0.0, 10.0))
def test_one_input_and_one_output_are_the_special_case(seed: int, eta: float) -> None:
    h, z, u, r1, r2 = np.random.default_rng(seed).uniform(0.1, 3.0, 5) * [-1.0, 1.0, 1.0, 1.0, 1.0]
    general = kernels.optimum(np.array([[h]]), np.array([z]), np.array([u]), np.array([[r1]]), np.array([[r2]]), eta)
    assert kernels.scalar_optimum(h, z, u, r1, r2, eta) == pytest.approx(general[0], rel=1e-12)
    if eta == 0.0:
        assert general[0] == pytest.approx(u - z / h, rel=1e-12)


def test_without_regularization_a_wide_problem_has_the_smallest_optimum(rng: np.random.Generator) -> None:
    """The limit of a vanishing eta: the least R2 norm among those that make the performance 0."""
    H, z, u, R2 = rng.standard_normal((2, 4)), rng.standard_normal(2), rng.standard_normal(4), _positive(rng, 4)
    ours = kernels.optimum(H, z, u, _positive(rng, 2), R2, 0.0)
    np.testing.assert_allclose(z - H @ u + H @ ours, 0.0, atol=1e-12)
    root = np.linalg.cholesky(R2).T  # |root x|^2 = x' R2 x
    np.testing.assert_allclose(
        ours, np.linalg.solve(root, np.linalg.pinv(H @ np.linalg.inv(root)) @ (H @ u - z)), rtol=1e-9
    )


def _run(estimator: RetrospectiveCost, model: InputModel, inputs: np.ndarray, x: np.ndarray) -> list[Reconstruction]:
    found = []
    for u in inputs:
        found.append(estimator.update(model.C @ x))
        x = model.A @ x + model.B @ u
    return found


CONFIGS = {
    "oldest": RetrospectiveConfig(3, 0.7, forgetting=0.98),
    "all": RetrospectiveConfig(
        2, 0.7, (0, 1), ((1, 2), (1,)), fitted="all", regularization=0.01, forgetting=0.97, performance_weight=2.0
    ),
    "delayed": RetrospectiveConfig(2, 0.7, (1, 3), ((2,), (2, 3)), regularization=0.3, regularized_by="performance"),
}


@pytest.mark.parametrize("name", CONFIGS)
def test_the_recursion_is_weighted_least_squares_over_all_samples(rng: np.random.Generator, name: str) -> None:
    """(38): every optimum fitted by every regressor at once, those of sample i weighted by lambda^(k-i), P(0) too."""
    config, model = CONFIGS[name], TWO
    estimator = RetrospectiveCost(config, model)
    found = _run(estimator, model, rng.standard_normal((40, 2)), rng.standard_normal(3))
    lags, order = config.lags, config.order
    u = {k: f.input for k, f in enumerate(found)}
    z = {k: f.performance for k, f in enumerate(found)}
    nothing, wanted = np.zeros(2), range(len(lags)) if config.fitted == "all" else [len(lags) - 1]
    length = order * 4
    information, right = np.eye(length) / config.initial_covariance, np.zeros((length, 2))
    for k, f in enumerate(found):
        if k <= lags[-1]:
            continue
        information, right = config.forgetting * information, config.forgetting * right
        for column in wanted:
            past = [k - lags[column] - i for i in range(1, order + 1)]
            phi = np.concatenate([u.get(i, nothing) for i in past] + [z.get(i, nothing) for i in past])
            information, right = information + np.outer(phi, phi), right + np.outer(phi, f.optimum[column])
    np.testing.assert_allclose(estimator.gains, np.linalg.solve(information, right).T, rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(estimator.covariance, np.linalg.inv(information), rtol=1e-6, atol=1e-10)
    past = [len(found) - 1 - i for i in range(1, order + 1)]
    phi = np.concatenate([u[i] for i in past] + [z[i] for i in past])
    np.testing.assert_allclose(found[-1].input, estimator.gains @ phi, rtol=1e-9)  # (35), of theta(k)


def test_the_optimum_is_that_of_a_replay_of_the_past(rng: np.random.Generator) -> None:
    """With the optimized inputs in place of those applied the model would have had the retrospective performance Z^ = 0."""
    model = random_model(rng, 3, 1, 1)
    config = RetrospectiveConfig(2, 1.0, (0, 1), ((1,), (1,)))  # u(k-1) and u(k-2) from z(k) and z(k-1)
    estimator = RetrospectiveCost(config, model)
    x, states, inputs, outputs = rng.standard_normal(3), [], [], []
    for u in rng.standard_normal((20, 1)):
        outputs.append(model.C @ x)
        found = estimator.update(outputs[-1])
        states.append(found.state)
        inputs.append(found.input)
        x = model.A @ x + model.B @ u
    last, before = found.optimum
    # z(k-1): u*(k-2) through H_1; z(k): u*(k-1) through H_1, u(k-2) as applied (H_2 stays in S).
    replay = model.A @ states[-3] + model.B @ before
    np.testing.assert_allclose(outputs[-2] - model.C @ replay, 0.0, atol=1e-9)
    replay = model.A @ states[-2] + model.B @ last
    np.testing.assert_allclose(outputs[-1] - model.C @ replay, 0.0, atol=1e-9)


def test_a_varying_model_has_the_markov_parameters_of_its_own_past(rng: np.random.Generator) -> None:
    """u*(k-2) through C(k) A(k-1) B(k-2), checked by replaying two steps of a model that changes at each."""
    models = [random_model(rng, 3, 1, 1) for _ in range(15)]
    estimator = RetrospectiveCost(RetrospectiveConfig(2, 1e-3, (0,), ((2,),)), models[0])
    states, inputs = [], []
    for model in models:
        y = rng.standard_normal(1)
        found = estimator.update(y, model=model)
        states.append(found.state)
        inputs.append(found.input)
    x = models[-3].A @ states[-3] + models[-3].B @ found.optimum[0]
    x = models[-2].A @ x + models[-2].B @ inputs[-2]
    np.testing.assert_allclose(y - models[-1].C @ x, 0.0, atol=1e-9)


def test_the_known_input_is_taken_out(rng: np.random.Generator) -> None:
    model = random_model(rng, 2, 1, 1, known=2)
    bare = InputModel(model.A, model.B, model.C)
    with_known, without = (RetrospectiveCost(RetrospectiveConfig(4), one) for one in (model, bare))
    x, moved = np.array([1.0, -1.0]), np.zeros(2)
    for k in range(60):
        v, u = rng.standard_normal(2), np.array([np.sin(0.3 * k)])
        one, other = with_known.update(model.C @ (x + moved), v), without.update(model.C @ x)
        np.testing.assert_allclose(one.input, other.input, rtol=1e-6, atol=1e-8)
        x, moved = model.A @ x + model.B @ u, model.A @ moved + model.G @ v


def test_the_method_scales_with_the_signals(rng: np.random.Generator) -> None:
    """Inputs and outputs s times as large with P(0) s^-2 times as large: everything is s times as large (eta constant)."""
    model = oscillator(3.0, 2.0, 0.1)
    small = RetrospectiveCost(RetrospectiveConfig(2, 1.0, regularization=1e-5), model)
    large = RetrospectiveCost(RetrospectiveConfig(2, 1e-4, regularization=1e-5), model)
    for y in 0.01 * rng.standard_normal(12):
        one, other = small.update(y), large.update(100.0 * y)
        np.testing.assert_allclose(other.input, 100.0 * one.input, rtol=1e-7)


def test_saturation_bounds_the_optimum_and_no_adaptation_keeps_the_gains(rng: np.random.Generator) -> None:
    model = oscillator(5.0)
    estimator = RetrospectiveCost(RetrospectiveConfig(3, saturation=(-0.5, 0.2)), model)
    optima = [float(estimator.update(y).optimum[0, 0]) for y in rng.standard_normal(50)]
    assert min(optima) == -0.5
    assert max(optima) == 0.2
    gains, covariance = estimator.gains, estimator.covariance
    for y in rng.standard_normal(5):
        estimator.update(y, adapt=False)
    np.testing.assert_array_equal(estimator.gains, gains)
    np.testing.assert_array_equal(estimator.covariance, covariance)


@pytest.mark.parametrize(("rule", "expected"), [("constant", 0.2), ("performance", 0.2 * 9.0), ("error", 0.2 * 4.0)])
def test_the_rules_of_the_regularization(rule: str, expected: float) -> None:
    number = {"constant": kernels.CONSTANT, "performance": kernels.PERFORMANCE, "error": kernels.ERROR}[rule]
    assert kernels.regularization(number, 0.2, np.array([3.0]), 4.0) == pytest.approx(expected)


def test_the_error_that_the_next_regularization_follows_is_that_of_this_sample(rng: np.random.Generator) -> None:
    """u* = -h (z - h u) / (h^2 + eta), eta = eta_0 (u*(k-2) - u(k-2))^2, by hand on every sample."""
    model, eta = oscillator(5.0), 0.05
    estimator = RetrospectiveCost(RetrospectiveConfig(2, regularization=eta, regularized_by="error"), model)
    h, last, applied = -float(model.C[0] @ model.B[:, 0]), 0.0, 0.0
    for y in rng.standard_normal(30):
        found = estimator.update(y)
        best = -h * (found.performance[0] - h * applied) / (h * h + eta * last)
        assert found.optimum[0, 0] == pytest.approx(best, rel=1e-9)
        last, applied = (best - applied) ** 2, float(found.input[0])


def test_the_bound_keeps_the_covariance_from_overflow() -> None:
    model = oscillator(5.0)
    config = RetrospectiveConfig(4, forgetting=0.5)
    bounded = RetrospectiveCost(replace(config, covariance_bound=1e6), model)
    free = RetrospectiveCost(config, model)
    with np.errstate(all="ignore"):  # overflows warn if the kernels run plain
        for _ in range(1200):
            bounded.update(np.zeros(1))
            free.update(np.zeros(1))
    assert np.trace(bounded.covariance) <= 2.0 * 1e6 * 8
    assert not np.all(np.isfinite(free.covariance))


def test_two_inputs_of_two_outputs_are_reconstructed(rng: np.random.Generator) -> None:
    k = np.arange(1500)
    inputs = np.column_stack([np.sin(0.2 * k), 0.5 * np.cos(0.35 * k)])
    estimator = RetrospectiveCost(RetrospectiveConfig(8, forgetting=0.99), TWO)
    found = _run(estimator, TWO, inputs, rng.standard_normal(3))
    error = np.array([f.input for f in found])[-100:] - inputs[-100:]
    assert np.max(np.abs(error)) < 1e-3
    np.testing.assert_allclose(found[-1].performance, 0.0, atol=1e-3)


def test_plain_and_compiled_are_the_same(rng: np.random.Generator) -> None:
    z, u, H = rng.standard_normal(2), rng.standard_normal(4), rng.standard_normal((2, 4))
    arguments = (H, z, u, _positive(rng, 2), _positive(rng, 4), 0.1)
    np.testing.assert_allclose(kernels.optimum(*arguments), kernels.optimum.py_func(*arguments), rtol=1e-10)  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"order": 0}, "order must be at least 1"),
        ({"forgetting": 0.0}, r"forgetting must be in \(0, 1\]"),
        ({"regularization": -1.0}, "must not be negative"),
        ({"initial_covariance": 0.0}, "must be positive"),
        ({"covariance_bound": 0.1}, "at least initial_covariance"),
        ({"saturation": (1.0, -1.0)}, "saturation must be"),
        ({"delays": (1, 0), "retained": ((1,), (1,))}, "delays must be"),
        ({"delays": (0, 1)}, "for each of 2 delays"),
        ({"retained": ((0,),)}, "at least one H_i"),
    ],
)
def test_bad_settings_are_refused(settings: dict[str, object], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        RetrospectiveConfig(**{"order": 2, **settings})  # type: ignore[arg-type]


def test_a_problem_without_a_unique_optimum_is_refused(rng: np.random.Generator) -> None:
    model = random_model(rng, 3, 1, 1)
    wide = RetrospectiveConfig(2, retained=((1, 2),))
    with pytest.raises(ValueError, match=r"no unique optimum: H~ \(1, 2\) has rank 1"):
        RetrospectiveCost(wide, model)
    RetrospectiveCost(replace(wide, regularization=0.1, regularized_by="error"), model)
    hidden = InputModel(model.A, np.zeros((3, 1)), model.C)
    with pytest.raises(ValueError, match="no unique optimum"):
        RetrospectiveCost(RetrospectiveConfig(2, regularization=0.1, regularized_by="performance"), hidden)
    for weight, words in ((np.eye(2), "must be"), (np.array([[-1.0]]), "positive definite")):
        with pytest.raises(ValueError, match=words):
            RetrospectiveCost(RetrospectiveConfig(2, performance_weight=weight), model)
    with pytest.raises(ValueError, match="the initial state has shape"):
        RetrospectiveCost(RetrospectiveConfig(2), model, np.zeros(2))
