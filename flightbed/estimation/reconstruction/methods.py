"""The two methods that reconstruct an unknown deflection from (alpha, q): settings, and propagation of their error from tick to tick.

Readings are in standard deviations of their sensors and the deflection in deg, which sets the scale of weights, regularization and initial
covariance.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from flightbed.core.compiled import Array
from flightbed.core.units import DEG
from flightbed.estimation.reconstruction.input_kalman import InputKalmanFilter, random_walk
from flightbed.estimation.reconstruction.input_model import InputModel
from flightbed.estimation.reconstruction.retrospective_cost import RetrospectiveConfig, RetrospectiveCost

_KNOWN = np.ones(1)
NOTHING = 1e6  # variance of an unknown state: the state starts at the first reading, which must not count twice


@dataclass(frozen=True)
class RetrospectiveSettings:
    """Settings of the retrospective cost on the aircraft, converted by ``config`` into a ``RetrospectiveConfig``.

    Attributes:
        order: n_c, order of the adaptive feedback.
        horizon: number of samples whose inputs are optimized together, of stacked performances and of retained Markov parameters.
        regularization: eta_0, constant, in variances of a reading per deg^2.
        forgetting: lambda of its least squares.
        saturation_rad: bound of the magnitude of the optimized inputs.
        initial_covariance: gamma; also the mean variance above which forgetting stops.

    """

    order: int = 4
    horizon: int = 6
    regularization: float = 1.0
    forgetting: float = 1.0
    saturation_rad: float = 30.0 * DEG
    initial_covariance: float = 0.01

    def config(self, unit: float) -> RetrospectiveConfig:
        """Return the settings of the method for an input in units of ``unit`` rad."""
        bound = self.saturation_rad / unit
        return RetrospectiveConfig(
            order=self.order,
            initial_covariance=self.initial_covariance,
            delays=tuple(range(self.horizon)),
            retained=tuple(tuple(range(1, self.horizon - delay + 1)) for delay in range(self.horizon)),
            fitted="all",
            regularization=self.regularization,
            saturation=(-bound, bound),
            forgetting=self.forgetting,
            covariance_bound=self.initial_covariance if self.forgetting < 1.0 else np.inf,
        )


@dataclass(frozen=True)
class WalkSettings:
    """Settings of the Kalman filter.

    Attributes:
        step_rad: standard deviation of the step of u per tick.
        initial_rad: standard deviation of u at the start.

    """

    step_rad: float = 0.1 * DEG
    initial_rad: float = 10.0 * DEG


class InputReconstruction(NamedTuple):
    """Reconstruction at a tick, in deg and standard deviations of the sensors.

    Attributes:
        input: u^.
        state: (2,) alpha and q.
        innovation: (2,) readings minus their prediction.
        F, G: (n, n), (n, 2): propagation of the method's error, as in ``regression_kernels.follow``.

    """

    input: float
    state: Array
    innovation: Array
    F: Array
    G: Array


class Method(Protocol):
    """A method of reconstruction; owns its state. Its error has ``states`` components."""

    states: int

    def begin(self, model: InputModel, y: Array) -> None:
        """Set the state to the readings y (2,) of a tick."""

    def take(self, model: InputModel, y: Array) -> InputReconstruction:
        """Take the readings y (2,) of the next tick; the model is that of the period that starts there."""


class RetrospectiveCostMethod:
    """Reconstruction by retrospective cost; the state of its error is (e, last n_c u^, last n_c z), newest first."""

    def __init__(self, config: RetrospectiveConfig) -> None:
        self._config, self.states = config, 2 + 3 * config.order
        self._cost: RetrospectiveCost | None = None
        n, nc = self.states, config.order
        self._F, self._G = np.zeros((n, n)), np.zeros((n, 2))
        for i in range(3, 2 + nc):
            self._F[i, i - 1] = 1.0
        for i in range(4 + nc, n):
            self._F[i, i - 2] = 1.0
        self._newest = slice(2 + nc, 4 + nc)

    @property
    def propagation(self) -> tuple[Array, Array]:
        """Propagation of the error before the first reading, F and G of ``InputReconstruction``."""
        F, G = self._F.copy(), self._G.copy()
        F[self._newest, :2] = G[self._newest] = 0.0
        return F, G

    def begin(self, model: InputModel, y: Array) -> None:
        """Restart from the readings."""
        self._cost = RetrospectiveCost(self._config, model, state=y)
        self._F[self._newest, :2] = self._G[self._newest] = 0.0  # the first z is 0 at any error of the readings

    def take(self, model: InputModel, y: Array) -> InputReconstruction:
        """Take the readings of the next tick; the method has no model of their noise."""
        assert self._cost is not None
        found = self._cost.update(y, _KNOWN, model=model)
        F, theta = self._F, self._cost.gains
        F[:2, :2], F[2, 2:] = model.A, theta[0]
        F[:2, 2:] = -model.B @ theta
        reconstruction = InputReconstruction(
            float(found.input[0]), found.state, found.performance, F.copy(), self._G.copy()
        )
        F[self._newest, :2] = self._G[self._newest] = np.eye(2)
        return reconstruction


class RandomWalkMethod:
    """Reconstruction by a Kalman filter of (x, u); the state of its error is (e, u^).

    Args:
        settings: settings of the random walk.
        process: (2,) variances of the disturbances of alpha and q per tick.

    """

    states = 3

    def __init__(self, settings: WalkSettings, process: Array) -> None:
        walk = random_walk(1, step_std=settings.step_rad / DEG, initial_std=settings.initial_rad / DEG)
        self._dynamics, self._process = walk, np.diag(process)
        self._filter: InputKalmanFilter | None = None

    def begin(self, model: InputModel, y: Array) -> None:
        """Restart from the readings."""
        self._filter = InputKalmanFilter(
            self._dynamics, model, process=self._process, noise=np.eye(2), state_covariance=NOTHING * np.eye(2), state=y
        )

    def take(self, model: InputModel, y: Array) -> InputReconstruction:
        """Take the readings of the next tick."""
        assert self._filter is not None
        found = self._filter.update(y, _KNOWN, model=model)
        gain = self._filter.gain
        ahead = np.eye(3)
        ahead[:2, :2], ahead[:2, 2] = model.A, -model.B[:, 0]
        corrected = np.eye(3)
        corrected[:2, :2] -= gain[:2]
        corrected[2, :2] = gain[2]
        given = np.vstack([-gain[:2], gain[2:]])
        return InputReconstruction(
            float(found.input[0]), found.state, found.innovation, ahead @ corrected, ahead @ given
        )
