"""Joint estimation of state and loop gain K: Theorem 1 of Sillence (1999), Theorem 2 of Pachter."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Annotated, Any, ClassVar, Literal

import numpy as np

from flightbed.avionics.onboard import OnBoard
from flightbed.config.kinds import EffectivenessPrior, EstimatorSettings, Surroundings
from flightbed.config.table import NonNegative, Positive, between, only_with
from flightbed.core.compiled import Array, compiled
from flightbed.core.records import layout, record, size
from flightbed.core.signals import NOTHING_RECONSTRUCTED, Estimate, Measurement
from flightbed.core.units import DEG
from flightbed.estimation.loop_gain import filter_bank, scheduled
from flightbed.estimation.packed import ESTIMATE, MEASUREMENT

_new = tuple.__new__
_BEGIN = MappingProxyType(
    {"fixed": filter_bank.FIXED, "measurement": filter_bank.ANCHORED, "corrected": filter_bank.CORRECTED}
)


@dataclass(frozen=True)
class LoopGainConfig:
    """Settings of the estimator. SI, radians.

    Attributes:
        memory: ``"expanding"`` (all data), ``"window"`` (the last ``window`` samples, each started from the prior) or
            ``"fading"`` (the covariance inflated by 1/forgetting per tick).
        window: samples in a window.
        forgetting: lambda in (0, 1]; 1 forgets nothing.
        smoothing: s in K_s+ = s K_s + (1 - s) K-hat, started at 1 (Sillence eq (85)).
        bounds: lowest and highest K-hat of the estimate.
        alarm_threshold: generalized likelihood ratio beyond which a change of K is declared and the window is shortened to the data
            since the change; 0: no test. With memory ``"window"`` only.
        follow_disturbances: increase the process noise to the level shown by the readings, and, with the schedule, subtract the
            gust's pitch rate.
        hold_std: standard deviation with which the last smoothed estimate replaces the prior of K in a window with little information;
            its random walk has a step of hold_std / 63 per tick. 0: neither.
        absolute: x' = A x + b (K delta - delta_trim): K scales the whole deflection, as on the aircraft. Otherwise
            x' = A x + K b (delta - delta_trim), the form of the thesis, for a plant whose trim does not depend on K.
        input_at: ``"mean"``: u is the measured deflection averaged over the sample; ``"start"`` or ``"end"``: its value at that time.
        scheduled: the model is the schedule, not the short period at the trim point; the input is then absolute.
        alpha_disturbance_rad_s, q_disturbance_rad_s2: process noise: standard deviation of an unmodelled alpha rate and
            pitch acceleration, white, each held for one tick.
        prior_state: ``"measurement"``: start alpha and q from the readings and their variances; ``"fixed"``: from the prior;
            ``"corrected"``: from the prior corrected by the readings.
        prior_alpha_rad, prior_q_rad_s: prior state, deviations from trim.
        prior_alpha_var, prior_q_var: their variances.
        prior_effectiveness, prior_effectiveness_var: prior of K.

    """

    memory: str = "window"
    window: int = 30
    forgetting: float = 0.98
    smoothing: float = 0.9
    bounds: tuple[float, float] = (0.0, 1.0)
    alarm_threshold: float = 0.0
    follow_disturbances: bool = False
    hold_std: float = 0.0
    absolute: bool = True
    input_at: str = "mean"
    scheduled: bool = False
    alpha_disturbance_rad_s: float = 0.6 * DEG
    q_disturbance_rad_s2: float = 6.0 * DEG
    prior_state: str = "measurement"
    prior_alpha_rad: float = 0.0
    prior_q_rad_s: float = 0.0
    prior_alpha_var: float = DEG**2
    prior_q_var: float = DEG**2
    prior_effectiveness: float = 1.0
    prior_effectiveness_var: float = 0.63**2


_WIRING = layout(("dt", "alpha_trim", "input_offset", "mean_input", "at_start", "filters"))
_SETTINGS = size(_WIRING)  # start of the settings in the memory


@compiled
def observe(
    memory: Array, now: Array, then: Array, _turning: Array, _turned: Array, _command: float, k: int, out: Array
) -> None:
    """Take the readings of tick k: ``LoopGain.update`` for compiled callers; see ``packed.Packable``."""
    wiring = record(memory, 0, _WIRING)
    bank_at = _SETTINGS + filter_bank.SETTINGS
    filters = int(wiring.filters)
    schedule_at = bank_at + filter_bank.ROWS * filters
    settings, schedule = memory[_SETTINGS:bank_at], memory[schedule_at:]
    bank = memory[bank_at:schedule_at].reshape((filter_bank.ROWS, filters))
    m, before = record(now, 0, MEASUREMENT), record(then, 0, MEASUREMENT)
    elevator = m.elevator_mean_rad if wiring.mean_input > 0.0 else m.elevator_rad
    if wiring.at_start > 0.0:
        elevator = 0.0
        if k > 0:
            elevator = before.elevator_mean_rad if wiring.mean_input > 0.0 else before.elevator_rad
    if schedule.size == 0:
        found = filter_bank.tick(
            bank, settings, elevator - wiring.input_offset, m.alpha_rad - wiring.alpha_trim, m.q_rad_s, k
        )
    else:
        found = scheduled.tick(
            bank, settings, schedule, wiring.dt, elevator, m.alpha_rad, m.q_rad_s, before.alpha_rad, before.q_rad_s,
            before.mach, before.altitude_m, before.theta_rad, before.phi_rad, k,
        )  # fmt: skip
    to = record(out, 0, ESTIMATE)
    (
        to.effectiveness, to.effectiveness_std, to.effectiveness_smoothed, to.effectiveness_raw, to.alpha_rad, to.q_rad_s, to.nis,
        to.alarms, to.innovation_alpha_rad, to.innovation_q_rad_s, to.innovation_alpha_std_rad, to.innovation_q_std_rad_s,
    ) = found  # fmt: skip


class LoopGain:
    """The augmented Kalman filter of (alpha, q, K), with alpha and q measured; an Estimator.

    Its model is the short period at the trim point or, with ``config.scheduled``, the schedule: at every tick the pitch motion of the
    aircraft, linearized at the measured Mach number, altitude, attitude, alpha and q.

    Args:
        config: settings.
        onboard: on-board knowledge of aircraft and sensors.

    Raises:
        ValueError: the model is the schedule, but none is on board.

    """

    readings = 2.0
    compiled_update = staticmethod(observe)

    def __init__(self, config: LoopGainConfig, onboard: OnBoard) -> None:
        design, noise, control_hz = onboard.design, onboard.noise, onboard.control_hz
        if config.scheduled and onboard.schedule is None:
            raise ValueError("the estimator's model is the schedule, but there is none on board")
        self._schedule = onboard.schedule.packed() if config.scheduled and onboard.schedule else None
        self._dt = 1.0 / control_hz
        self._last: Measurement | None = None
        discrete = design.discrete(control_hz)
        self._alpha_trim = 0.0 if config.scheduled else design.alpha_trim_rad
        # Absolute: the known part of the input is -delta_trim, an affine term; else it is subtracted from u.
        self._input_offset = 0.0 if config.absolute else design.elevator_trim_rad
        affine = -discrete.b * design.elevator_trim_rad if config.absolute else np.zeros(2)
        dt = 1.0 / control_hz
        disturbance = np.diag([(config.alpha_disturbance_rad_s * dt) ** 2, (config.q_disturbance_rad_s2 * dt) ** 2])
        # An error of the measured deflection changes the prediction by at most b (K = 1); it is treated as process noise.
        self._settings = filter_bank.pack_settings(
            Q=disturbance + noise.elevator_rad**2 * np.outer(discrete.b, discrete.b),
            x0=np.array([config.prior_alpha_rad, config.prior_q_rad_s, config.prior_effectiveness]),
            P0=np.diag([config.prior_alpha_var, config.prior_q_var, config.prior_effectiveness_var]),
            inflation=1.0 / config.forgetting if config.memory == "fading" else 1.0,
            begin=_BEGIN[config.prior_state],
            keep=config.smoothing,
            bounds=config.bounds,
            r=np.array([noise.alpha_rad**2, noise.q_rad_s**2]),
            model=np.column_stack([discrete.A, discrete.b, affine]),
            threshold=config.alarm_threshold,
            adaptive=config.follow_disturbances,
            hold_var=config.hold_std**2,
            offset=self._alpha_trim,
        )
        self._bank = filter_bank.new_bank(config.window if config.memory == "window" else 1)
        self._tick = 0
        self._at_start = config.input_at == "start"
        self._input = 3 if config.input_at == "mean" else 2  # field of Measurement
        self._before = 0.0
        # Compile, or load from the cache, before the flight; tick 0 resets the state.
        if self._schedule is None:
            filter_bank.tick(self._bank, self._settings, 0.0, 0.0, 0.0, 0)
        else:
            scheduled.tick(
                self._bank, self._settings, self._schedule, self._dt, 0.0, 0.0, 0.0, 0.0, 0.0, 0.6, 0.0, 0.0, 0.0, 0
            )

    def update(self, measurement: Measurement) -> Estimate:
        """Take the readings of the next tick, return the estimate that includes them."""
        # Access by index, and a tuple without its constructor, save a tenth of the estimator's time per tick.
        elevator, tick = measurement[self._input], self._tick
        self._tick = tick + 1
        if self._at_start:
            elevator, self._before = self._before, elevator
        if self._schedule is None:
            found = filter_bank.tick(
                self._bank,
                self._settings,
                elevator - self._input_offset,
                measurement[0] - self._alpha_trim,
                measurement[1],
                tick,
            )
        else:
            then = self._last or measurement
            self._last = measurement
            found = scheduled.tick(
                self._bank,
                self._settings,
                self._schedule,
                self._dt,
                elevator,
                measurement[0],
                measurement[1],
                then[0],
                then[1],
                then[4],
                then[5],
                then[6],
                then[7],
                tick,
            )
        return _new(Estimate, found + NOTHING_RECONSTRUCTED)

    def packed(self) -> Array:
        """Return the memory of ``observe``: wiring, settings, bank, schedule (empty without one)."""
        schedule = np.zeros(0) if self._schedule is None else self._schedule
        wiring = [self._dt, self._alpha_trim, self._input_offset, float(self._input == 3), float(self._at_start)]
        return np.concatenate([[*wiring, self._bank.shape[1]], self._settings, self._bank.ravel(), schedule])


class LoopGainPrior(EffectivenessPrior):
    """Prior of the filter.

    A fixed state is the prior at the first sample of the filter; ``first_reading`` decides whether the reading of that sample corrects it.
    """

    state: Literal["measurement", "fixed"] = "measurement"
    """Start of alpha and q: from the readings, or from the numbers below."""
    first_reading: Annotated[Literal["left-out", "used"], only_with(state="fixed")] = "left-out"
    """Whether the reading at the first sample corrects a fixed prior."""
    alpha_deg: Annotated[float, only_with(state="fixed")] = 0.0
    """Mean of alpha, deviation from trim."""
    q_deg_s: Annotated[float, only_with(state="fixed")] = 0.0
    """Mean of q, deviation from trim."""
    alpha_std_deg: Annotated[Positive, only_with(state="fixed")] = 1.0
    """Standard deviation of alpha."""
    q_std_deg_s: Annotated[Positive, only_with(state="fixed")] = 1.0
    """Standard deviation of q."""


class LoopGainSettings(EstimatorSettings):
    """Joint Kalman filter for alpha, q and K (Sillence Theorem 1): window, expanding or fading memory."""

    reads_accelerometer: ClassVar[bool] = False

    on_short_period: ClassVar[Mapping[str, Any]] = MappingProxyType(  # those of Sillence's thesis
        {
            "alarm_threshold": 0.0,
            "follow_disturbances": False,
            "hold_std": 0.0,
            "alpha_disturbance_deg_s": 0.6,
            "q_disturbance_deg_s2": 6.0,
        }
    )

    kind: Literal["loop-gain"] = "loop-gain"
    input: Literal["absolute", "deviation"] = "absolute"
    """Share of the elevator that K scales: the whole deflection, or its deviation from trim (model "short-period" only)."""
    input_at: Literal["mean", "start", "end"] = "mean"
    """Input over a sample: the mean deflection, or the reading at its start or end."""
    memory: Literal["window", "expanding", "fading"] = "window"
    """Readings that count: those of the window, all, or all with decreasing weights."""
    window: Annotated[int, between(2, 10000), only_with(memory="window")] = 30
    """Samples in the window."""
    forgetting: Annotated[float, between(0.5, 1), only_with(memory="fading")] = 0.98
    """Factor of the weights per tick; 1 forgets nothing."""
    alarm_threshold: Annotated[NonNegative, only_with(memory="window")] = 30.0
    """Threshold of the generalized likelihood ratio for a change of K; 0: no test. Default with model "short-period": 0."""
    follow_disturbances: bool = True
    """Raise the process noise to the level that the readings show. Default with model "short-period": false."""
    hold_std: NonNegative = 0.3
    """Standard deviation with which the last estimate is held when a window has little information; 0: the prior is used. Default with
    model "short-period": 0."""
    alpha_disturbance_deg_s: NonNegative = 0.05
    """Process noise of alpha: standard deviation of a rate, held for a tick. Default with model "short-period": 0.6."""
    q_disturbance_deg_s2: NonNegative = 0.3
    """Process noise of q: standard deviation of an acceleration, held for a tick. Default with model "short-period": 6."""
    prior: LoopGainPrior = LoopGainPrior()
    """Prior of the filter."""

    @property
    def detects_changes(self) -> bool:
        """Whether it has a test for a change of K."""
        return self.memory == "window" and self.alarm_threshold > 0.0

    @property
    def constant_over(self) -> int | None:
        """Ticks over which it takes K as constant; None: all since the start."""
        return self.window if self.memory == "window" else None

    def conflicts(self, place: str, surroundings: Surroundings) -> list[str]:  # noqa: ARG002
        """Return the problem of deviations from a trim point that the schedule does not have."""
        if self.model != "scheduled" or self.input != "deviation":
            return []
        return [
            f"{place}.input: must be 'absolute' with model = 'scheduled', which has no trim point (got 'deviation')"
        ]

    def build(self, onboard: OnBoard) -> LoopGain:
        """Return the estimator."""
        return LoopGain(self.config(), onboard)

    def config(self) -> LoopGainConfig:
        """Return the filter's settings in SI and radians."""
        prior = self.prior
        return LoopGainConfig(
            memory=self.memory,
            window=self.window,
            forgetting=self.forgetting,
            smoothing=self.smoothing,
            bounds=self.bounds,
            alarm_threshold=self.alarm_threshold,
            follow_disturbances=self.follow_disturbances,
            hold_std=self.hold_std,
            absolute=self.input == "absolute",
            input_at=self.input_at,
            scheduled=self.model == "scheduled",
            alpha_disturbance_rad_s=self.alpha_disturbance_deg_s * DEG,
            q_disturbance_rad_s2=self.q_disturbance_deg_s2 * DEG,
            prior_state="measurement"
            if prior.state == "measurement"
            else ("corrected" if prior.first_reading == "used" else "fixed"),
            prior_alpha_rad=prior.alpha_deg * DEG,
            prior_q_rad_s=prior.q_deg_s * DEG,
            prior_alpha_var=(prior.alpha_std_deg * DEG) ** 2,
            prior_q_var=(prior.q_std_deg_s * DEG) ** 2,
            prior_effectiveness=prior.effectiveness,
            prior_effectiveness_var=prior.effectiveness_std**2,
        )
