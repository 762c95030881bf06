"""The optimal two-stage Kalman filter with forgetting: state and control effectiveness of every input (Wu, Zhang and Zhou 2000).

The system has inputs with a partial loss of effectiveness, W eqs (1)-(8):

    x+ = A x + B (I + diag gamma) u + c + w,   y = C x + v,   gamma+ = gamma + w_gamma,   gamma in [-1, 0].

The first filter estimates the state without gamma, the second estimates gamma from the residuals of the first, and V couples them. Without
forgetting this equals the Kalman filter of (x, gamma), with inversions of l x l and m x m matrices only. Forgetting increases the
covariance of gamma between samples: by one factor, or along each of its principal axes until the variance lies between bounds.

Source: N. E. Wu, Y. Zhang, K. Zhou, Int. J. Adaptive Control and Signal Processing 14 (2000) 775, "W" here; the filter is that of Keller
and Darouach, Automatica 33 (1997) 1745. Departures from the paper: the second of its two equations (15) is the correction; (25) has a stray
plus; the known affine term c is an addition; the covariance updates are in forms that keep them symmetric and positive (Joseph), otherwise
equal to (13), (15) and (17).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from flightbed.core.compiled import Array, compiled


@dataclass(frozen=True)
class NoForgetting:
    """Covariance of gamma as in W eq (10)."""

    def packed(self) -> Array:
        """Return the argument ``forgetting`` of ``forget``, (3,)."""
        return np.array([1.0, 0.0, 0.0])


@dataclass(frozen=True)
class ConstantForgetting:
    """Constant factor in all directions, W eq (28).

    Attributes:
        factor: lambda, in (0, 1].

    """

    factor: float

    def __post_init__(self) -> None:
        if not 0.0 < self.factor <= 1.0:
            raise ValueError(f"forgetting factor: must be in (0, 1] (got {self.factor:g})")

    def packed(self) -> Array:
        """Return the argument ``forgetting`` of ``forget``, (3,)."""
        return np.array([self.factor, 0.0, 0.0])


@dataclass(frozen=True)
class VariableForgetting:
    """A factor for each principal axis of the covariance, smaller for a smaller variance along it, W eqs (29)-(32).

    Without noise of gamma (Q_gamma = 0), a variance below ``variance_max`` moves between the two bounds and stays there; a variance above,
    such as that of a wide prior, is not changed, and only measurements reduce it. With noise of gamma the lower bound still holds, and
    the variances exceed the upper bound by this noise.

    Attributes:
        variance_min: alpha_min, lower bound of the variances between samples.
        variance_max: alpha_max, variance above which there is no forgetting.

    """

    variance_min: float
    variance_max: float

    def __post_init__(self) -> None:
        if not 0.0 < self.variance_min < self.variance_max < np.inf:
            text = f"{self.variance_min:g} and {self.variance_max:g}"
            raise ValueError(f"bounds of the variance: must be positive, finite and ascending (got {text})")

    def packed(self) -> Array:
        """Return the argument ``forgetting`` of ``forget``, (3,)."""
        return np.array([1.0, self.variance_min, self.variance_max])


Forgetting = NoForgetting | ConstantForgetting | VariableForgetting


@compiled
def forget(P: Array, forgetting: Array) -> Array:
    """Return the covariance of gamma after forgetting, before its noise is added: P / lambda or the sum in W eq (31).

    Args:
        P: (l, l).
        forgetting: (3,), constant factor, and lower and upper variance of variable forgetting (0 and 0: constant).

    """
    factor, low, high = forgetting
    if high <= 0.0:
        faded: Array = P / factor
        return faded
    values, vectors = np.linalg.eigh(P)
    raised = np.empty_like(values)
    for i in range(values.size):  # alpha / lambda, computed from eq (32) without a division by alpha
        alpha = values[i]
        raised[i] = alpha if alpha > high else low + (high - low) / high * max(alpha, 0.0)
    adjusted: Array = (vectors * raised) @ vectors.T
    return adjusted


@compiled
def predict(
    x: Array,
    V: Array,
    Px: Array,
    gamma: Array,
    Pg: Array,
    A: Array,
    B: Array,
    u: Array,
    c: Array,
    Qx: Array,
    Qg: Array,
    forgetting: Array,
) -> tuple[Array, Array, Array, Array]:
    """Advance the two stages by a sample: W eqs (9), (10) or (31), (14), the first (15), (20), (21).

    Returns the predicted x~, V, P~ and covariance of gamma; gamma does not change. The covariance that V transfers from the first stage,
    W (P - P P-^-1 P) W', is written as a sum of positive terms.
    """
    W = A @ V + B * u
    ahead = forget(Pg, forgetting) + Qg
    share = np.linalg.solve(ahead, Pg).T  # P P-^-1
    rest = np.eye(Pg.shape[0]) - share
    lost = rest @ Pg @ rest.T + share @ (ahead - Pg) @ share.T
    V_ahead = W @ share
    x_ahead = A @ x + B @ u + c + (W - V_ahead) @ gamma
    Px_ahead = A @ Px @ A.T + Qx + W @ lost @ W.T
    return x_ahead, V_ahead, 0.5 * (Px_ahead + Px_ahead.T), 0.5 * (ahead + ahead.T)


@compiled
def correct(
    x: Array, V: Array, Px: Array, gamma: Array, Pg: Array, C: Array, R: Array, y: Array
) -> tuple[Array, Array, Array, Array, Array, Array, Array, float]:
    """Correct both stages by the readings: W eqs (11)-(13), the second (15), (16)-(19), (22), (23).

    Returns the corrected x~, V, P~, gamma and covariance of gamma; innovation of the whole filter, its covariance, NIS.
    """
    residual, H = y - C @ x, C @ V
    S_first = C @ Px @ C.T + R
    K = np.linalg.solve(S_first, C @ Px).T
    innovation = residual - H @ gamma
    S = H @ Pg @ H.T + S_first
    K_gamma = np.linalg.solve(S, H @ Pg).T
    kept = np.eye(Pg.shape[0]) - K_gamma @ H
    Pg_new = kept @ Pg @ kept.T + K_gamma @ S_first @ K_gamma.T
    kept = np.eye(Px.shape[0]) - K @ C
    Px_new = kept @ Px @ kept.T + K @ R @ K.T
    nis = float(innovation @ np.linalg.solve(S, innovation))
    return (
        x + K @ residual, V - K @ H, 0.5 * (Px_new + Px_new.T), gamma + K_gamma @ innovation, 0.5 * (Pg_new + Pg_new.T),
        innovation, S, nis,
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class TwoStageConfig:
    """Settings of the filter. n states, l inputs, m readings; covariances over one sample, in the units of the system.

    Attributes:
        Q: (n, n) covariance of the process noise.
        R: (m, m) covariance of the readings, positive definite.
        Q_gamma: (l, l) covariance of the random walk of gamma per sample.
        state, state_covariance: (n,) and (n, n), prior of the state.
        gamma, gamma_covariance: (l,) and (l, l), prior of gamma; the covariance is positive definite.
        forgetting: forgetting of gamma.

    Raises:
        ValueError: a covariance has a wrong shape, is not symmetric, or is not positive (semi)definite.

    """

    Q: Array
    R: Array
    Q_gamma: Array
    state: Array
    state_covariance: Array
    gamma: Array
    gamma_covariance: Array
    forgetting: Forgetting = NoForgetting()

    def __post_init__(self) -> None:
        n, m, inputs = len(self.state), len(self.R), len(self.gamma)
        for name, size in (
            ("Q", n),
            ("state_covariance", n),
            ("R", m),
            ("Q_gamma", inputs),
            ("gamma_covariance", inputs),
        ):
            value = np.asarray(getattr(self, name))
            if value.shape != (size, size):
                raise ValueError(f"{name}: must have the shape {(size, size)} (got {value.shape})")
            if not np.allclose(value, value.T):
                raise ValueError(f"{name}: must be symmetric (got {value.tolist()})")
            least = float(np.linalg.eigvalsh(value)[0])
            strict = name in ("R", "gamma_covariance")
            if least < -1e-12 * np.max(np.abs(value)) or (strict and least <= 0.0):
                raise ValueError(
                    f"{name}: must be positive {'' if strict else 'semi'}definite (got least eigenvalue {least:g})"
                )


class TwoStageEstimate(NamedTuple):
    """Estimate after a correction.

    Attributes:
        gamma: (l,), gamma-hat; not bounded to [-1, 0].
        gamma_covariance: (l, l).
        state: (n,), the compensated state, W eq (24).
        state_covariance: (n, n), its covariance, W eq (25).
        innovation, innovation_covariance: (m,) and (m, m), of the whole filter, the covariance as predicted; 0 before the first correction.
        nis: normalized innovation squared, chi-square with m degrees of freedom if the model holds; 0 before the first correction.

    """

    gamma: Array
    gamma_covariance: Array
    state: Array
    state_covariance: Array
    innovation: Array
    innovation_covariance: Array
    nis: float

    @property
    def effectiveness(self) -> Array:
        """K-hat = 1 + gamma-hat, (l,)."""
        return 1.0 + self.gamma


class TwoStageFilter:
    """The filter: ``predict`` over a sample, ``correct`` by the readings at its end, or ``step`` for both.

    Args:
        config: noise, prior, forgetting.

    """

    def __init__(self, config: TwoStageConfig) -> None:
        self._Q, self._R, self._Q_gamma = _matrix(config.Q), _matrix(config.R), _matrix(config.Q_gamma)
        self._forgetting = config.forgetting.packed()
        n, inputs, m = len(config.state), len(config.gamma), len(config.R)
        self._still = np.zeros(n)
        # With V = 0 the state and covariance of the first stage are those of the prior.
        self._x, self._V, self._Px = _matrix(config.state), np.zeros((n, inputs)), _matrix(config.state_covariance)
        self._gamma, self._Pg = _matrix(config.gamma), _matrix(config.gamma_covariance)
        self._innovation, self._S, self._nis = np.zeros(m), np.zeros((m, m)), 0.0

    def predict(self, A: Array, B: Array, u: Array, drift: Array | None = None, Q: Array | None = None) -> None:
        """Advance over a sample.

        Args:
            A, B: (n, n) and (n, l), model over the sample.
            u: (l,), inputs over the sample.
            drift: (n,), known affine term c; zero if None.
            Q: (n, n), covariance of the process noise over this sample; the configured one if None.

        """
        Qx = self._Q if Q is None else _matrix(Q)
        c = self._still if drift is None else _matrix(drift)
        self._x, self._V, self._Px, self._Pg = predict(
            self._x, self._V, self._Px, self._gamma, self._Pg, _matrix(A), _matrix(B), _matrix(u), c,
            Qx, self._Q_gamma, self._forgetting,
        )  # fmt: skip

    def correct(self, C: Array, y: Array) -> TwoStageEstimate:
        """Take the readings y (m,) of C x, C (m, n), and return the estimate that includes them."""
        self._x, self._V, self._Px, self._gamma, self._Pg, self._innovation, self._S, self._nis = correct(
            self._x, self._V, self._Px, self._gamma, self._Pg, _matrix(C), self._R, _matrix(y)
        )
        return self.estimate

    def step(
        self, A: Array, B: Array, C: Array, u: Array, y: Array, drift: Array | None = None, Q: Array | None = None
    ) -> TwoStageEstimate:
        """Predict over a sample with inputs u and correct by the readings y at its end; arguments as in ``predict`` and ``correct``."""
        self.predict(A, B, u, drift, Q)
        return self.correct(C, y)

    @property
    def estimate(self) -> TwoStageEstimate:
        """Present estimate, W eqs (24) and (25); the prior before the first correction."""
        state, covariance = self._x + self._V @ self._gamma, self._Px + self._V @ self._Pg @ self._V.T
        return TwoStageEstimate(
            self._gamma.copy(), self._Pg.copy(), state, covariance, self._innovation.copy(), self._S.copy(), self._nis
        )


def _matrix(value: Array) -> Array:
    return np.ascontiguousarray(value, dtype=np.float64)
