"""The stability margin against eigenvalues by brute force, and where its parts have known answers."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from flightbed.control.gain_margin import first_crossing, stability_margin
from flightbed.control.lq import lq_gain, spectral_radius

Array = np.ndarray[Any, np.dtype[np.float64]]


def _radius(A: Array, B: Array, F: Array, gamma: Array) -> Array:
    """Spectral radii at rows of gamma (N, l)."""
    loops = A - np.einsum("ij,pj,jk->pik", B, 1.0 + gamma, F)
    return np.asarray(np.max(np.abs(np.linalg.eigvals(loops)), axis=1))


def _loop(rng: np.random.Generator, n: int, inputs: int) -> tuple[Array, Array, Array]:
    A, B = rng.standard_normal((n, n)), rng.standard_normal((n, inputs))
    return A, B, lq_gain(A, B, np.eye(n), 0.3 * np.eye(inputs))


@pytest.mark.parametrize("n", [1, 2, 3, 5])
def test_the_first_crossing_is_that_of_a_fine_search(rng: np.random.Generator, n: int) -> None:
    for _ in range(10):
        M0, M1 = rng.standard_normal((n, n)), rng.standard_normal((n, n))
        M0 *= 0.8 / spectral_radius(M0)
        found = first_crossing(M0, M1)
        t = np.linspace(0.0, 1.01 * found, 4001)[1:]
        radii = np.max(np.abs(np.linalg.eigvals(M0 + t[:, None, None] * M1)), axis=1)
        first = t[np.argmax(radii >= 1.0)]
        assert np.any(radii >= 1.0)
        assert found <= first <= found + 1.01 * found / 4000.0
        assert spectral_radius(M0 + found * M1) == pytest.approx(1.0, abs=1e-7)


def test_crossings_with_known_answers() -> None:
    half = 0.5 * np.eye(2)
    assert first_crossing(half, np.eye(2)) == pytest.approx(0.5, rel=1e-12)  # at +1
    assert first_crossing(half, -np.eye(2)) == pytest.approx(1.5, rel=1e-12)  # at -1
    turn = np.array([[0.0, -1.0], [1.0, 0.0]])
    assert first_crossing(half, turn) == pytest.approx(np.sqrt(0.75), rel=1e-12)  # a complex pair
    assert first_crossing(half, np.array([[0.0, 1.0], [0.0, 0.0]])) == np.inf  # nilpotent: never
    assert first_crossing(half, np.eye(2), 0.4) == np.inf


@pytest.mark.parametrize("n", [1, 2, 4])
def test_with_one_input_the_margin_is_exact(rng: np.random.Generator, n: int) -> None:
    for _ in range(5):
        A, B, F = _loop(rng, n, 1)
        gamma = np.zeros(1)
        found = stability_margin(A, B, F, gamma, limit=1e9)
        inside = np.linspace(-1.0, 1.0, 2001)[:, None] * found.largest * (1.0 - 1e-6)
        assert np.max(_radius(A, B, F, gamma + inside)) < 1.0
        assert abs(found.gamma[0] - gamma[0]) == pytest.approx(found.largest, rel=1e-12)
        assert spectral_radius(A - B @ ((1.0 + found.gamma)[:, None] * F)) == pytest.approx(1.0, abs=1e-7)


@pytest.mark.parametrize("n", [2, 3, 4])
def test_with_two_inputs_it_is_that_of_all_eigenvalues_in_the_box(rng: np.random.Generator, n: int) -> None:
    steps = 401
    axis = np.linspace(-1.0, 1.0, steps)
    box = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    for weights in (np.array([1.0, 1.0]), np.array([0.3, 1.0])):
        A, B, F = _loop(rng, n, 2)
        gamma = np.array([-0.1, 0.05])
        found = stability_margin(A, B, F, gamma, weights=weights)
        assert np.max(_radius(A, B, F, gamma + box * weights * found.smallest)) < 1.0
        assert found.smallest == pytest.approx(found.largest, rel=1.01e-3)
        assert spectral_radius(A - B @ ((1.0 + found.gamma)[:, None] * F)) == pytest.approx(1.0, abs=1e-6)
        assert np.max(np.abs(found.gamma - gamma) / weights) == pytest.approx(found.largest, rel=1e-9)
        reach = 1.05 * found.largest
        unstable = _radius(A, B, F, gamma + box * weights * reach) >= 1.0
        nearest = reach * np.min(np.max(np.abs(box[unstable]), axis=1))
        assert found.largest * (1.0 - 1e-9) <= nearest <= found.largest + 2.0 * reach / steps


@pytest.mark.parametrize(("n", "seed"), [(3, 40), (4, 43), (4, 129)])
def test_a_box_that_is_left_through_the_middle_of_a_face(n: int, seed: int) -> None:
    """Usually a corner of the box loses stability first; in these loops, found by search, another point does."""
    rng = np.random.default_rng(seed)
    A, B = rng.standard_normal((n, n)), rng.standard_normal((n, 2))
    F = lq_gain(A, B, np.eye(n), np.eye(2)) + 0.2 * rng.standard_normal((2, n))
    found = stability_margin(A, B, F, np.zeros(2))
    assert np.min(np.abs(found.gamma)) < 0.9 * found.largest
    axis = np.linspace(-1.0, 1.0, 401)
    box = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    assert np.max(_radius(A, B, F, box * found.smallest)) < 1.0
    corners = np.array([[a, b] for a in (-1.0, 1.0) for b in (-1.0, 1.0)]) * found.largest
    assert np.max(_radius(A, B, F, corners)) < 1.0
    side = int(np.argmax(np.abs(found.gamma)))
    face = np.full((40001, 2), found.gamma[side])
    face[:, 1 - side] = np.linspace(-1.0, 1.0, 40001) * found.largest
    assert np.max(_radius(A, B, F, face)) == pytest.approx(1.0, abs=1e-6)  # touched, not crossed


def test_an_unstable_loop_has_no_margin_and_one_without_feedback_no_limit() -> None:
    A, B = np.array([[1.1]]), np.array([[1.0]])
    assert stability_margin(A, B, np.array([[0.0]]), np.zeros(1)).largest == 0.0
    found = stability_margin(np.array([[0.5]]), B, np.array([[0.0]]), np.zeros(1), limit=3.0)
    assert (found.smallest, found.largest) == (3.0, np.inf)
    assert np.isnan(found.gamma).all()


def test_an_input_that_is_known_does_not_count(rng: np.random.Generator) -> None:
    A, B, F = _loop(rng, 3, 2)
    gamma = np.array([-0.2, -0.1])
    only = stability_margin(A, B, F, gamma, weights=np.array([1.0, 0.0]))
    alone = stability_margin(A - B[:, 1:] @ ((1.0 + gamma[1]) * F[1:]), B[:, :1], F[:1], gamma[:1])
    assert only.largest == pytest.approx(alone.largest, rel=1e-12)
    assert only.gamma[1] == gamma[1]
    assert only.largest >= stability_margin(A, B, F, gamma).largest * (1.0 - 1e-9)


def test_beyond_the_limit_nothing_is_looked_for() -> None:
    """x+ = (0.5 - 0.1 (1 + gamma)) x is stable for gamma between -6 and 14."""
    A, B, F = np.array([[0.5]]), np.array([[1.0]]), np.array([[0.1]])
    assert stability_margin(A, B, F, np.zeros(1)).largest == pytest.approx(6.0, rel=1e-12)
    assert stability_margin(A, B, F, np.zeros(1), limit=5.0).largest == np.inf
