"""Identification from sinusoidal tests: transfer functions from phasors (Sillence S 2.2), without noise."""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Vector = npt.NDArray[np.float64]


class TransferFunction(NamedTuple):
    """H(s) = (b_1 s^(n-1) + ... + b_n) / (s^n - a_1 s^(n-1) - ... - a_n), Sillence eq (7), with his signs of a; a and b are (n,)."""

    a: Vector
    b: Vector

    def response(self, omega_rad_s: Vector) -> npt.NDArray[np.complex128]:
        """Return H(j omega) at the given frequencies."""
        s = 1j * np.asarray(omega_rad_s, dtype=np.float64)
        n = len(self.a)
        powers = np.array([s ** (n - 1 - i) for i in range(n)])
        return np.asarray((self.b @ powers) / (s**n - self.a @ powers), dtype=np.complex128)


def phasor(omega_rad_s: float, t_s: Vector, y: Vector) -> complex:
    """Return A + jB of y = A sin(w t) + B cos(w t), the steady response to sin(w t), by least squares (Sillence eq (9)).

    Args:
        omega_rad_s: frequency of the test.
        t_s: (N,) times, after the transients.
        y: (N,) output.

    """
    columns = np.column_stack([np.sin(omega_rad_s * t_s), np.cos(omega_rad_s * t_s)])
    (A, B), *_ = np.linalg.lstsq(columns, y, rcond=None)
    return complex(A, B)


def transfer_function(omega_rad_s: Vector, response: npt.NDArray[np.complex128], *, order: int) -> TransferFunction:
    """Return the transfer function of order n, 2n parameters, from its response to n or more sinusoids.

    Sillence eq (12), H = sum_i H (j w)^-i a_i + sum_i (j w)^-i b_i, is linear in a and b; its real and imaginary parts are his
    eq (14), two equations per frequency. With more than n frequencies the solution is by least squares.

    Args:
        omega_rad_s: (m,) frequencies, m >= n, distinct and not 0.
        response: (m,) A + jB at each.
        order: n.

    Raises:
        ValueError: fewer than n distinct frequencies, or one is 0.

    """
    omega = np.asarray(omega_rad_s, dtype=np.float64)
    if len(np.unique(omega)) < order or not np.all(omega):
        raise ValueError(f"order {order} needs {order} different frequencies that are not 0 (got {omega.tolist()})")
    powers = np.array([(1j * omega) ** -i for i in range(1, order + 1)]).T
    rows = np.hstack([response[:, None] * powers, powers])
    theta, *_ = np.linalg.lstsq(np.vstack([rows.real, rows.imag]), np.append(response.real, response.imag), rcond=None)
    return TransferFunction(theta[:order], theta[order:])


def second_order(omega_rad_s: float, response: complex) -> tuple[float, float]:
    """Return (omega_n, zeta) of omega_n^2 / (s^2 + 2 zeta omega_n s + omega_n^2) from one phasor A + jB (Sillence S 2.2.1).

    The imaginary one of his two intermediate equations lacks a factor omega_n; his results are correct.

    Raises:
        ValueError: no stable second-order system has this response.

    """
    A, B = response.real, response.imag
    size = A * A + B * B
    if not size > A or not B < 0.0:
        raise ValueError(
            f"no stable second-order system of unit gain has the response {response:g} at {omega_rad_s:g} rad/s; the imaginary part "
            "must be negative and |H|^2 above the real part"
        )
    return omega_rad_s * sqrt(size / (size - A)), -B / (2.0 * sqrt((size - A) * size))
