"""The design model ShortPeriod, from a LinearModel: states (alpha, q), input elevator, and the actuator as a third state."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Matrix = npt.NDArray[np.float64]
Vector = npt.NDArray[np.float64]


class Discrete(NamedTuple):
    """x+ = A x + b u over one period; A (n, n), b (n,) or (n, m)."""

    A: Matrix
    b: Vector


@dataclass(frozen=True)
class ShortPeriod:
    """Short-period motion in deviations from trim: x' = A x + K b u, x = (alpha, q). SI, radians.

    Attributes:
        A: (2, 2), [[Z_alpha, Z_q], [M_alpha, M_q]], 1/s and 1.
        b: (2,), [Z_delta, M_delta], per rad of elevator.
        actuator_rad_s: bandwidth of the first-order actuator.
        alpha_trim_rad, elevator_trim_rad: trim values of the deviations.

    """

    A: Matrix
    b: Vector
    actuator_rad_s: float
    alpha_trim_rad: float = 0.0
    elevator_trim_rad: float = 0.0

    @property
    def poles(self) -> npt.NDArray[np.complex128]:
        """Open-loop poles of the short period without actuator, (2,), rad/s."""
        return np.asarray(np.linalg.eigvals(self.A), dtype=np.complex128)

    def with_actuator(self, effectiveness: float = 1.0) -> tuple[Matrix, Vector]:
        """Return A (3, 3) and b (3,) of x = (alpha, q, elevator), the elevator command as input (Sillence S 3.1)."""
        lag = self.actuator_rad_s
        A = np.zeros((3, 3))
        A[:2, :2] = self.A
        A[:2, 2] = effectiveness * self.b
        A[2, 2] = -lag
        return A, np.array([0.0, 0.0, lag])

    def discrete(self, hz: float) -> Discrete:
        """Return the zero-order-hold equivalent with the surface position as input, without the actuator."""
        return zero_order_hold(self.A, self.b, 1.0 / hz)


def zero_order_hold(A: Matrix, b: Matrix, period_s: float) -> Discrete:
    """Discretize x' = A x + b u for inputs held over the period, by one matrix exponential of [[A, b], [0, 0]].

    Args:
        A: (n, n).
        b: (n,) for one input, (n, m) for several; the result has the same shape.
        period_s: hold period, s.

    """
    from scipy.linalg import expm  # slow to import

    n = A.shape[0]
    columns = b.reshape(n, -1)
    size = n + columns.shape[1]
    block = np.zeros((size, size))
    block[:n, :n] = A * period_s
    block[:n, n:] = columns * period_s
    transition = expm(block)
    return Discrete(transition[:n, :n], transition[:n, n:].reshape(b.shape))
