"""LQ gains against python-control, redesign and its identity, integral action, and switching without a bump."""

from __future__ import annotations

from typing import Any

import control
import numpy as np
import pytest

from flightbed.control.lq import LqConfig, LqServo, lq_gain, offset_weights, redesign, regulator, spectral_radius
from flightbed.core.errors import DesignError

Array = np.ndarray[Any, np.dtype[np.float64]]


def _system(rng: np.random.Generator, n: int, inputs: int) -> tuple[Array, Array, Array, Array]:
    root, of_inputs = rng.standard_normal((n, n)), rng.standard_normal((inputs, inputs))
    Q, R = root @ root.T, of_inputs @ of_inputs.T + 0.1 * np.eye(inputs)
    return rng.standard_normal((n, n)), rng.standard_normal((n, inputs)), Q, R


@pytest.mark.parametrize("inputs", [1, 2, 3])
@pytest.mark.parametrize("n", [1, 2, 4])
def test_gains_are_those_of_python_control(rng: np.random.Generator, n: int, inputs: int) -> None:
    A, B, Q, R = _system(rng, n, inputs)
    theirs, _, _ = control.dlqr(A, B, Q, R)
    F = lq_gain(A, B, Q, R)
    np.testing.assert_allclose(F, theirs, rtol=1e-8, atol=1e-10)
    assert spectral_radius(A - B @ F) < 1.0


def test_the_cost_is_least(rng: np.random.Generator) -> None:
    """x' P x is the cost of the loop, and no other gain nearby has a lower one."""
    A, B, Q, R = _system(rng, 3, 2)

    def cost(F: Array) -> float:
        x, total = np.ones(3), 0.0
        for _ in range(3000):
            u = -F @ x
            total += float(x @ Q @ x + u @ R @ u)
            x = A @ x + B @ u
        return total

    F = lq_gain(A, B, Q, R)
    least = cost(F)
    for _ in range(20):
        assert cost(F + 0.02 * rng.standard_normal(F.shape)) > least


def test_the_redesign_solves_the_equations_of_the_paper(rng: np.random.Generator) -> None:
    """W eq (49) and the Riccati equation below it, as printed."""
    A, B, Q, R = _system(rng, 4, 2)
    left = np.array([0.3, 0.8])
    F, G = redesign(A, B, Q, R, left), np.diag(left)
    P = np.zeros((4, 4))
    loop = A - B @ G @ F
    for _ in range(5000):  # the equation for P is linear in it once F is given
        P = Q + loop.T @ P @ loop + F.T @ R @ F
    np.testing.assert_allclose(np.linalg.solve(R + G @ B.T @ P @ B @ G, G @ B.T @ P @ A), F, rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(redesign(A, B, Q, R, np.ones(2)), lq_gain(A, B, Q, R), rtol=1e-12)


def test_offset_weights_restore_the_healthy_loop(rng: np.random.Generator) -> None:
    A, B, Q, R = _system(rng, 4, 2)
    healthy = lq_gain(A, B, Q, R)
    for left in (np.array([0.25, 1.0]), np.array([0.1, 0.6])):
        F = redesign(A, B, Q, offset_weights(R, left), left)
        np.testing.assert_allclose(left[:, None] * F, healthy, rtol=1e-8, atol=1e-10)


def test_a_lost_input_is_left_out_if_the_other_suffices(rng: np.random.Generator) -> None:
    A, B, Q, R = _system(rng, 3, 2)
    R = np.diag(np.diag(R))
    F = redesign(A, B, Q, R, np.array([0.0, 1.0]))
    np.testing.assert_allclose(F[0], 0.0, atol=1e-12)
    np.testing.assert_allclose(F[1], lq_gain(A, B[:, 1:], Q, R[1:, 1:])[0], rtol=1e-8, atol=1e-10)


def test_an_impossible_design_is_refused() -> None:
    A, B, one = np.diag([1.2, 0.5]), np.array([[1.0, 0.0], [0.0, 1.0]]), np.eye(2)
    with pytest.raises(DesignError, match="no stabilizing gain"):
        redesign(A, B, one, one, np.array([0.0, 1.0]))
    with pytest.raises(DesignError, match="weight of the inputs must be positive definite"):
        lq_gain(A, B, one, np.diag([1.0, 0.0]))
    with pytest.raises(DesignError, match=r"must not be negative \(got \[-0.1, 1.0\]\)"):
        redesign(A, B, one, one, np.array([-0.1, 1.0]))
    with pytest.raises(DesignError, match="no weight offsets the total loss"):
        offset_weights(one, np.array([0.0, 1.0]))
    with pytest.raises(ValueError, match=r"fade: must be in \[0, 1\)"):
        regulator(A, B, one, one, fade=1.0)


# A cart with an actuated mass: two states, two inputs of different strength, sampled at 10 Hz.
_A, _B = np.array([[1.0, 0.1], [0.0, 0.95]]), np.array([[0.0, 0.005], [0.1, 0.1]])
_H = np.array([[1.0, 0.0]])


def _servo(fade: float = 0.0, tracked: Array = _H) -> LqServo:
    return LqServo(LqConfig(_A, _B, np.eye(2), np.eye(2), tracked, 0.05 * np.eye(len(tracked)), fade))


def _fly(law: LqServo, left: Array, samples: int, x: Array, *, reference: float = 1.0) -> tuple[Array, Array]:
    inputs = np.empty((samples, 2))
    for k in range(samples):
        inputs[k] = law.command(x, reference=np.array([reference]))
        x = _A @ x + _B @ (left * inputs[k]) + np.array([0.0, 0.02])  # a steady disturbance
    return x, inputs


def test_the_servo_follows_without_error_in_spite_of_losses_and_disturbances() -> None:
    law = _servo()
    x, _ = _fly(law, np.array([1.0, 1.0]), 600, np.zeros(2))
    assert x[0] == pytest.approx(1.0, abs=1e-9)
    law.redesign(np.array([0.4, 0.9]))
    x, _ = _fly(law, np.array([0.4, 0.9]), 600, x)
    assert x[0] == pytest.approx(1.0, abs=1e-9)


def test_a_regulator_is_the_servo_without_integrators(rng: np.random.Generator) -> None:
    law = LqServo(regulator(_A, _B, np.eye(2), np.eye(2)))
    x, v = rng.standard_normal(2), rng.standard_normal(2)
    np.testing.assert_allclose(law.command(x, external=v), v - lq_gain(_A, _B, np.eye(2), np.eye(2)) @ x, rtol=1e-12)


def test_the_integrators_take_the_step_of_a_redesign_whole_if_they_can() -> None:
    """As many integrators as inputs: u does not change at all at the switch."""
    both = np.eye(2)
    here, there = (_servo(tracked=both) for _ in range(2))
    x, reference = np.array([0.3, -0.2]), np.array([1.0, 0.0])
    for law in (here, there):
        for k in range(20):
            law.command(x * np.cos(k), reference=reference)
    there.redesign(np.array([0.3, 1.0]))
    assert not np.allclose(here.gain, there.gain, rtol=0.05)
    np.testing.assert_allclose(there.command(x), here.command(x), rtol=1e-10)


def test_the_step_beyond_the_integrators_decays() -> None:
    fade = 0.8
    settings = (_A, _B, np.eye(2), np.eye(2))
    old, abrupt, soft = (
        LqServo(regulator(*settings)),
        LqServo(regulator(*settings)),
        LqServo(regulator(*settings, fade=fade)),
    )
    x = np.array([1.0, 0.5])
    for law in (old, abrupt, soft):
        law.command(x)
    left = np.array([0.3, 1.0])
    abrupt.redesign(left)
    soft.redesign(left)
    bump = old.command(x) - abrupt.command(x)
    assert np.max(np.abs(bump)) > 0.1
    for k in range(1, 5):
        np.testing.assert_allclose(soft.command(x) - abrupt.command(x), fade**k * bump, rtol=1e-12)


def test_a_redesign_that_fails_leaves_the_law() -> None:
    law = LqServo(regulator(np.diag([1.2, 0.5]), np.eye(2), np.eye(2), np.eye(2)))
    before = law.gain.copy()
    with pytest.raises(DesignError):
        law.redesign(np.array([0.0, 1.0]))
    np.testing.assert_array_equal(law.gain, before)
