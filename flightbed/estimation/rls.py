"""Recursive least squares with variable forgetting on differentiated pitch rate: the baseline that practice uses.

Adaptive incremental inversion (AIDI) identifies control effectiveness from accelerations that are pitch rates, filtered and
differentiated; what the airframe does of itself is taken from its model. One unknown is left,

    q'_f - (m_0 + M_alpha alpha + M_q q)_f = K (M_delta delta)_f + noise,

every term through the same second-order filter, so that its lag cancels. K follows by least squares with a forgetting factor that
falls when the prediction error is large (Fortescue, Kershenbaum and Ydstie, Automatica 17 (1981) 831).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numpy as np

from flightbed.estimation import pitch_model
from flightbed.estimation.base import OnBoard
from flightbed.signals import Estimate, Measurement


@dataclass(frozen=True)
class RlsConfig:
    """Settings of the baseline. SI, radians.

    Attributes:
        scheduled: take the airframe's own acceleration from the schedule instead of the short period.
        forgetting: smallest forgetting factor.
        filter_rad_s, filter_damping: of the second-order filter w^2/(s^2 + 2 z w s + w^2).
        smoothing, bounds, prior_effectiveness, prior_effectiveness_var: as in LoopGainConfig.

    """

    scheduled: bool = True
    forgetting: float = 0.98
    filter_rad_s: float = 20.0
    filter_damping: float = 0.8
    smoothing: float = 0.9
    bounds: tuple[float, float] = (0.0, 1.0)
    prior_effectiveness: float = 1.0
    prior_effectiveness_var: float = 0.63**2


class DifferentiatedRls:
    """Scalar least squares for K on filtered pitch acceleration; an Estimator.

    The state that it passes on is the readings'. Its standard deviation is that of least squares with white errors of the expected
    variance: the filtered errors are correlated, so it is too small. That is the baseline's, and is left as it is.

    Args:
        config: settings.
        onboard: what is known of aircraft and sensors.

    Raises:
        ValueError: a schedule is asked for, and there is none on board.

    """

    readings = 1.0

    def __init__(self, config: RlsConfig, onboard: OnBoard) -> None:
        if config.scheduled and onboard.schedule is None:
            raise ValueError("the estimator's model is the schedule, but there is none on board")
        self._config, self._design, self._dt = config, onboard.design, 1.0 / onboard.control_hz
        self._schedule = onboard.schedule.packed() if config.scheduled and onboard.schedule else None
        w, z, dt = config.filter_rad_s, config.filter_damping, self._dt
        # Tustin: s -> (2/dt)(1 - Z)/(1 + Z), Z the delay. Denominator and the two numerators, w^2 and w^2 s.
        c = 2.0 / dt
        a = np.array([c * c + 2 * z * w * c + w * w, 2 * w * w - 2 * c * c, c * c - 2 * z * w * c + w * w])
        self._a1, self._a2 = float(a[1] / a[0]), float(a[2] / a[0])
        self._low = w * w / float(a[0])  # times (1 + Z)^2
        self._slope = w * w * c / float(a[0])  # times (1 - Z)(1 + Z)
        impulse = [0.0, 0.0]
        gain = 0.0
        for k in range(400):
            drive = self._slope * (1.0 if k == 0 else -1.0 if k == 2 else 0.0)
            impulse = [drive - self._a1 * impulse[0] - self._a2 * impulse[1], impulse[0]]
            gain += impulse[0] ** 2
        self._expected = gain * onboard.noise.q_rad_s**2  # variance of the differentiated pitch rate
        # Fortescue's sum of squared errors that is kept: as many as the slowest memory holds.
        self._kept = self._expected / (1.0 - 0.995)
        self._q: list[float] | None = None
        self._held = np.zeros((3, 2))  # outputs: q'_f, model_f, control_f; their last two values
        self._model, self._control = [0.0, 0.0], [0.0, 0.0]
        self._gain, self._variance = config.prior_effectiveness, config.prior_effectiveness_var
        self._smoothed = 1.0
        if self._schedule is not None:  # compile, or load what was compiled, now and not in flight
            pitch_model.rates(self._schedule, np.empty((2, 4)), 0.0, 0.0, 0.0, 0.6, 0.0, 0.0, 0.0)

    def _terms(self, m: Measurement) -> tuple[float, float]:
        """Return the acceleration that the airframe has of itself, and what a fully effective elevator adds; rad/s^2."""
        if self._schedule is None:
            d = self._design
            own = d.A[1, 0] * (m.alpha_rad - d.alpha_trim_rad) + d.A[1, 1] * m.q_rad_s - d.b[1] * d.elevator_trim_rad
            return float(own), float(d.b[1] * m.elevator_rad)
        here, there = np.empty((2, 4)), np.empty((2, 4))
        where = (m.mach, m.altitude_m, m.theta_rad, m.phi_rad)
        pitch_model.rates(self._schedule, here, m.alpha_rad, m.q_rad_s, 0.0, *where)
        pitch_model.rates(self._schedule, there, m.alpha_rad, m.q_rad_s, self._smoothed * m.elevator_rad, *where)
        acting = self._smoothed if self._smoothed > 1e-6 else 1.0
        return float(here[1, 0]), float(there[1, 0] - here[1, 0]) / acting

    def update(self, measurement: Measurement) -> Estimate:
        """Take the readings of the next tick, return the estimate that includes them."""
        config = self._config
        model, control = self._terms(measurement)
        if self._q is None:  # settled where the flight begins
            self._q = [measurement.q_rad_s] * 2
            self._model, self._control = [model] * 2, [control] * 2
            self._held = np.array([[0.0, 0.0], [model, model], [control, control]])
        drive = np.array(
            [
                self._slope * (measurement.q_rad_s - self._q[1]),
                self._low * (model + 2.0 * self._model[0] + self._model[1]),
                self._low * (control + 2.0 * self._control[0] + self._control[1]),
            ]
        )
        filtered = drive - self._a1 * self._held[:, 0] - self._a2 * self._held[:, 1]
        self._held = np.column_stack([filtered, self._held[:, 0]])
        self._q = [measurement.q_rad_s, self._q[0]]
        self._model, self._control = [model, self._model[0]], [control, self._control[0]]

        target, regressor = float(filtered[0] - filtered[1]), float(filtered[2])
        error = target - regressor * self._gain
        innovation = self._expected + regressor * regressor * self._variance
        step = self._variance * regressor / innovation
        self._gain += step * error
        variance = self._variance * (1.0 - step * regressor)
        keep = 1.0 - (1.0 - step * regressor) * error * error / self._kept
        keep = min(1.0, max(config.forgetting, keep))
        self._variance = min(variance / keep, config.prior_effectiveness_var)
        bounded = min(max(self._gain, config.bounds[0]), config.bounds[1])
        self._smoothed = config.smoothing * self._smoothed + (1.0 - config.smoothing) * bounded
        return Estimate(
            bounded, sqrt(self._variance), self._smoothed, self._gain, measurement.alpha_rad, measurement.q_rad_s,
            error * error / innovation,
        )  # fmt: skip
