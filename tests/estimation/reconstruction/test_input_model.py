"""Markov parameters against simulation; zeros against python-control; inconsistent shapes are refused."""

from __future__ import annotations

import control
import numpy as np
import pytest

from flightbed.estimation.reconstruction.input_model import InputModel, invariant_zeros
from tests.estimation.random_models import oscillator, random_model


def test_markov_parameters_are_the_impulse_response(rng: np.random.Generator) -> None:
    model = random_model(rng, 4, 2, 3)
    found = model.markov(6)
    assert found.shape == (6, 3, 2)
    for column in range(2):
        x = model.B[:, column]
        for i in range(6):
            np.testing.assert_allclose(found[i][:, column], model.C @ x, rtol=1e-12)
            x = model.A @ x


@pytest.mark.parametrize(("n", "m"), [(2, 1), (3, 1), (5, 2), (6, 3)])
def test_zeros_are_those_of_python_control(rng: np.random.Generator, n: int, m: int) -> None:
    for _ in range(10):
        model = random_model(rng, n, m, m)
        theirs = control.zeros(control.ss(model.A, model.B, model.C, np.zeros((m, m)), 1.0))
        ours = invariant_zeros(model)
        theirs = theirs[np.abs(theirs) < 1e6]  # python-control includes infinite zeros
        assert len(ours) == len(theirs) == n - m
        for zero in theirs:
            assert np.min(np.abs(ours - zero)) < 1e-6 * (1.0 + abs(zero))


def test_the_sampled_rigid_body_has_its_zero_at_minus_one() -> None:
    assert invariant_zeros(oscillator(0.0)) == pytest.approx([-1.0], abs=1e-9)


def test_zeros_are_of_square_systems(rng: np.random.Generator) -> None:
    with pytest.raises(ValueError, match="1 unknown inputs, 2 outputs"):
        invariant_zeros(random_model(rng, 3, 1, 2))


def test_shapes_that_do_not_fit_are_refused() -> None:
    with pytest.raises(ValueError, match=r"needs A \(n, n\)"):
        InputModel(np.eye(2), np.ones((3, 1)), np.ones((1, 2)))
    with pytest.raises(ValueError, match=r"needs A \(n, n\)"):
        InputModel(np.eye(2), np.ones(2), np.ones((1, 2)))
    model = InputModel(np.eye(2), np.ones((2, 1)), np.ones((1, 2)))
    with pytest.raises(ValueError, match="1 components, the model's G has 0 columns"):
        model.known_part(np.ones(1))
    np.testing.assert_array_equal(model.known_part(None), np.zeros(2))
