"""Retrospective-cost reconstruction of an unknown input and the state (Gupta, D'Amato, Ali and Bernstein 2012).

A model runs in parallel with the plant, x^(k+1) = A x^(k) + B u^(k). An adaptive feedback of order n_c computes u^ from the past output
errors z = y - C x^ and its own past, u^(k) = theta(k) phi(k-1), so that z goes to 0; u^ then reconstructs the input of the plant. At each
sample the method computes the past inputs that would have given a smaller error (the retrospective optimum), and recursive least squares
moves theta towards gains that would have produced them. The only assumption about the input is that a linear system of order up to n_c
can generate it. If the zeros of the model are inside the unit circle, u^ converges; a zero outside hides an input that grows with it,
and the optimum must be kept small (regularization, saturation).

Corrections to the paper: past inputs enter z with a minus (9)-(12); (37) prints y for z, which (6) feeds back; (39) lacks a minus; the
left side of (30) is U*. ``estimation/reconstruction/retrospective_kernels.py`` contains the corrected equations.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from flightbed.estimation.reconstruction import retrospective_kernels as kernels
from flightbed.estimation.reconstruction.input_model import InputModel

Array = npt.NDArray[np.float64]

_RULES = {"constant": kernels.CONSTANT, "performance": kernels.PERFORMANCE, "error": kernels.ERROR}


@dataclass(frozen=True, eq=False)
class RetrospectiveConfig:
    """Settings. The defaults of ``delays`` and ``retained`` are those of the paper's examples: H~ = -C B, the last input is optimized.

    Attributes:
        order: n_c, order of the feedback.
        initial_covariance: gamma, P(0) = gamma I.
        delays: k_j of the s stacked performances z(k - k_j), 0 <= k_1 <= ... <= k_s.
        retained: for each delay, the i of the Markov parameters H_i whose inputs u^(k - k_j - i) are optimized; the others stay in S.
        fitted: optimized inputs that least squares fits: the oldest, as in (39), or all.
        performance_weight: R1 (s p, s p), or a number times the identity.
        input_weight: R2 (g m, g m), or a number times the identity.
        regularization: eta_0 >= 0.
        regularized_by: eta = eta_0; eta_0 |Z(k)|^2 (31); eta_0 |U*(k-2) - U^(k-2)|^2 (32).
        saturation: bounds of the optimized inputs (33), in the input's unit.
        forgetting: lambda of least squares, 0 < lambda <= 1.
        covariance_bound: mean of P's diagonal above which forgetting stops; not in the paper. Without the bound, P overflows eventually
            if forgetting < 1 and the input leaves directions unexcited, as a reconstructed input does.

    Raises:
        ValueError: a value is out of its range.

    """

    order: int
    initial_covariance: float = 1.0
    delays: tuple[int, ...] = (0,)
    retained: tuple[tuple[int, ...], ...] = ((1,),)
    fitted: Literal["oldest", "all"] = "oldest"
    performance_weight: Array | float = 1.0
    input_weight: Array | float = 1.0
    regularization: float = 0.0
    regularized_by: Literal["constant", "performance", "error"] = "constant"
    saturation: tuple[float, float] = (-np.inf, np.inf)
    forgetting: float = 1.0
    covariance_bound: float = np.inf

    def __post_init__(self) -> None:
        for holds, problem in (
            (self.order >= 1, f"order must be at least 1 (got {self.order})"),
            (self.initial_covariance > 0.0, f"initial_covariance must be positive (got {self.initial_covariance})"),
            (0.0 < self.forgetting <= 1.0, f"forgetting must be in (0, 1] (got {self.forgetting})"),
            (
                self.covariance_bound >= self.initial_covariance,
                f"covariance_bound must be at least initial_covariance (got {self.covariance_bound})",
            ),
            (self.regularization >= 0.0, f"regularization must not be negative (got {self.regularization})"),
            (self.saturation[0] < self.saturation[1], f"saturation must be (low, high) (got {self.saturation})"),
            (
                min(self.delays, default=-1) >= 0 and list(self.delays) == sorted(self.delays),
                f"delays must be 0 <= k_1 <= ... <= k_s (got {self.delays})",
            ),
            (
                len(self.retained) == len(self.delays) and all(self.retained) and min(map(min, self.retained)) >= 1,
                f"retained must name at least one H_i, i >= 1, for each of {len(self.delays)} delays (got {self.retained})",
            ),
        ):
            if not holds:
                raise ValueError(problem)

    @property
    def lags(self) -> tuple[int, ...]:
        """Lags q_1 < ... < q_g: the optimized inputs are u^(k - q_i), eq (20)."""
        return tuple(sorted({k + i for k, which in zip(self.delays, self.retained, strict=True) for i in which}))


class Reconstruction(NamedTuple):
    """Reconstruction at a sample.

    Attributes:
        input: (m,) u^(k), the input of the period that starts now; from outputs up to y(k).
        state: (n,) x^(k), from outputs up to y(k-1).
        performance: (p,) z(k) = y(k) - C x^(k).
        optimum: (g, m) U*, the retrospectively optimized inputs u*(k - q_1), u*(k - q_2) ...

    """

    input: Array
    state: Array
    performance: Array
    optimum: Array


class RetrospectiveCost:
    """Reconstruction of the input of a model; owns its state. Takes one output per sample, in order.

    Args:
        config: settings.
        model: model of the first sample, and default of the later ones.
        state: (n,) x^(0); zeros if None.

    Raises:
        ValueError: weights or state have a wrong shape; weights are not positive definite; or no unique optimum exists, eq (27): H~ lacks
            full column rank and eta is 0, or lacks full rank and eta follows a quantity that can be 0.

    """

    def __init__(self, config: RetrospectiveConfig, model: InputModel, state: Array | None = None) -> None:
        self._config, self._model = config, model
        n, m, p = model.states, model.inputs, model.outputs
        lags, order = config.lags, config.order
        s, g, r = len(config.delays), len(lags), max(map(max, config.retained))
        self._weights = (
            _weight("performance_weight", config.performance_weight, s * p),
            _weight("input_weight", config.input_weight, g * m),
        )
        retained = np.array([[int(i + 1 in which) for i in range(r)] for which in config.retained])
        fitted = [g - 1] if config.fitted == "oldest" else list(range(g))
        self._shape = (np.array(config.delays), retained, np.array(lags), np.array(fitted))
        x = np.zeros(n) if state is None else np.array(state, dtype=np.float64)
        if x.shape != (n,):
            raise ValueError(f"the initial state has shape {x.shape}, the model {n} states")
        length = order * (m + p)
        self._x = x
        self._theta = np.zeros((m, length))
        self._P = config.initial_covariance * np.eye(length)
        self._U, self._Z = np.zeros((lags[-1] + order, m)), np.zeros((lags[-1] + order + 1, p))
        # Before the first sample the model is assumed equal to that of the first sample.
        self._As, self._Bs = np.tile(model.A, (r, 1, 1)), np.tile(model.B, (r, 1, 1))
        self._H = np.tile(model.markov(r), (config.delays[-1] + 1, 1, 1, 1))
        self._numbers = np.array(
            [config.regularization, config.forgetting, *config.saturation, config.covariance_bound, 0.0, 0.0]
        )
        wide, _, _ = kernels.stack(self._H, self._Z, self._U, *self._shape[:3])
        rank, eta = int(np.linalg.matrix_rank(wide)), config.regularization
        if (eta == 0.0 and rank < g * m) or (config.regularized_by != "constant" and rank < min(wide.shape)):
            raise ValueError(
                f"no unique optimum: H~ {wide.shape} has rank {rank}; regularize by a constant, retain fewer inputs, or stack "
                "more performances"
            )

    @property
    def gains(self) -> Array:
        """Return a copy of theta (m, n_c (m + p)) = [M_1 ... M_nc | N_1 ... N_nc], eq (36)."""
        return self._theta.copy()

    @property
    def covariance(self) -> Array:
        """Return a copy of P (n_c (m + p), n_c (m + p)) of least squares."""
        return self._P.copy()

    def update(
        self, y: Array, known: Array | None = None, *, model: InputModel | None = None, adapt: bool = True
    ) -> Reconstruction:
        """Take the output of the next sample; return the reconstruction.

        Args:
            y: (p,) output.
            known: (l,) known input over the period that starts now; None if the model has none.
            model: model of this sample: C of this sample, A, B, G of the period that starts now; sizes as in the first model.
            adapt: beta of (39): whether least squares runs; if False, theta and P stay.

        """
        model = self._model if model is None else model
        state = self._x.copy()
        memory = (self._x, self._theta, self._P, self._U, self._Z, self._H, self._As, self._Bs)
        z, optimum = kernels.take(
            np.atleast_1d(np.asarray(y, dtype=np.float64)), (model.A, model.B, model.C), model.known_part(known), memory,
            self._shape, self._weights, self._numbers, self._config.order, _RULES[self._config.regularized_by], adapt,
        )  # fmt: skip
        return Reconstruction(self._U[0].copy(), state, z, optimum.reshape(-1, model.inputs))


def _weight(name: str, given: Array | float, size: int) -> Array:
    weight = np.asarray(given, dtype=np.float64)
    weight = float(weight) * np.eye(size) if weight.ndim == 0 else np.ascontiguousarray(weight)
    if weight.shape != (size, size):
        raise ValueError(f"{name} must be ({size}, {size}) (got {weight.shape})")
    if not np.array_equal(weight, weight.T) or np.linalg.eigvalsh(weight)[0] <= 0.0:
        raise ValueError(f"{name} must be symmetric and positive definite")
    return weight
