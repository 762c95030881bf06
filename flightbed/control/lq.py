"""Discrete linear-quadratic regulator and servo, redesigned for the remaining effectiveness of the inputs (Wu and others 2000, S 4).

The regulator is the steady-state solution for x+ = A x + B (I + Gamma) u, W eqs (47)-(49), with the estimated Gamma = diag(gamma); the
servo adds the sum of the tracking error as states (Kwakernaak and Sivan 1972, S 6.4). W is N. E. Wu, Y. Zhang, K. Zhou, Int. J.
Adaptive Control and Signal Processing 14 (2000) 775. A change of gains steps the inputs; ``LqServo`` absorbs this step in the integrators
as far as possible and lets the rest decay. This bumpless transfer is an addition to W.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from flightbed.core.errors import DesignError

Array = npt.NDArray[np.float64]


def lq_gain(A: Array, B: Array, Q: Array, R: Array) -> Array:
    """Return F (l, n) of u = -F x that minimizes the sum of x'Q x + u'R u for x+ = A x + B u.

    Args:
        A, B: (n, n) and (n, l).
        Q, R: (n, n), positive semidefinite, and (l, l), positive definite.

    Raises:
        DesignError: no stabilizing solution exists, or R is not positive definite.

    """
    from scipy.linalg import solve_discrete_are  # slow to import

    if np.linalg.eigvalsh(R)[0] <= 0.0:
        raise DesignError(f"LQ design: the weight of the inputs must be positive definite (got {R.tolist()})")
    try:
        P = solve_discrete_are(A, B, Q, R)
    except (np.linalg.LinAlgError, ValueError) as error:
        raise DesignError(
            f"LQ design: no stabilizing gain for these weights and this effectiveness ({error})"
        ) from error
    F = np.asarray(np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A), dtype=np.float64)
    radius = spectral_radius(A - B @ F)
    if not radius < 1.0:
        raise DesignError(
            f"LQ design: the closed loop is not stable (got spectral radius {radius:.6g}); give every unstable state a weight"
        )
    return F


def spectral_radius(M: Array) -> float:
    """Return the largest modulus of the eigenvalues; x+ = M x is stable if it is below 1."""
    return float(np.max(np.abs(np.linalg.eigvals(M))))


def redesign(A: Array, B: Array, Q: Array, R: Array, effectiveness: Array) -> Array:
    """Return F for inputs with this effectiveness: W eqs (47)-(49), weights unchanged.

    Args:
        A, B, Q, R: as in ``lq_gain``; B of the healthy inputs. With weights Q_c on outputs y = C x, Q = C' Q_c C.
        effectiveness: (l,), K = 1 + gamma, not negative.

    Raises:
        DesignError: the remaining inputs do not stabilize the system, or an effectiveness is negative.

    """
    return lq_gain(A, B * _left(effectiveness), Q, R)


def offset_weights(R: Array, effectiveness: Array) -> Array:
    """Return the input weight that offsets a loss, (I + Gamma) R (I + Gamma): W's remark after eq (49), made explicit.

    The cost of an effect then equals its cost on the healthy system: the redesigned F is (I + Gamma)^-1 times the healthy F, and the
    closed loop is that of the healthy system as long as no input saturates.

    Raises:
        DesignError: an effectiveness is not positive.

    """
    left = _left(effectiveness)
    if np.min(left) <= 0.0:
        raise DesignError(
            f"LQ design: no weight offsets the total loss of an input (got effectiveness {left.tolist()}); keep all above 0"
        )
    return R * np.outer(left, left)


def _left(effectiveness: Array) -> Array:
    left = np.asarray(effectiveness, dtype=np.float64)
    if not np.all(left >= 0.0):
        raise DesignError(f"LQ design: effectiveness must not be negative (got {left.tolist()})")
    return left


def with_integrators(A: Array, B: Array, tracked: Array) -> tuple[Array, Array]:
    """Return A and B of (x, z) with z+ = z - H x, where H (p, n) are the outputs that track a reference."""
    (n, inputs), p = B.shape, len(tracked)
    return np.block([[A, np.zeros((n, p))], [-tracked, np.eye(p)]]), np.vstack([B, np.zeros((p, inputs))])


@dataclass(frozen=True, eq=False)
class LqConfig:
    """Model and weights of an LQ law. n states, l inputs, p tracked outputs.

    Attributes:
        A, B: (n, n) and (n, l), of the healthy system over a sample.
        Q, R: weights of state and inputs, (n, n) and (l, l).
        tracked: (p, n), outputs that track a reference by integral action; (0, n) for a regulator.
        Q_integral: (p, p), weight of the summed tracking errors.
        fade: factor per sample, in [0, 1), by which the part of a redesign's step that the integrators cannot absorb decays.

    """

    A: Array
    B: Array
    Q: Array
    R: Array
    tracked: Array
    Q_integral: Array
    fade: float = 0.0

    def __post_init__(self) -> None:
        if not 0.0 <= self.fade < 1.0:
            raise ValueError(f"fade: must be in [0, 1) (got {self.fade:g})")

    def weights(self) -> Array:
        """Return the weight of (x, z), (n + p, n + p)."""
        n, p = len(self.A), len(self.tracked)
        return np.block([[self.Q, np.zeros((n, p))], [np.zeros((p, n)), self.Q_integral]])


def regulator(A: Array, B: Array, Q: Array, R: Array, *, fade: float = 0.0) -> LqConfig:
    """Return the configuration of a law without integral action; arguments as in ``LqConfig``."""
    return LqConfig(A, B, Q, R, np.zeros((0, len(A))), np.zeros((0, 0)), fade)


class LqServo:
    """u = -F x - F_z z + v + decaying steps of past redesigns; z+ = z + r - H x.

    Args:
        config: model and weights.

    Raises:
        DesignError: no such law exists.

    """

    def __init__(self, config: LqConfig) -> None:
        self._config = config
        self._A, self._B = with_integrators(config.A, config.B, config.tracked)
        self._gain = lq_gain(self._A, self._B, config.weights(), config.R)
        self._next = self._gain
        self._z, self._bump = np.zeros(len(config.tracked)), np.zeros(config.B.shape[1])

    @property
    def gain(self) -> Array:
        """Gain [F, F_z] (l, n + p) of the next command."""
        return self._next

    def redesign(self, effectiveness: Array, *, R: Array | None = None) -> None:
        """Redesign the law for the next command.

        Args:
            effectiveness: (l,), estimated K of every input.
            R: weight of the inputs, as from ``offset_weights``; the configured one if None.

        Raises:
            DesignError: no stabilizing law exists; the previous law stays.

        """
        config = self._config
        self._next = redesign(self._A, self._B, config.weights(), config.R if R is None else R, effectiveness)

    def command(self, state: Array, *, reference: Array | None = None, external: Array | None = None) -> Array:
        """Return u (l,) and advance the integrators.

        Args:
            state: (n,), x or its estimate.
            reference: (p,), reference of the tracked outputs; zero if None.
            external: (l,), v, added to the inputs; zero if None.

        """
        n = len(state)
        if self._next is not self._gain:
            step = (self._next - self._gain) @ np.append(state, self._z)
            self._gain, self._bump = self._next, self._bump + step
            F_z = self._gain[:, n:]
            moved = -np.linalg.pinv(F_z) @ self._bump
            self._z, self._bump = self._z + moved, self._bump + F_z @ moved
        self._bump = self._config.fade * self._bump
        u = -self._gain @ np.append(state, self._z) + self._bump
        asked = np.zeros(len(self._z)) if reference is None else reference
        self._z = self._z + asked - self._config.tracked @ state
        return u if external is None else u + external
