"""Pole placement against scipy and python-control, a case in which Ackermann's formula loses all digits, and impossible placements."""

from __future__ import annotations

import control
import numpy as np
import pytest
from scipy.signal import place_poles

from flightbed.control import placement
from flightbed.control.load_factor import integral_placement


def _ackermann(A: np.ndarray, b: np.ndarray, poles: np.ndarray) -> np.ndarray:
    """Kemp eq (5.11)."""
    n = len(b)
    controllability = np.column_stack([np.linalg.matrix_power(A, i) @ b for i in range(n)])
    value = np.zeros((n, n))
    for coefficient in np.poly(poles).real:
        value = value @ A + coefficient * np.eye(n)
    return np.linalg.solve(controllability.T, np.eye(n)[-1]) @ value


def _poles(rng: np.random.Generator, n: int) -> list[complex]:
    pairs = [complex(rng.uniform(-2, 0), rng.uniform(0.1, 2)) for _ in range(n // 2)]
    return [*pairs, *(p.conjugate() for p in pairs), *rng.uniform(-2, 0, n % 2).tolist()]


@pytest.mark.parametrize("n", range(1, 9))
def test_it_equals_scipy_and_python_control(n: int, rng: np.random.Generator) -> None:
    for _ in range(10):
        A, b, poles = rng.standard_normal((n, n)), rng.standard_normal(n), _poles(rng, n)
        ours = placement.gains(A, b, poles)
        error = 1e-13 * np.linalg.cond(np.column_stack([np.linalg.matrix_power(A, i) @ b for i in range(n)]))
        size = np.max(np.abs(ours))
        assert ours == pytest.approx(np.asarray(control.acker(A, b[:, None], poles)).ravel(), abs=100 * error * size)
        if n > 1:
            theirs = place_poles(A, b[:, None], np.array(poles)).gain_matrix[0]
            assert ours == pytest.approx(theirs, abs=100 * error * size)
        assert np.poly(A - np.outer(b, ours)) == pytest.approx(np.poly(poles).real, abs=1e-9 * max(1.0, size))


def test_it_keeps_the_digits_that_ackermanns_formula_loses() -> None:
    """A chain of 16 coupled lags with the input at one end: known gains are recovered from their closed-loop poles.

    The problem is well posed: scipy finds them too. The controllability matrix has a condition of 1e11 all the same.
    """
    n = 16
    A = 0.5 * np.eye(n) + 0.25 * (np.eye(n, k=1) + np.eye(n, k=-1))
    b, known = np.eye(n)[0], 0.3 * np.random.default_rng(0).standard_normal(16)
    poles = np.linalg.eigvals(A - np.outer(b, known))
    assert np.max(np.abs(placement.gains(A, b, poles.tolist()) - known)) < 1e-12
    assert np.max(np.abs(place_poles(A, b[:, None], poles).gain_matrix[0] - known)) < 1e-12
    assert np.max(np.abs(_ackermann(A, b, poles) - known)) > 1e-7


def test_repeated_poles_are_placed() -> None:
    """Repeated poles, which scipy refuses with one input; Kemp places three at 0.5."""
    A, b = np.array([[0.0, -0.7826, 0.0], [1.0, 1.7692, 0.0], [0.0, -1.0, 1.0]]), np.array([0.15, -0.1025, 0.0])
    k = placement.gains(A, b, (0.5, 0.5, 0.5))
    assert np.poly(A - np.outer(b, k)) == pytest.approx([1.0, -1.5, 0.75, -0.125], abs=1e-11)
    assert k == pytest.approx(_ackermann(A, b, np.full(3, 0.5)), rel=1e-9)


def test_an_uncontrollable_pair_is_detected_by_its_distance(rng: np.random.Generator) -> None:
    """The distance to an uncontrollable pair is at most the coupling of the input to a mode."""
    root = np.linalg.qr(rng.standard_normal((4, 4)))[0]
    A = root @ np.diag([0.9, 0.5, -0.3, 0.1]) @ root.T
    for reach in (1e-2, 1e-6, 1e-10):
        b = root @ np.array([1.0, 1.0, 1.0, reach])
        measure = placement.assign(A, b, np.array([0.1, 0.2, 0.3, 0.4], dtype=complex), np.zeros(4))
        assert 0.0 < measure <= reach
    with pytest.raises(ValueError, match="does not control"):
        placement.gains(A, root @ np.array([1.0, 1.0, 1.0, 0.0]), (0.1, 0.2, 0.3, 0.4))
    with pytest.raises(ValueError, match="does not control"):
        placement.gains(A, np.zeros(4), (0.1, 0.2, 0.3, 0.4))


def test_impossible_placements_are_refused() -> None:
    with pytest.raises(ValueError, match="2 states, 1 poles"):
        placement.gains(np.eye(2), np.ones(2), (0.5,))
    with pytest.raises(ValueError, match="conjugate pairs"):
        placement.gains(np.eye(2), np.ones(2), (0.5 + 0.1j, 0.5))


def test_compiled_and_plain_agree(rng: np.random.Generator) -> None:
    for n in (2, 3, 5):
        A, b, poles = rng.standard_normal((n, n)), rng.standard_normal(n), np.array(_poles(rng, n), dtype=complex)
        plain, compiled = np.zeros(n), np.zeros(n)
        measures = placement.assign(A, b, poles, plain), integral_placement._assign(A, b, poles, compiled)
        assert measures[0] == pytest.approx(measures[1], rel=1e-12)
        assert plain == pytest.approx(compiled, rel=1e-9)
