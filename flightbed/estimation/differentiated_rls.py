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
from flightbed.core.records import record
from flightbed.core.signals import Estimate, Measurement
from flightbed.estimation.loop_gain.filter_bank import TickResult
from flightbed.estimation.packed import ESTIMATE


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


@compiled
def take(state: Array, settings: Array, schedule: Array, now: Array, k: int) -> TickResult:
    """Take the readings of tick k; return the fields of an Estimate.

    Args:
        state: state of DifferentiatedRls, updated: last two pitch rates; last two values of the filter outputs q'_f, model_f and
            control_f; last two inputs model and control; K, its variance, smoothed K; scratch.
        settings: settings of DifferentiatedRls.
        schedule: ``Schedule.packed()``; empty: the model is the short period.
        now: the fields of the Measurement.
        k: number of the tick.

    """
    alpha, q, elevator = now[0], now[1], now[2]
    a1, a2, low, slope, expected, kept, forgetting = (
        settings[0], settings[1], settings[2], settings[3], settings[4], settings[5], settings[6],
    )  # fmt: skip
    smoothed = state[14]
    # Acceleration of the airframe itself, and that due to an elevator with K = 1.
    if schedule.size == 0:
        model = settings[11] * (alpha - settings[14]) + settings[12] * q - settings[13] * settings[15]
        control = settings[13] * elevator
    else:
        here, there = state[15:23].reshape((2, 4)), state[23:31].reshape((2, 4))
        pitch_kernels.rates(schedule, here, alpha, q, 0.0, now[4], now[5], now[6], now[7])
        pitch_kernels.rates(schedule, there, alpha, q, smoothed * elevator, now[4], now[5], now[6], now[7])
        model = here[1, 0]
        control = (there[1, 0] - here[1, 0]) / (smoothed if smoothed > 1e-6 else 1.0)
    if k == 0:  # filters in steady state at the start of the flight
        state[0], state[1], state[2], state[3] = q, q, 0.0, 0.0
        state[4], state[5], state[8], state[9] = model, model, model, model
        state[6], state[7], state[10], state[11] = control, control, control, control
    slope_f = slope * (q - state[1]) - a1 * state[2] - a2 * state[3]
    model_f = low * (model + 2.0 * state[8] + state[9]) - a1 * state[4] - a2 * state[5]
    control_f = low * (control + 2.0 * state[10] + state[11]) - a1 * state[6] - a2 * state[7]
    state[3], state[2], state[5], state[4], state[7], state[6] = (
        state[2],
        slope_f,
        state[4],
        model_f,
        state[6],
        control_f,
    )
    state[1], state[0], state[9], state[8], state[11], state[10] = state[0], q, state[8], model, state[10], control

    gain, variance = state[12], state[13]
    error = slope_f - model_f - control_f * gain
    innovation = expected + control_f * control_f * variance
    step = variance * control_f / innovation
    gain += step * error
    keep = min(1.0, max(forgetting, 1.0 - (1.0 - step * control_f) * error * error / kept))
    variance = min(variance * (1.0 - step * control_f) / keep, settings[10])
    bounded = min(max(gain, settings[7]), settings[8])
    smoothed = settings[9] * smoothed + (1.0 - settings[9]) * bounded
    state[12], state[13], state[14] = gain, variance, smoothed
    return bounded, sqrt(variance), smoothed, gain, alpha, q, error * error / innovation, 0.0, nan, nan, nan, nan


_STATE, _SETTINGS = 31, 16  # numbers of the state and of the settings


@compiled
def observe(
    memory: Array, now: Array, _then: Array, _turning: Array, _turned: Array, _command: float, k: int, out: Array
) -> None:
    """Take the readings of tick k: ``DifferentiatedRls.update`` for compiled callers; see ``packed.Packable``."""
    found = take(memory[:_STATE], memory[_STATE : _STATE + _SETTINGS], memory[_STATE + _SETTINGS :], now, k)
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
        self._settings = np.array(
            [
                a1, a2, low, slope, expected, kept, config.forgetting, *config.bounds, config.smoothing,
                config.prior_effectiveness_var, design.A[1, 0], design.A[1, 1], design.b[1],
                design.alpha_trim_rad, design.elevator_trim_rad,
            ]
        )  # fmt: skip
        self._state = np.zeros(31)
        self._state[12:15] = config.prior_effectiveness, config.prior_effectiveness_var, 1.0
        self._tick = 0
        # Compile, or load from the cache, before the flight; tick 0 resets the state.
        take(self._state.copy(), self._settings, self._schedule, np.array([0.0, 0.0, 0.0, 0.0, 0.6, 0.0, 0.0, 0.0]), 0)

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
