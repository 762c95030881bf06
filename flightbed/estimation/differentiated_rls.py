"""Recursive least squares with variable forgetting on differentiated pitch rate: the baseline from practice.

Adaptive incremental inversion (AIDI) identifies control effectiveness from accelerations, obtained by filtering and differentiating pitch
rates; the on-board model supplies the acceleration of the airframe itself. One unknown remains,

    q'_f - (m_0 + M_alpha alpha + M_q q)_f = K (M_delta delta)_f + noise,

with every term passed through the same second-order filter, so that its lag cancels. K follows by least squares with a forgetting factor
that decreases at large prediction errors (Fortescue, Kershenbaum and Ydstie, Automatica 17 (1981) 831).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import nan, sqrt
from typing import Annotated, ClassVar, Literal

import numpy as np

from flightbed.avionics import pitch_kernels
from flightbed.avionics.onboard import OnBoard
from flightbed.config.kinds import EffectivenessPrior, EstimatorSettings
from flightbed.config.table import between
from flightbed.core.compiled import Array, compiled
from flightbed.core.records import layout, packed, record, size
from flightbed.core.signals import Estimate, Measurement
from flightbed.estimation.loop_gain.filter_bank import TickResult
from flightbed.estimation.packed import ESTIMATE, MEASUREMENT


@dataclass(frozen=True)
class RlsConfig:
    """Settings of the baseline. SI, radians.

    Attributes:
        scheduled: compute the airframe's own acceleration from the schedule instead of the short period.
        forgetting: smallest forgetting factor.
        filter_rad_s, filter_damping: w and z of the second-order filter w^2/(s^2 + 2 z w s + w^2).
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


_STATE = layout(
    (
        "q", "q_before", "slope_f", "slope_f_before", "model_f", "model_f_before", "control_f", "control_f_before",
        "model", "model_before", "control", "control_before", "gain", "variance", "smoothed",
    )
)  # fmt: skip
_SETTINGS = layout(
    (
        "a1", "a2", "low", "slope", "expected", "kept", "forgetting", "lowest", "highest", "smoothing", "prior_variance",
        "moment_alpha", "moment_q", "moment_elevator", "alpha_trim", "elevator_trim",
    )
)  # fmt: skip
_RATES = 8  # numbers of the rates at one point, (2, 4); two points follow the state
_HERE = size(_STATE)
_THERE = _HERE + _RATES
_STATE_SIZE, _SETTINGS_SIZE = _THERE + _RATES, size(_SETTINGS)


@compiled
def take(state: Array, settings: Array, schedule: Array, now: Array, k: int) -> TickResult:
    """Take the readings of tick k; return the fields of an Estimate.

    Args:
        state: state of DifferentiatedRls, updated: a record ``_STATE`` (last two pitch rates; last two values of the filter outputs q'_f,
            model_f and control_f; last two inputs model and control; K, its variance, smoothed K), and scratch.
        settings: a record ``_SETTINGS``.
        schedule: ``Schedule.packed()``; empty: the model is the short period.
        now: the fields of the Measurement.
        k: number of the tick.

    """
    s, own, m = record(state, 0, _STATE), record(settings, 0, _SETTINGS), record(now, 0, MEASUREMENT)
    alpha, q, elevator = m.alpha_rad, m.q_rad_s, m.elevator_rad
    a1, a2, low, smoothed = own.a1, own.a2, own.low, s.smoothed
    # Acceleration of the airframe itself, and that due to an elevator with K = 1.
    if schedule.size == 0:
        model = own.moment_alpha * (alpha - own.alpha_trim) + own.moment_q * q - own.moment_elevator * own.elevator_trim
        control = own.moment_elevator * elevator
    else:
        here, there = state[_HERE:_THERE].reshape((2, 4)), state[_THERE:].reshape((2, 4))
        pitch_kernels.rates(schedule, here, alpha, q, 0.0, m.mach, m.altitude_m, m.theta_rad, m.phi_rad)
        pitch_kernels.rates(
            schedule, there, alpha, q, smoothed * elevator, m.mach, m.altitude_m, m.theta_rad, m.phi_rad
        )
        model = here[1, 0]
        control = (there[1, 0] - here[1, 0]) / (smoothed if smoothed > 1e-6 else 1.0)
    if k == 0:  # filters in steady state at the start of the flight
        s.q, s.q_before, s.slope_f, s.slope_f_before = q, q, 0.0, 0.0
        s.model_f, s.model_f_before, s.model, s.model_before = model, model, model, model
        s.control_f, s.control_f_before, s.control, s.control_before = control, control, control, control
    slope_f = own.slope * (q - s.q_before) - a1 * s.slope_f - a2 * s.slope_f_before
    model_f = low * (model + 2.0 * s.model + s.model_before) - a1 * s.model_f - a2 * s.model_f_before
    control_f = low * (control + 2.0 * s.control + s.control_before) - a1 * s.control_f - a2 * s.control_f_before
    s.slope_f_before, s.model_f_before, s.control_f_before = s.slope_f, s.model_f, s.control_f
    s.slope_f, s.model_f, s.control_f = slope_f, model_f, control_f
    s.q_before, s.model_before, s.control_before = s.q, s.model, s.control
    s.q, s.model, s.control = q, model, control

    gain, variance = s.gain, s.variance
    error = slope_f - model_f - control_f * gain
    innovation = own.expected + control_f * control_f * variance
    step = variance * control_f / innovation
    gain += step * error
    keep = min(1.0, max(own.forgetting, 1.0 - (1.0 - step * control_f) * error * error / own.kept))
    variance = min(variance * (1.0 - step * control_f) / keep, own.prior_variance)
    bounded = min(max(gain, own.lowest), own.highest)
    smoothed = own.smoothing * smoothed + (1.0 - own.smoothing) * bounded
    s.gain, s.variance, s.smoothed = gain, variance, smoothed
    return bounded, sqrt(variance), smoothed, gain, alpha, q, error * error / innovation, 0.0, nan, nan, nan, nan


@compiled
def observe(
    memory: Array, now: Array, _then: Array, _turning: Array, _turned: Array, _command: float, k: int, out: Array
) -> None:
    """Take the readings of tick k: ``DifferentiatedRls.update`` for compiled callers; see ``packed.Packable``."""
    settings_end = _STATE_SIZE + _SETTINGS_SIZE
    found = take(memory[:_STATE_SIZE], memory[_STATE_SIZE:settings_end], memory[settings_end:], now, k)
    to = record(out, 0, ESTIMATE)
    (
        to.effectiveness, to.effectiveness_std, to.effectiveness_smoothed, to.effectiveness_raw, to.alpha_rad, to.q_rad_s, to.nis,
        to.alarms, to.innovation_alpha_rad, to.innovation_q_rad_s, to.innovation_alpha_std_rad, to.innovation_q_std_rad_s,
    ) = found  # fmt: skip


class DifferentiatedRls:
    """Scalar least squares for K on filtered pitch acceleration; an Estimator.

    The state of its estimate is that of the readings. Its standard deviation is that of least squares with white errors of the expected
    variance; it is too small, because the filtered errors are correlated. This belongs to the baseline and is not corrected.

    Args:
        config: settings.
        onboard: on-board knowledge of aircraft and sensors.

    Raises:
        ValueError: the model is the schedule, but none is on board.

    """

    readings = 1.0
    compiled_update = staticmethod(observe)

    def __init__(self, config: RlsConfig, onboard: OnBoard) -> None:
        if config.scheduled and onboard.schedule is None:
            raise ValueError("the estimator's model is the schedule, but there is none on board")
        schedule = onboard.schedule if config.scheduled else None
        self._schedule: Array = np.zeros(0) if schedule is None else schedule.packed()
        w, z = config.filter_rad_s, config.filter_damping
        # Tustin: s -> (2/dt)(1 - Z)/(1 + Z), Z the delay. Denominator and the two numerators, w^2 (1 + Z)^2 and w^2 s.
        c = 2.0 * onboard.control_hz
        a = [c * c + 2 * z * w * c + w * w, 2 * w * w - 2 * c * c, c * c - 2 * z * w * c + w * w]
        a1, a2, low, slope = a[1] / a[0], a[2] / a[0], w * w / a[0], w * w * c / a[0]
        impulse = [0.0, 0.0]
        gain = 0.0
        for k in range(400):
            drive = slope * (1.0 if k == 0 else -1.0 if k == 2 else 0.0)
            impulse = [drive - a1 * impulse[0] - a2 * impulse[1], impulse[0]]
            gain += impulse[0] ** 2
        expected = gain * onboard.noise.q_rad_s**2  # variance of the differentiated pitch rate
        kept = expected / (1.0 - 0.995)  # Fortescue's sum of squared errors: the number in the longest memory
        design = onboard.design
        self._settings = packed(
            _SETTINGS, a1=a1, a2=a2, low=low, slope=slope, expected=expected, kept=kept, forgetting=config.forgetting,
            lowest=config.bounds[0], highest=config.bounds[1], smoothing=config.smoothing,
            prior_variance=config.prior_effectiveness_var, moment_alpha=design.A[1, 0], moment_q=design.A[1, 1],
            moment_elevator=design.b[1], alpha_trim=design.alpha_trim_rad, elevator_trim=design.elevator_trim_rad,
        )  # fmt: skip
        start = packed(_STATE, gain=config.prior_effectiveness, variance=config.prior_effectiveness_var, smoothed=1.0)
        self._state = np.concatenate([start, np.zeros(2 * _RATES)])
        self._tick = 0
        # Compile, or load from the cache, before the flight; tick 0 resets the state.
        take(
            self._state.copy(), self._settings, self._schedule,
            np.array(Measurement(0.0, 0.0, 0.0, 0.0, 0.6, 0.0, 0.0, 0.0)), 0,
        )  # fmt: skip

    def update(self, measurement: Measurement) -> Estimate:
        """Take the readings of the next tick, return the estimate that includes them."""
        found = take(self._state, self._settings, self._schedule, np.array(measurement), self._tick)
        self._tick += 1
        return Estimate(*found)

    def packed(self) -> Array:
        """Return the memory of ``observe``: state, settings, schedule."""
        return np.concatenate([self._state, self._settings, self._schedule])


class DifferentiatedRlsSettings(EstimatorSettings):
    """Recursive least squares with variable forgetting on differentiated pitch rate: the baseline."""

    reads_accelerometer: ClassVar[bool] = False

    kind: Literal["differentiated-rls"] = "differentiated-rls"
    forgetting: Annotated[float, between(0.5, 1)] = 0.98
    """Smallest forgetting factor."""
    prior: EffectivenessPrior = EffectivenessPrior()
    """Prior of K."""

    def build(self, onboard: OnBoard) -> DifferentiatedRls:
        """Return the estimator."""
        config = RlsConfig(
            scheduled=self.model == "scheduled",
            forgetting=self.forgetting,
            smoothing=self.smoothing,
            bounds=self.bounds,
            prior_effectiveness=self.prior.effectiveness,
            prior_effectiveness_var=self.prior.effectiveness_std**2,
        )
        return DifferentiatedRls(config, onboard)
