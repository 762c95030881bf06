"""Discrete linear-quadratic regulator and servo, redesigned for the effectiveness that the inputs have left (Wu and others 2000, S 4).

The regulator is the steady-state solution for x+ = A x + B (I + Gamma) u, W eqs (47)-(49), with Gamma = diag(gamma) as estimated; the
servo has the sum of the tracking error as further states (Kwakernaak and Sivan 1972, S 6.4). W is N. E. Wu, Y. Zhang, K. Zhou, Int. J.
Adaptive Control and Signal Processing 14 (2000) 775. New gains would make the inputs step; ``LqServo`` moves that step into the
integrators where it can, and lets the rest fade, which is ours.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from flightbed.errors import DesignError

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
            f"LQ design: the loop would not be stable (spectral radius {radius:.6g}); weight every unstable state"
        )
    return F


def spectral_radius(M: Array) -> float:
    """Return the largest magnitude of an eigenvalue; below 1 if x+ = M x is stable."""
    return float(np.max(np.abs(np.linalg.eigvals(M))))


def redesign(A: Array, B: Array, Q: Array, R: Array, effectiveness: Array) -> Array:
    """Return F for inputs of which so much is left: W eqs (47)-(49), weights unchanged.

    Args:
        A, B, Q, R: as in ``lq_gain``; B of the healthy inputs. With weights Q_c on outputs y = C x, Q = C' Q_c C.
        effectiveness: (l,), K = 1 + gamma, not negative.

    Raises:
        DesignError: the inputs that are left do not stabilize the system, or an effectiveness is negative.

    """
    return lq_gain(A, B * _left(effectiveness), Q, R)


def offset_weights(R: Array, effectiveness: Array) -> Array:
    """Return the weight of the inputs that offsets a loss, (I + Gamma) R (I + Gamma): W's remark after eq (49), made definite.

    What an input does then costs what it did before: the redesigned F is (I + Gamma)^-1 times the healthy one, and the loop that of the
    healthy system as long as no input saturates. Raises DesignError for an input without any effect.
    """
    left = _left(effectiveness)
    if np.min(left) <= 0.0:
        raise DesignError(
            f"LQ design: no weight offsets the loss of an input altogether (effectiveness {left.tolist()})"
        )
    return R * np.outer(left, left)


def _left(effectiveness: Array) -> Array:
    left = np.asarray(effectiveness, dtype=np.float64)
    if not np.all(left >= 0.0):
        raise DesignError(f"LQ design: effectiveness must not be negative (got {left.tolist()})")
    return left


def with_integrators(A: Array, B: Array, tracked: Array) -> tuple[Array, Array]:
    """Return A and B of (x, z) with z+ = z - H x, H (p, n) the outputs that have to follow a reference."""
    (n, inputs), p = B.shape, len(tracked)
    return np.block([[A, np.zeros((n, p))], [-tracked, np.eye(p)]]), np.vstack([B, np.zeros((p, inputs))])


@dataclass(frozen=True, eq=False)
class LqConfig:
    """Model and weights of an LQ law. n states, l inputs, p tracked outputs.

    Attributes:
        A, B: (n, n) and (n, l), of the healthy system over a sample.
        Q, R: weights of state and inputs, (n, n) and (l, l).
        tracked: (p, n), outputs that follow a reference by integral action; (0, n) makes a regulator.
        Q_integral: (p, p), weight of the summed tracking errors.
        fade: in [0, 1): what of the step that new gains make of u, and integrators cannot take, is left from a sample to the next.

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
    """Return the configuration of a law without integral action; arguments as of ``LqConfig``."""
    return LqConfig(A, B, Q, R, np.zeros((0, len(A))), np.zeros((0, 0)), fade)


class LqServo:
    """u = -F x - F_z z + v + what is left of the steps of redesigns; z+ = z + r - H x.

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
        """The gain [F, F_z] (l, n + p) from the next command on."""
        return self._next

    def redesign(self, effectiveness: Array, *, R: Array | None = None) -> None:
        """Design the law anew, from the next command on.

        Args:
            effectiveness: (l,), K of every input as estimated.
            R: weight of the inputs, as of ``offset_weights``; the configured one if None.

        Raises:
            DesignError: no such law exists; the old one stays.

        """
        config = self._config
        self._next = redesign(self._A, self._B, config.weights(), config.R if R is None else R, effectiveness)

    def command(self, state: Array, *, reference: Array | None = None, external: Array | None = None) -> Array:
        """Return u (l,) and advance the integrators.

        Args:
            state: (n,), x or its estimate.
            reference: (p,), of the tracked outputs; zero if None.
            external: (l,), v, what is added to the inputs; zero if None.

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
