"""Reconstruction of a gust as an unknown input: the angle of attack that moving air adds, with the elevator known.

The angle of attack is alpha = alpha_i + g, g = w/V, where w is the vertical speed of the air; forces and vane depend on the sum only.
Steady vertical motion of the air has no effect in a frame that moves with it: the outputs have a zero at 1, and a steady w is not
observable. Its change over a period is observable, r = g(k+1) - g(k), and is the unknown input here:

    alpha+ = A_11 alpha + A_12 q + b_1 u + c_1 + (1 + A_11)/2 r,   q+ = A_21 alpha + ... + A_21/2 r,   g+ = (1 - T/tau) g + r,

with the factor 1/2 because the gust rises over the period. g decays with the time constant tau, otherwise model errors would accumulate
in it; it is accurate at frequencies well above 1/(2 pi tau). The damping due to a gust's own rotation, which JSBSim's discrete gusts do
not have, is neglected.

The mean deflection of a period is known at its end: the estimate refers to the previous tick.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite, nan

import numpy as np

from flightbed.avionics.onboard import OnBoard
from flightbed.core.compiled import Array
from flightbed.core.signals import Estimate, Measurement
from flightbed.core.units import DEG
from flightbed.estimation.reconstruction import observers
from flightbed.estimation.reconstruction.elevator import PitchMotion
from flightbed.estimation.reconstruction.input_kalman import InputKalmanFilter, random_walk
from flightbed.estimation.reconstruction.input_model import InputModel
from flightbed.estimation.reconstruction.methods import NOTHING, RetrospectiveSettings, WalkSettings
from flightbed.estimation.reconstruction.observers import FAR
from flightbed.estimation.reconstruction.retrospective_cost import RetrospectiveCost


@dataclass(frozen=True)
class GustConfig:
    """Settings of the estimator.

    Attributes:
        method: settings of the method, which also select it; their deflections are changes of angle of attack per tick here.
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

    It assumes a healthy elevator, K = 1, and returns nan as its effectiveness; it cannot correct a law.

    Args:
        config: settings.
        onboard: on-board knowledge of aircraft and sensors.

    Raises:
        ValueError: the model is the schedule, but none is on board.

    """

    compiled_update = staticmethod(observers.observe_gust)

    def __init__(self, config: GustConfig, onboard: OnBoard) -> None:
        self._config, self._motion = config, PitchMotion(onboard, scheduled=config.scheduled)
        dt, noise = 1.0 / onboard.control_hz, onboard.noise
        # Readings, input and gust in standard deviations; input and gust use that of alpha.
        self._sigma = np.array([noise.alpha_rad, noise.q_rad_s, noise.alpha_rad])
        self._kept = 1.0 - dt / config.memory_s
        disturbed = np.array([config.alpha_disturbance_rad_s, config.q_disturbance_rad_s2, 0.0]) * dt / self._sigma
        self._process = np.diag(disturbed**2)
        self._reset()
        for _ in range(2):  # compile, or load from the cache, before the flight
            self.update(Measurement(0.0, 0.0, 0.0, 0.0, 0.6, 0.0, 0.0, 0.0))
        self._reset()

    def _reset(self) -> None:
        self._last: Measurement | None = None
        self._estimator: RetrospectiveCost | InputKalmanFilter | None = None

    def packed(self) -> Array | None:
        """Return the memory of ``observers.observe_gust``; None for a retrospective cost without regularization."""
        method, unit = self._config.method, float(self._sigma[2])
        values, model, schedule = self._motion.packed()
        if isinstance(method, WalkSettings):
            walk = random_walk(1, step_std=method.step_rad / unit, initial_std=method.step_rad / unit)
            memory = observers.walk_memory(self._process, np.diag([NOTHING, NOTHING, 0.0]), walk)
            values |= {"is_walk": 1.0}
        else:
            config = method.config(unit)
            if config.regularization <= 0.0:
                return None
            memory = observers.retrospective_memory(3, config)
            values |= {
                "order": config.order, "horizon": method.horizon, "initial_covariance": config.initial_covariance,
            }  # fmt: skip
        sigma_alpha, sigma_q, _ = self._sigma.tolist()
        values |= {"sigma_alpha": sigma_alpha, "sigma_q": sigma_q, "kept": self._kept, "method": memory.size}
        return observers.pack(values, *model, memory, schedule)

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
        """Take the readings of the next tick, return the estimate of the previous tick; at tick 0 the gust is 0."""
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
        effectiveness=nan,  # K is not estimated
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
