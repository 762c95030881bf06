"""Least squares on a difference equation, and the correlation of its noise (Sillence S 2.3, S 2.4)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


def difference_noise_covariance(a: Array, std: float, samples: int) -> Array:
    """Return R = E(V V') of V_k = v_k - a_1 v_(k-1) - ... - a_n v_(k-n), v white (Sillence eqs (18), (26)).

    In a regression on past outputs, the plant's denominator filters the sensor noise v: R is banded, not diagonal.

    Args:
        a: (n,) coefficients of the difference equation y_(k+1) = a_1 y_k + ... ; his two-parameter example has n = 1.
        std: standard deviation of v.
        samples: size of R.

    """
    n = len(a)
    mix = np.zeros((samples, samples + n))
    for k in range(samples):
        mix[k, k : k + n] = -np.asarray(a)[::-1]
        mix[k, k + n] = 1.0
    return std**2 * mix @ mix.T


def least_squares(H: Array, z: Array, R: Array) -> tuple[Array, Array]:
    """Return the minimum-variance estimate (H' R^-1 H)^-1 H' R^-1 z and its covariance (H' R^-1 H)^-1 (Sillence eqs (24), (25)).

    His eq (25) multiplies the covariance by another sigma^2, correct only for R in units of sigma^2; (22), (23) have R = sigma^2 I.

    Args:
        H: (N, p); z: (N,); R: (N, N) covariance of the noise.

    """
    weighted = np.linalg.solve(R, np.column_stack([H, z]))
    covariance = np.linalg.inv(H.T @ weighted[:, :-1])
    return covariance @ (H.T @ weighted[:, -1]), covariance
