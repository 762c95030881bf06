"""Settings of the estimators that reconstruct an unknown input."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Annotated, Any, ClassVar, Literal

from flightbed.avionics.onboard import OnBoard
from flightbed.config.kinds import EffectivenessPrior, EstimatorSettings
from flightbed.config.table import NonNegative, Positive, between, only_with
from flightbed.core.units import DEG
from flightbed.estimation.reconstruction.elevator import ElevatorReconstruction, ReconstructionConfig
from flightbed.estimation.reconstruction.gust import GustConfig, GustReconstruction
from flightbed.estimation.reconstruction.methods import RetrospectiveSettings, WalkSettings
from flightbed.estimation.reconstruction.regression import FollowingConfig


class _Reconstruction(EstimatorSettings):
    """Keys of both methods; most concern the elevator's effectiveness and its test."""

    reads_accelerometer: ClassVar[bool] = False

    on_short_period: ClassVar[Mapping[str, Any]] = MappingProxyType(
        {"follow_disturbances": False, "alpha_disturbance_deg_s": 0.6, "q_disturbance_deg_s2": 6.0}
    )

    unknown: Literal["elevator", "gust"] = "elevator"
    """Unknown input: the acting deflection of the elevator, or the angle of attack of a gust, with K = 1."""
    window: Annotated[int, between(6, 10000), only_with(unknown="elevator")] = 45
    """Samples in the window of the test."""
    forgetting: Annotated[float, between(0.5, 1), only_with(unknown="elevator")] = 0.98
    """Forgetting factor of the regression that gives K."""
    smoothing: Annotated[float, between(0, 0.9999), only_with(unknown="elevator")] = 0.9
    """s of the smoothed K-hat, s times the last one plus 1 - s times K-hat; it starts at 1."""
    bounds: Annotated[tuple[float, float], only_with(unknown="elevator")] = (0.0, 1.0)
    """Least and greatest K-hat."""
    follow_disturbances: Annotated[bool, only_with(unknown="elevator")] = True
    """Raise the process noise of regression and test to the level that the readings show. Default with model "short-period": false."""
    false_alarm: Annotated[float, between(0, 0.5, open_low=True), only_with(unknown="elevator")] = 1e-6
    """Probability that noise alone gives the same verdict in two consecutive windows, for each of three evaluations per window of each of
    two tests, with a deflection independent of the noise."""
    offset_deg: Annotated[Positive, only_with(unknown="elevator")] = 0.3
    """Tolerance of the verdicts: of the acting deflection minus K times the measured one, and of the measured minus the commanded one."""
    alpha_disturbance_deg_s: NonNegative = 0.05
    """Process noise of alpha: standard deviation of a rate, held for a tick. Default with model "short-period": 0.6."""
    q_disturbance_deg_s2: NonNegative = 0.3
    """Process noise of q: standard deviation of an acceleration, held for a tick. Default with model "short-period": 6."""
    prior: Annotated[EffectivenessPrior, only_with(unknown="elevator")] = EffectivenessPrior()
    """Prior of K."""

    @property
    def corrects(self) -> bool:
        """Whether it estimates the elevator's effectiveness."""
        return self.unknown == "elevator"

    @property
    def constant_over(self) -> int | None:
        """Ticks over which the test takes K as constant."""
        return self.window

    def _build(
        self, onboard: OnBoard, method: RetrospectiveSettings | WalkSettings
    ) -> ElevatorReconstruction | GustReconstruction:
        scheduled = self.model == "scheduled"
        disturbances = self.alpha_disturbance_deg_s * DEG, self.q_disturbance_deg_s2 * DEG
        if self.unknown == "gust":
            return GustReconstruction(GustConfig(method, scheduled, *disturbances), onboard)
        following = FollowingConfig(
            forgetting=self.forgetting,
            prior_effectiveness=self.prior.effectiveness,
            prior_effectiveness_std=self.prior.effectiveness_std,
            smoothing=self.smoothing,
            bounds=self.bounds,
            window=self.window,
            false_alarm=self.false_alarm,
            offset_rad=self.offset_deg * DEG,
            follow_disturbances=self.follow_disturbances,
        )
        return ElevatorReconstruction(ReconstructionConfig(method, following, scheduled, *disturbances), onboard)


class RetrospectiveCostSettings(_Reconstruction):
    """Unknown input by retrospective cost (Gupta and others 2012): the elevator's acting deflection and K, or a gust."""

    kind: Literal["retrospective-cost"] = "retrospective-cost"
    # The retrospective cost itself ignores the noise.
    alpha_disturbance_deg_s: Annotated[NonNegative, only_with(unknown="elevator")] = 0.05
    """Process noise of alpha in regression and test: standard deviation of a rate, held for a tick. Default with model "short-period":
    0.6."""
    q_disturbance_deg_s2: Annotated[NonNegative, only_with(unknown="elevator")] = 0.3
    """Process noise of q in regression and test: standard deviation of an acceleration, held for a tick. Default with model
    "short-period": 6."""
    order: Annotated[int, between(1, 20)] = 4
    """Order of the feedback that generates the input."""
    horizon: Annotated[int, between(1, 20)] = 6
    """Number of samples whose inputs are optimized together."""
    regularization: NonNegative = 1.0
    """Eta, variances of a reading per deg^2; of a gust: per variance of alpha."""
    initial_covariance: Positive = 0.01
    """Gamma of P(0) = gamma I, and the bound of P above which forgetting stops."""
    input_forgetting: Annotated[float, between(0.5, 1)] = 1.0
    """Forgetting factor of the least squares of the feedback."""
    saturation_deg: Positive = 30.0
    """Bound of the optimized inputs."""

    def build(self, onboard: OnBoard) -> ElevatorReconstruction | GustReconstruction:
        """Return the estimator."""
        method = RetrospectiveSettings(
            order=self.order,
            horizon=self.horizon,
            regularization=self.regularization,
            forgetting=self.input_forgetting,
            saturation_rad=self.saturation_deg * DEG,
            initial_covariance=self.initial_covariance,
        )
        return self._build(onboard, method)


class InputKalmanSettings(_Reconstruction):
    """Unknown input as a random walk in the state of a Kalman filter: the alternative to retrospective-cost."""

    kind: Literal["input-kalman"] = "input-kalman"
    input_step_deg: Positive = 0.1
    """Standard deviation of the random walk of the unknown input per tick."""

    def build(self, onboard: OnBoard) -> ElevatorReconstruction | GustReconstruction:
        """Return the estimator."""
        return self._build(onboard, WalkSettings(step_rad=self.input_step_deg * DEG))
