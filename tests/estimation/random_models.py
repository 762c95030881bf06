"""Random linear models for the tests of input reconstruction."""

from __future__ import annotations

import numpy as np

from flightbed.avionics.short_period import zero_order_hold
from flightbed.estimation.reconstruction.input_model import InputModel


def random_model(
    rng: np.random.Generator, n: int, m: int, p: int, *, radius: float = 0.9, known: int = 0
) -> InputModel:
    """A stable model of that spectral radius."""
    A = rng.standard_normal((n, n))
    A *= radius / np.max(np.abs(np.linalg.eigvals(A)))
    return InputModel(A, rng.standard_normal((n, m)), rng.standard_normal((p, n)), rng.standard_normal((n, known)))


def oscillator(damping: float, stiffness: float = 0.0, period_s: float = 1.0) -> InputModel:
    """q'' + c q' + k q = u of unit mass, q measured, held input."""
    A, b = zero_order_hold(np.array([[0.0, 1.0], [-stiffness, -damping]]), np.array([0.0, 1.0]), period_s)
    return InputModel(A, b[:, None], np.array([[1.0, 0.0]]))
