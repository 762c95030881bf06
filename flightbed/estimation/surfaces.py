"""The two-stage filter on the aircraft: effectiveness of the elevator, or of elevator, aileron and rudder together (Wu and others 2000)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt

import numpy as np

from flightbed.compiling import Array
from flightbed.estimation import pitch_model, surfaces_model
from flightbed.estimation.base import OnBoard
from flightbed.estimation.bias_test import BiasTest, BiasTestConfig, chi_square_threshold
from flightbed.estimation.two_stage import (
    Forgetting,
    TwoStageConfig,
    TwoStageEstimate,
    TwoStageFilter,
)
from flightbed.signals import SURFACES, Estimate, LateralMeasurement, Measurement
from flightbed.units import DEG


@dataclass(frozen=True)
class SurfacesConfig:
    """Settings of the two-stage filter on the aircraft. SI, radians.

    Attributes:
        forgetting: of gamma, as ``two_stage`` has it.
        walk_std: standard deviation of the step that gamma may make in a tick, sqrt of Q_gamma in W eq (6).
        test_window: L of W eq (33), ticks.
        false_alarm: probability with which the test is to raise an alarm at a tick, by the chi-square law; see ``bias_test`` how far that
            law holds.
        smoothing, bounds: as in LoopGainConfig.
        prior_std: standard deviation of gamma at the start.
        follow_disturbances: raise the process noise to what the readings show.
        scheduled: pitch axis on the schedule, else on the short period; flights with aileron and rudder are on tables always.
        disturbances: standard deviations of what the model does not tell, white, each held for a tick: rates of alpha (rad/s), q (rad/s^2),
            beta, p, r.

    """

    forgetting: Forgetting
    walk_std: float = 1e-4
    test_window: int = 3
    false_alarm: float = 1e-4
    smoothing: float = 0.9
    bounds: tuple[float, float] = (0.0, 1.0)
    prior_std: float = 0.63
    follow_disturbances: bool = True
    scheduled: bool = True
    disturbances: tuple[float, float, float, float, float] = (0.05 * DEG, 0.3 * DEG, 0.05 * DEG, 1.0 * DEG, 0.3 * DEG)


class Disturbances:
    """What the readings show of disturbances, as variances to add to Q, so that sigma and test hold in rough air too.

    The residual of one step from reading to reading, e = z - (A z_last + B K u + c), sums up the disturbances; in a leaky sum over some
    15 ticks the sensors' noise, which enters as differences, all but cancels, and gusts that last add up. Its mean square over the last
    seconds, less what the sensors explain, is the white noise that would do the same. As ``kernels.disturbance``, for any number of
    states.

    Args:
        r: (n,) variances of the readings.

    """

    _LEAK = 1.0 - 1.0 / 15.0

    def __init__(self, r: Array) -> None:
        self._r, self._square, self._sum, self._k = r, r.copy(), np.zeros(len(r)), 0
        self._last: Array | None = None

    def update(self, z: Array, A: Array, BK: Array, c: Array, u: Array) -> Array:
        """Take the readings (n,) at the end of a period and its model, B times the K believed; returns variances (n,)."""
        self._k += 1
        if self._last is None:
            self._last = z
            return np.zeros(len(z))
        self._sum = self._LEAK * self._sum + z - (A @ self._last + BK @ u + c)
        seen = np.minimum(self._sum**2, 4.0 * (self._square + self._r))
        self._square += max(1.0 / 300.0, 1.0 / (self._k + 20.0)) * (seen - self._square)
        self._last = z
        found: Array = np.maximum(0.0, (1.0 - self._LEAK**2) * (self._square - 1.6 * self._r))
        return found

    def forgive(self) -> None:
        """Drop the sums: what they hold is a change of K, not the air."""
        self._sum = np.zeros(len(self._r))


class _Filter:
    """Filter, test and smoother of some inputs; the first two states are alpha and q."""

    def __init__(self, config: SurfacesConfig, noise: Array, b: Array, dt: float) -> None:
        n, inputs = len(noise), b.shape[1]
        disturbed = np.array(config.disturbances[:n]) * dt
        self._config, self._C = config, np.eye(n)
        # An error of a measured deflection moves the prediction by at most b (K = 1): taken as process noise.
        self._matrices = {
            "Q": np.diag(disturbed**2) + b @ b.T,
            "R": np.diag(noise**2),
            "Q_gamma": config.walk_std**2 * np.eye(inputs),
            "gamma": np.zeros(inputs),
            "gamma_covariance": config.prior_std**2 * np.eye(inputs),
        }
        threshold = chi_square_threshold(config.test_window, config.false_alarm)
        self._test = BiasTest(BiasTestConfig(config.test_window, (threshold,) * inputs))
        self.smoothed, self._raised = [1.0] * inputs, [False] * inputs
        self._alarms = [0.0] * inputs
        self._air = Disturbances(noise**2) if config.follow_disturbances else None
        self._filter: TwoStageFilter | None = None
        # Compile, or load what was compiled, now and not in flight.
        trial = self._begun(np.zeros(n))
        trial.step(np.eye(n), np.zeros((n, inputs)), self._C, np.zeros(inputs), np.zeros(n), np.zeros(n))

    def _begun(self, readings: Array) -> TwoStageFilter:
        return TwoStageFilter(
            TwoStageConfig(
                state=readings,
                state_covariance=self._matrices["R"].copy(),
                forgetting=self._config.forgetting,
                **self._matrices,
            )
        )

    def take(self, readings: Array, A: Array, B: Array, c: Array, u: Array, offset: float) -> list[Estimate]:
        """Return the estimates of all inputs at the next tick; ``offset`` is added to alpha."""
        Q = self._matrices["Q"]
        if self._air is not None:
            Q = Q + np.diag(self._air.update(readings, A, B * np.array(self.smoothed), c, u))
        if self._filter is None:
            self._filter = self._begun(readings)
            found = self._filter.estimate
        else:
            found = self._filter.step(A, B, self._C, u, readings, c, Q)
        tested = self._test.update(found.gamma, found.gamma_covariance)
        if self._air is not None and any(now and not was for now, was in zip(tested.raised, self._raised, strict=True)):
            self._air.forgive()
        return [self._told(found, i, bool(tested.raised[i]), offset) for i in range(len(found.gamma))]

    def _told(self, found: TwoStageEstimate, i: int, raised: bool, offset: float) -> Estimate:
        low, high = self._config.bounds
        raw = 1.0 + float(found.gamma[i])
        bounded, keep = min(max(raw, low), high), self._config.smoothing
        if raised and not self._raised[i]:
            self._alarms[i] += 1.0
        self._raised[i] = raised
        self.smoothed[i] = keep * self.smoothed[i] + (1.0 - keep) * bounded
        e, S = found.innovation, found.innovation_covariance
        return Estimate(
            bounded, sqrt(float(found.gamma_covariance[i, i])), self.smoothed[i], raw,
            float(found.state[0]) + offset, float(found.state[1]), found.nis, self._alarms[i],
            float(e[0]), float(e[1]), sqrt(float(S[0, 0])), sqrt(float(S[1, 1])),
        )  # fmt: skip


class TwoStagePitch:
    """The two-stage filter of (alpha, q) and the elevator's effectiveness; an Estimator.

    Args:
        config: settings.
        onboard: what is known of aircraft and sensors.

    Raises:
        ValueError: a schedule is asked for, and there is none on board.

    """

    readings = 2.0

    def __init__(self, config: SurfacesConfig, onboard: OnBoard) -> None:
        if config.scheduled and onboard.schedule is None:
            raise ValueError("the estimator's model is the schedule, but there is none on board")
        design, noise, self._dt = onboard.design, onboard.noise, 1.0 / onboard.control_hz
        self._schedule = onboard.schedule.packed() if config.scheduled and onboard.schedule else None
        discrete = design.discrete(onboard.control_hz)
        self._alpha_trim = 0.0 if config.scheduled else design.alpha_trim_rad
        self._model = np.column_stack([discrete.A, discrete.b, -discrete.b * design.elevator_trim_rad])
        self._work = np.zeros((2, 4))
        unseen = noise.elevator_rad * discrete.b[:, None]
        self._filter = _Filter(config, np.array([noise.alpha_rad, noise.q_rad_s]), unseen, self._dt)
        self._last: Measurement | None = None
        if self._schedule is not None:
            pitch_model.local_model(
                self._schedule, self._model, self._work, 1.0, self._dt, 0.0, 0.0, 0.0, 0.6, 0.0, 0.0, 0.0, 0.0
            )

    def update(self, measurement: Measurement) -> Estimate:
        """Take the readings of the next tick, return the estimate that includes them."""
        m, model = measurement, self._model
        if self._schedule is not None and self._last is not None:
            then = self._last
            pitch_model.local_model(
                self._schedule, model, self._work, self._filter.smoothed[0], self._dt, then.alpha_rad, then.q_rad_s,
                m.elevator_mean_rad, then.mach, then.altitude_m, then.theta_rad, then.phi_rad, 0.0,
            )  # fmt: skip
        self._last = m
        readings = np.array([m.alpha_rad - self._alpha_trim, m.q_rad_s])
        u = np.array([m.elevator_mean_rad])
        return self._filter.take(readings, model[:, :2], model[:, 2:3], model[:, 3], u, self._alpha_trim)[0]


class TwoStageSurfaces:
    """The two-stage filter of (alpha, q, beta, p, r) and the effectiveness of all three surfaces; a SurfacesEstimator.

    Args:
        config: settings.
        onboard: what is known of aircraft and sensors.

    Raises:
        ValueError: there is no schedule or no model of roll and yaw on board.

    """

    readings = 5.0
    surfaces: tuple[str, ...] = SURFACES

    def __init__(self, config: SurfacesConfig, onboard: OnBoard) -> None:
        schedule, lateral, noise = onboard.schedule, onboard.lateral, onboard.lateral_noise
        if schedule is None or lateral is None or noise is None:
            raise ValueError(
                "the estimator's model is the schedule and tables of roll and yaw, but they are not on board"
            )
        pitch, self._dt = onboard.noise, 1.0 / onboard.control_hz
        self._schedule, self._tables = schedule.packed(), lateral.tables.packed()
        self._work = np.zeros((10, 9))
        stds = (pitch.alpha_rad, pitch.q_rad_s, noise.beta_rad, noise.p_rad_s, noise.r_rad_s)
        unseen = np.zeros((5, 3))
        unseen[:2, 0] = pitch.elevator_rad * onboard.design.discrete(onboard.control_hz).b
        unseen[2:, 1:] = lateral.B * self._dt * np.array([noise.aileron_rad, noise.rudder_rad])
        self._filter = _Filter(config, np.array(stds), unseen, self._dt)
        self._last: tuple[Measurement, LateralMeasurement] | None = None
        surfaces_model.local_model(
            self._schedule, self._tables, self._work, 1.0, self._dt, 0.0, 0.0, 0.0, 0.6, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        )

    def update_all(self, measurement: Measurement, lateral: LateralMeasurement) -> Sequence[Estimate]:
        """Take the readings of the next tick, return the estimates of elevator, aileron and rudder that include them."""
        m, turning, work = measurement, lateral, self._work
        if self._last is not None:
            then, turned = self._last
            surfaces_model.local_model(
                self._schedule, self._tables, work, self._filter.smoothed[0], self._dt, m.elevator_mean_rad,
                then.alpha_rad, then.q_rad_s, then.mach, then.altitude_m, then.theta_rad, then.phi_rad,
                turned.beta_rad, turned.p_rad_s, turned.r_rad_s,
            )  # fmt: skip
        self._last = m, turning
        readings = np.array([m.alpha_rad, m.q_rad_s, turning.beta_rad, turning.p_rad_s, turning.r_rad_s])
        u = np.array([m.elevator_mean_rad, turning.aileron_mean_rad, turning.rudder_mean_rad])
        return self._filter.take(readings, work[:5, :5], work[:5, 5:8], work[:5, 8], u, 0.0)
