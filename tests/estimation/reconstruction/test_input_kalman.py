"""Alternative methods of input reconstruction against filterpy, the limit of an input without prior, and theory."""

from __future__ import annotations

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter

from flightbed.estimation.reconstruction.input_kalman import (
    InputDynamics,
    InputKalmanFilter,
    UnknownInputObserver,
    harmonic,
    no_observer,
    random_walk,
)
from flightbed.estimation.reconstruction.input_model import InputModel, invariant_zeros
from tests.estimation.random_models import oscillator, random_model


def _filterpy(model: InputModel, d: InputDynamics, Q: np.ndarray, R: np.ndarray, P: np.ndarray) -> KalmanFilter:
    n, size = model.states, d.S.shape[0]
    theirs = KalmanFilter(dim_x=n + size, dim_z=model.outputs)
    theirs.F = np.block([[model.A, model.B @ d.H], [np.zeros((size, n)), d.S]])
    theirs.H = np.hstack([model.C, np.zeros((model.outputs, size))])
    theirs.Q, theirs.P = np.zeros((n + size, n + size)), np.zeros((n + size, n + size))
    theirs.Q[:n, :n], theirs.Q[n:, n:] = Q, d.Q
    theirs.P[:n, :n], theirs.P[n:, n:] = P, d.P0
    theirs.R, theirs.x = R, np.zeros((n + size, 1))
    return theirs


@pytest.mark.parametrize(
    "dynamics",
    [random_walk(2, step_std=0.3, initial_std=1.0), harmonic(2, 0.2, step_std=0.1, initial_std=2.0)],
    ids=["random walk", "harmonic"],
)
def test_the_kalman_filter_is_filterpys(rng: np.random.Generator, dynamics: InputDynamics) -> None:
    model = random_model(rng, 3, 2, 2, known=1)
    Q, R, P = 0.1 * np.eye(3), np.diag([0.2, 0.3]), 4.0 * np.eye(3)
    ours = InputKalmanFilter(dynamics, model, process=Q, noise=R, state_covariance=P)
    theirs = _filterpy(model, dynamics, Q, R, P)
    for _ in range(40):
        y, v = rng.standard_normal(2), rng.standard_normal(1)
        found = ours.update(y, v)
        theirs.update(y)
        np.testing.assert_allclose(found.state, theirs.x[:3, 0], rtol=1e-8, atol=1e-10)
        np.testing.assert_allclose(found.input, dynamics.H @ theirs.x[3:, 0], rtol=1e-8, atol=1e-10)
        np.testing.assert_allclose(found.innovation, theirs.y[:, 0], rtol=1e-8, atol=1e-10)
        spread = dynamics.H @ theirs.P[3:, 3:] @ dynamics.H.T
        np.testing.assert_allclose(found.input_std, np.sqrt(np.diag(spread)), rtol=1e-8)
        theirs.predict()
        theirs.x[:3, 0] += model.G @ v


def test_a_correctly_modelled_input_is_found_exactly_even_behind_a_zero_on_the_unit_circle() -> None:
    """Internal model: without noise the filter with the known frequency converges on the sampled rigid body."""
    model = oscillator(0.0)
    ours = InputKalmanFilter(
        harmonic(1, 0.2, step_std=0.0, initial_std=1.0), model, process=np.zeros((2, 2)), noise=1e-6 * np.eye(1), state_covariance=np.eye(2)
    )  # fmt: skip
    x = np.array([1.0, -0.5])
    for k in range(300):
        u = 0.6 * np.sin(0.2 * k + 0.4)
        found = ours.update(model.C @ x)
        x = model.A @ x + model.B[:, 0] * u
    assert abs(found.input[0] - u) < 1e-5


def test_the_harmonic_turns_by_its_frequency() -> None:
    d = harmonic(1, 0.3, step_std=0.0, initial_std=1.0)
    s = np.array([np.sin(0.1), np.cos(0.1)])
    for k in range(5):
        assert d.H @ s == pytest.approx([np.sin(0.1 + 0.3 * k)])
        s = d.S @ s


@pytest.mark.parametrize(("n", "m", "p"), [(3, 1, 2), (4, 2, 3), (2, 1, 1), (4, 2, 2)])
def test_the_observer_is_the_kalman_filter_of_a_white_input_without_prior(
    rng: np.random.Generator, n: int, m: int, p: int
) -> None:
    """The limit of an ever larger covariance of the input, filtered by filterpy: a white input enters as process noise B B'."""
    model = next(one for one in (random_model(rng, n, m, p, known=1) for _ in range(1000)) if no_observer(one) is None)
    Q, R, P = 0.1 * np.eye(n), 0.2 * np.eye(p), np.eye(n)
    ours = UnknownInputObserver(model, process=Q, noise=R, state_covariance=P)
    theirs = KalmanFilter(dim_x=n, dim_z=p)
    theirs.F, theirs.H, theirs.P, theirs.R, theirs.x = model.A, model.C, P.copy(), R, np.zeros((n, 1))
    theirs.Q = Q + 1e7 * model.B @ model.B.T
    predicted = P
    for k in range(30):
        y, v = rng.standard_normal(p), rng.standard_normal(1)
        before = theirs.x[:, 0]
        theirs.update(y)
        found = ours.update(y, v)
        np.testing.assert_allclose(found.state, theirs.x[:, 0], rtol=1e-4, atol=1e-4)
        if k:  # u(k-1), the mean of the white input given y: Q_u B' of the smoothed step
            spread = model.C @ predicted @ model.C.T + R
            expected = 1e7 * model.B.T @ model.C.T @ np.linalg.solve(spread, y - model.C @ before)
            np.testing.assert_allclose(found.input, expected, rtol=1e-3, atol=1e-3)
        theirs.predict()
        theirs.x[:, 0] += model.G @ v
        predicted = theirs.P.copy()


def test_without_noise_the_error_dies_by_the_zeros(rng: np.random.Generator) -> None:
    """Equal numbers of inputs and outputs: the observer's modes are the zeros, for any covariances."""
    model = oscillator(4.0, 2.0, 0.1)
    (zero,) = invariant_zeros(model).real
    ours = UnknownInputObserver(model, process=np.eye(2), noise=np.eye(1), state_covariance=1e-9 * np.eye(2))
    x, errors = np.array([1.0, 2.0]), []
    for _ in range(40):
        u = rng.standard_normal(1)
        errors.append(np.linalg.norm(x - ours.update(model.C @ x).state))
        x = model.A @ x + model.B @ u
    np.testing.assert_allclose(np.array(errors[11:]) / np.array(errors[10:-1]), abs(zero), rtol=1e-6)


def test_its_standard_deviation_is_honest(rng: np.random.Generator) -> None:
    """Normalized squared errors of the input over 400 runs: chi-square of 400 x 20 degrees of freedom or so, mean 1 +- 5 sigma."""
    model, std = oscillator(5.0), 0.01
    scores = []
    for _ in range(400):
        ours = UnknownInputObserver(
            model, process=np.zeros((2, 2)), noise=std**2 * np.eye(1), state_covariance=np.eye(2)
        )
        x, before = rng.standard_normal(2), 0.0
        for k in range(12):
            found = ours.update(model.C @ x + std * rng.standard_normal(1))
            if k == 11:
                scores.append(((found.input[0] - before) / found.input_std[0]) ** 2)
            before = float(rng.standard_normal())
            x = model.A @ x + model.B[:, 0] * before
    assert abs(np.mean(scores) - 1.0) < 5.0 * np.sqrt(2.0 / len(scores))


def test_it_does_not_exist_where_the_plant_hides_the_input(rng: np.random.Generator) -> None:
    assert no_observer(oscillator(5.0)) is None
    assert "a mode at -1" in str(no_observer(oscillator(0.0)))
    assert "rank 0 for 1" in str(no_observer(InputModel(np.eye(2), np.array([[0.0], [1.0]]), np.array([[1.0, 0.0]]))))
    with pytest.raises(ValueError, match="no unknown-input observer: a mode at -1"):
        UnknownInputObserver(oscillator(0.0), process=np.eye(2), noise=np.eye(1), state_covariance=np.eye(2))
    for _ in range(40):  # in square systems the zeros decide
        model = random_model(rng, 4, 2, 2)
        assert (no_observer(model) is None) == bool(np.all(np.abs(invariant_zeros(model)) < 1.0))


def test_an_input_of_another_size_is_refused() -> None:
    with pytest.raises(ValueError, match="have 2 inputs, the model has 1"):
        InputKalmanFilter(
            random_walk(2, step_std=1.0, initial_std=1.0), oscillator(1.0), process=np.eye(2), noise=np.eye(1), state_covariance=np.eye(2)
        )  # fmt: skip
