"""Factories from a scenario's settings to the estimators that reconstruct an unknown input; they convert the units."""

from __future__ import annotations

from flightbed.avionics.onboard import OnBoard
from flightbed.config import kinds
from flightbed.core.units import DEG
from flightbed.estimation.base import Estimator
from flightbed.estimation.reconstruction.elevator import ElevatorReconstruction, ReconstructionConfig
from flightbed.estimation.reconstruction.gust import GustConfig, GustReconstruction
from flightbed.estimation.reconstruction.methods import RetrospectiveSettings, WalkSettings
from flightbed.estimation.reconstruction.regression import FollowingConfig


def retrospective_cost(settings: kinds.EstimatorSettings, onboard: OnBoard) -> Estimator:
    """Unknown input by retrospective cost (Gupta and others 2012): the elevator's acting deflection and K, or a gust."""
    method = RetrospectiveSettings(
        order=settings.order,
        horizon=settings.horizon,
        regularization=settings.regularization,
        forgetting=settings.input_forgetting,
        saturation_rad=settings.saturation_deg * DEG,
        initial_covariance=settings.initial_covariance,
    )
    return _reconstruction(settings, onboard, method)


def input_kalman(settings: kinds.EstimatorSettings, onboard: OnBoard) -> Estimator:
    """Unknown input as a random walk in the state of a Kalman filter: the alternative to retrospective-cost."""
    return _reconstruction(settings, onboard, WalkSettings(step_rad=settings.input_step_deg * DEG))


def _reconstruction(
    settings: kinds.EstimatorSettings, onboard: OnBoard, method: RetrospectiveSettings | WalkSettings
) -> Estimator:
    scheduled = settings.model == "scheduled"
    disturbances = settings.alpha_disturbance_deg_s * DEG, settings.q_disturbance_deg_s2 * DEG
    if settings.unknown == "gust":
        return GustReconstruction(GustConfig(method, scheduled, *disturbances), onboard)
    prior = settings.prior
    following = FollowingConfig(
        forgetting=settings.forgetting,
        prior_effectiveness=prior.effectiveness,
        prior_effectiveness_std=prior.effectiveness_std,
        smoothing=settings.smoothing,
        bounds=(settings.bounds[0], settings.bounds[1]),
        window=settings.window,
        false_alarm=settings.false_alarm,
        offset_rad=settings.offset_deg * DEG,
        follow_disturbances=settings.follow_disturbances,
    )
    return ElevatorReconstruction(ReconstructionConfig(method, following, scheduled, *disturbances), onboard)
