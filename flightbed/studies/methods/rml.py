"""Recursive maximum likelihood: the parameters of an ARMAX model of any order, the comparison method of Kemp S 3.4.

    A(z^-1) y = B(z^-1) u + C(z^-1) e,  A = 1 + a_1 z^-1 + ... , B = b_1 z^-1 + ... , C = 1 + c_1 z^-1 + ...

by a stochastic Newton step on the prediction error, whose gradient is the regressor filtered by 1/C (Soderstrom 1973; Ljung and Soderstrom,
Theory and Practice of Recursive Identification, 1983; Kemp S 3.4, whose eqs (3.14) and listing this follows).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from flightbed.core.compiled import compiled

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class RmlConfig:
    """Settings. Input and output in the caller's units.

    Attributes:
        order: n, of A, B and C.
        prior_var: P(0) of a and b, in units of the variance of e; eq (3.15).
        noise_prior_var: P(0) of c; with 0, C stays 1 and the method is recursive least squares.
        forgetting: lambda, 0 < lambda <= 1; an error k samples old has the weight lambda^k.
        root_limit: largest modulus of the roots of C; roots beyond are projected onto it. At 1, as in the listing, the gradient may
            not decay.

    """

    order: int
    prior_var: float = 200.0
    noise_prior_var: float = 10.0
    forgetting: float = 1.0
    root_limit: float = 1.0

    def __post_init__(self) -> None:
        if self.order < 1:
            raise ValueError(f"order must be at least 1 (got {self.order})")
        if not 0.0 < self.forgetting <= 1.0 or not 0.0 < self.root_limit <= 1.0:
            raise ValueError("forgetting and root_limit must be above 0 and at most 1")
        if self.prior_var < 0.0 or self.noise_prior_var < 0.0:
            raise ValueError("variances must not be negative")


@compiled
def within(c: Array, radius: float) -> bool:
    """Return whether all roots of z^n + c_1 z^(n-1) + ... + c_n lie within a circle around 0 (Schur-Cohn, step-down recursion)."""
    n = c.shape[0]
    work, last = np.empty(n), np.empty(n)
    scale = 1.0
    for i in range(n):
        scale /= radius
        work[i] = c[i] * scale
    for m in range(n, 0, -1):
        k = work[m - 1]
        if not abs(k) < 1.0:
            return False
        last[:m] = work[:m]
        for i in range(m - 1):
            work[i] = (last[i] - k * last[m - 2 - i]) / (1.0 - k * k)
    return True


@compiled
def _residual(theta: Array, x: Array, y: float) -> float:
    for i in range(theta.shape[0]):
        y -= x[i] * theta[i]
    return y


@compiled
def step(
    theta: Array, P: Array, x: Array, phi: Array, forgetting: float, radius: float, residual: float, y_before: float, u_before: float,
    y: float,
) -> tuple[float, float, bool]:  # fmt: skip
    """Advance the estimate by one sample.

    Args:
        theta: (3n,) a_1 .. a_n, b_1 .. b_n, c_1 .. c_n, updated.
        P: (3n, 3n) updated.
        x: (3n,) regressor: -y, u, residuals, the newest first in each; updated.
        phi: (3n,) regressor filtered by 1/C, the gradient of the prediction; updated.
        forgetting, radius: lambda, and the limit for the roots of C.
        residual: of the previous sample, with the parameters updated by it: Kemp's "epsilon refinement".
        y_before, u_before, y: output and input of the previous sample, output of this sample.

    Returns:
        innovation, denominator of its gain lambda + phi' P phi, whether the roots of C are within the limit.

    """
    N = theta.shape[0]
    n = N // 3
    for block in range(3):
        first = block * n
        new = -y_before if block == 0 else u_before if block == 1 else residual
        filtered = new
        for i in range(n):
            filtered -= theta[2 * n + i] * phi[first + i]
        for i in range(n - 1, 0, -1):
            x[first + i], phi[first + i] = x[first + i - 1], phi[first + i - 1]
        x[first], phi[first] = new, filtered
    innovation = _residual(theta, x, y)
    v = np.zeros(N)
    denominator = forgetting
    for i in range(N):
        for j in range(N):
            v[i] += P[i, j] * phi[j]
        denominator += phi[i] * v[i]
    for i in range(N):
        theta[i] += v[i] / denominator * innovation
        for j in range(i, N):
            P[i, j] = (P[i, j] - v[i] / denominator * v[j]) / forgetting
            P[j, i] = P[i, j]
    return innovation, denominator, within(theta[2 * n :], radius)


def drawn_back(c: Array, radius: float) -> Array:
    """Return c_1 .. c_n after projecting the roots of z^n + c_1 z^(n-1) + ... beyond a radius onto it, at the same angle.

    The listing does this for n = 2 only.
    """
    roots = np.roots(np.concatenate([[1.0], c]))
    modulus = np.abs(roots)
    polynomial = np.poly(np.where(modulus > radius, roots * (radius / np.maximum(modulus, radius)), roots))
    return np.concatenate([np.real(polynomial[1:]), np.zeros(len(c) + 1 - len(polynomial))])


class Rml:
    """The recursion; owns its state. Its parameters are those of the observable-canonical form, eq (3.10), as for PLID.

    With an unstable plant the signals, and with them the estimate, overflow to nan: 1/C filters an unbounded signal.
    """

    def __init__(self, config: RmlConfig) -> None:
        n = config.order
        self.config = config
        self._theta, self._x, self._phi = np.zeros(3 * n), np.zeros(3 * n), np.zeros(3 * n)
        self._P = np.diag(np.repeat([config.prior_var, config.prior_var, config.noise_prior_var], n))
        self._y: float | None = None
        self._residual = 0.0
        self.innovation, self.projections = 0.0, 0

    def update(self, y: float, u_before: float) -> None:
        """Take the output of the next sample and the input since the previous one; the first sample is only stored."""
        last, self._y = self._y, y
        if last is None:
            return
        n, config = self.config.order, self.config
        self.innovation, _, sound = step(
            self._theta, self._P, self._x, self._phi, config.forgetting, config.root_limit, self._residual, last, u_before, y
        )  # fmt: skip
        if not sound and np.all(np.isfinite(self._theta)):
            self._theta[2 * n :] = drawn_back(self._theta[2 * n :], config.root_limit)
            self.projections += 1
        self._residual = _residual(self._theta, self._x, y)

    @property
    def parameters(self) -> Array:
        """a_0 ... a_(n-1), b_0 ... b_(n-1) of the observable-canonical form, (2n,): y(k) = sum a_(n-i) y(k-i) + b_(n-i) u(k-i)."""
        n = self.config.order
        return np.concatenate([-self._theta[n - 1 :: -1], self._theta[2 * n - 1 : n - 1 : -1]])

    @property
    def noise_parameters(self) -> Array:
        """c_1 ... c_n, (n,)."""
        return self._theta[2 * self.config.order :].copy()

    @property
    def covariance(self) -> Array:
        """P of (a_1 .., b_1 .., c_1 ..), (3n, 3n), in units of the variance of e."""
        return self._P.copy()
