"""A gust reconstructed as an unknown input: the angle of attack that moving air adds; the elevator is known. An estimator of the aircraft.

The angle to the air is alpha = alpha_i + g, g = w/V with w the vertical speed of the air, and the forces and the vane know only their
sum. Air that moves steadily is no gust: all goes on as before, in a frame that moves with it, so the outputs have a zero at 1 and a steady
w cannot be told from them. What can is its change over a period, r = g(k+1) - g(k), which is the unknown input here:

    alpha+ = A_11 alpha + A_12 q + b_1 u + c_1 + (1 + A_11)/2 r,   q+ = A_21 alpha + ... + A_21/2 r,   g+ = (1 - T/tau) g + r,

the halves because the gust rises over the period. g forgets with the time constant tau, or the model's errors would add up in it: it is
right at frequencies well above 1/(2 pi tau). The damping of a gust's own rotation, which JSBSim's discrete gusts do not have, is left out.

The period's deflection is known when it has ended: the estimate is that of the tick before.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite, nan

import numpy as np

from flightbed.compiling import Array
from flightbed.estimation.base import OnBoard
from flightbed.estimation.input_model import InputModel
from flightbed.estimation.input_observer import InputKalmanFilter, random_walk
from flightbed.estimation.reconstruction import FAR, PitchMotion
from flightbed.estimation.reconstruction_methods import NOTHING, RetrospectiveSettings, WalkSettings
from flightbed.estimation.retrospective_cost import RetrospectiveCost
from flightbed.signals import Estimate, Measurement
from flightbed.units import DEG


@dataclass(frozen=True)
class GustConfig:
    """Settings of the estimator.

    Attributes:
        method: which, with its settings; deflections in them are changes of angle of attack over a tick here.
        scheduled, alpha_disturbance_rad_s, q_disturbance_rad_s2: as in ReconstructionConfig.
        memory_s: tau, s.

    """

    method: RetrospectiveSettings | WalkSettings
    scheduled: bool = True
    alpha_disturbance_rad_s: float = 0.05 * DEG
    q_disturbance_rad_s2: float = 0.3 * DEG
    memory_s: float = 5.0


class GustReconstruction:
    """The angle of attack that a gust adds, ``reconstructed_rad``, by one of the methods; an Estimator.

    It takes the elevator to be whole, K = 1 with no deviation, and says nothing of it; so it can correct no law.

    Args:
        config: settings.
        onboard: what is known of aircraft and sensors.

    Raises:
        ValueError: a schedule is asked for, and there is none on board.

    """

    def __init__(self, config: GustConfig, onboard: OnBoard) -> None:
        self._config, self._motion = config, PitchMotion(onboard, scheduled=config.scheduled)
        dt, noise = 1.0 / onboard.control_hz, onboard.noise
        # Readings, and the input with the gust, in standard deviations: the input is of the size of alpha's.
        self._sigma = np.array([noise.alpha_rad, noise.q_rad_s, noise.alpha_rad])
        self._kept = 1.0 - dt / config.memory_s
        disturbed = np.array([config.alpha_disturbance_rad_s, config.q_disturbance_rad_s2, 0.0]) * dt / self._sigma
        self._process = np.diag(disturbed**2)
        self._reset()
        for _ in range(2):  # compile, or load what was compiled, now and not in flight
            self.update(Measurement(0.0, 0.0, 0.0, 0.0, 0.6, 0.0, 0.0, 0.0))
        self._reset()

    def _reset(self) -> None:
        self._last: Measurement | None = None
        self._estimator: RetrospectiveCost | InputKalmanFilter | None = None

    def _start(self, model: InputModel, y: Array) -> RetrospectiveCost | InputKalmanFilter:
        method, unit, state = self._config.method, float(self._sigma[2]), np.array([y[0], y[1], 0.0])
        if isinstance(method, WalkSettings):
            walk = random_walk(1, step_std=method.step_rad / unit, initial_std=method.step_rad / unit)
            known = np.diag([NOTHING, NOTHING, 0.0])
            return InputKalmanFilter(
                walk, model, process=self._process, noise=np.eye(2), state_covariance=known, state=state
            )
        return RetrospectiveCost(method.config(unit), model, state)

    def _model(self, m: Measurement, deflection_rad: float) -> InputModel:
        rows, sigma = self._motion.rows(m, deflection_rad), self._sigma
        A, B, G = np.diag([0.0, 0.0, self._kept]), np.empty((3, 1)), np.zeros((3, 2))
        A[:2, :2], G[:2] = rows[:, :2], rows[:, 2:]
        B[:, 0] = 0.5 * (1.0 + A[0, 0]), 0.5 * A[1, 0], 1.0
        return InputModel(A * sigma / sigma[:, None], B * sigma[2] / sigma[:, None], np.eye(2, 3), G / sigma[:, None])

    def update(self, measurement: Measurement) -> Estimate:
        """Take the readings of the next tick, return the estimate of the tick before; at tick 0 there is no gust."""
        then, self._last = self._last, measurement
        if then is None:
            return _estimate(np.array([measurement.alpha_rad, measurement.q_rad_s, 0.0]), np.full(2, nan))
        u = measurement.elevator_mean_rad
        model, y, known = (
            self._model(then, u),
            np.array([then.alpha_rad, then.q_rad_s]) / self._sigma[:2],
            np.array([u, 1.0]),
        )
        if self._estimator is None:
            self._estimator = self._start(model, y)
        state, innovation = _take(self._estimator, y, known, model)
        if not (np.all(np.isfinite(state)) and np.all(np.abs(innovation) < FAR)):
            self._estimator = self._start(model, y)
            state, innovation = _take(self._estimator, y, known, model)
        return _estimate(state * self._sigma, innovation * self._sigma[:2])


def _take(
    estimator: RetrospectiveCost | InputKalmanFilter, y: Array, known: Array, model: InputModel
) -> tuple[Array, Array]:
    if isinstance(estimator, RetrospectiveCost):
        found = estimator.update(y, known, model=model)
        return found.state, found.performance
    filtered = estimator.update(y, known, model=model)
    return filtered.state, filtered.innovation


def _estimate(state: Array, innovation: Array) -> Estimate:
    alpha, q, gust = (float(value) for value in state)
    e_alpha, e_q = (float(value) if isfinite(value) else nan for value in innovation)
    return Estimate(
        effectiveness=nan,  # nothing is said of K
        effectiveness_std=nan,
        effectiveness_smoothed=nan,
        effectiveness_raw=nan,
        alpha_rad=alpha,
        q_rad_s=q,
        nis=nan,
        innovation_alpha_rad=e_alpha,
        innovation_q_rad_s=e_q,
        reconstructed_rad=gust,
    )
