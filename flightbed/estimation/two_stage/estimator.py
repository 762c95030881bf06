"""The two-stage filter on the aircraft: effectiveness of the elevator, or of elevator, aileron and rudder (Wu and others 2000)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import sqrt
from types import MappingProxyType
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

import numpy as np

from flightbed.avionics import lateral_kernels, pitch_kernels
from flightbed.avionics.onboard import OnBoard
from flightbed.config.kinds import EstimatorSettings, Surroundings
from flightbed.config.table import NonNegative, Positive, Settings, between, only_with
from flightbed.core.compiled import Array, compiled
from flightbed.core.records import layout, record, size
from flightbed.core.signals import SURFACES, Estimate, LateralMeasurement, Measurement
from flightbed.core.units import DEG
from flightbed.estimation.packed import LATERAL_MEASUREMENT, MEASUREMENT
from flightbed.estimation.two_stage.change_test import chi_square_threshold
from flightbed.estimation.two_stage.filter import (
    ConstantForgetting,
    Forgetting,
    NoForgetting,
    VariableForgetting,
    correct,
    predict,
)


@dataclass(frozen=True)
class SurfacesConfig:
    """Settings of the two-stage filter on the aircraft. SI, radians.

    Attributes:
        forgetting: forgetting of gamma, see ``two_stage``.
        walk_std: standard deviation of the step of gamma per tick, square root of Q_gamma in W eq (6).
        test_window: L of W eq (33), ticks.
        false_alarm: nominal probability of an alarm of the test at a tick, by the chi-square law; ``change_test`` states the limits of
            this law.
        smoothing, bounds: as in LoopGainConfig.
        prior_std: standard deviation of gamma at the start.
        follow_disturbances: increase the process noise to the level shown by the readings.
        scheduled: pitch axis from the schedule, otherwise from the short period; with aileron and rudder commanded, always from tables.
        disturbances: standard deviations of unmodelled rates, white, each held for a tick: of alpha (rad/s), q (rad/s^2), beta (rad/s),
            p and r (rad/s^2).

    """

    forgetting: Forgetting
    walk_std: float = 1e-4
    test_window: int = 3
    false_alarm: float = 1e-6
    smoothing: float = 0.9
    bounds: tuple[float, float] = (0.0, 1.0)
    prior_std: float = 0.63
    follow_disturbances: bool = True
    scheduled: bool = True
    disturbances: tuple[float, float, float, float, float] = (0.05 * DEG, 0.3 * DEG, 0.05 * DEG, 1.0 * DEG, 0.3 * DEG)


class _State(NamedTuple):
    """State of a filter of n states and l inputs; all arrays, changed in place.

    Attributes:
        x, V, Px, gamma, Pg: the two stages, (n,), (n, l), (n, n), (l,), (l, l).
        sums, squares, last: leaky sums of residuals, their mean squares, last readings, (n,) each.
        smoothed, raised, alarms: smoothed K-hat, whether the test is above its threshold, number of alarms, (l,) each.
        terms: (L, l), terms of the test's mean.

    """

    x: Array
    V: Array
    Px: Array
    gamma: Array
    Pg: Array
    sums: Array
    squares: Array
    last: Array
    smoothed: Array
    raised: Array
    alarms: Array
    terms: Array


class _Settings(NamedTuple):
    """Settings of a filter: covariances (n, n), (l, l), (n, n); forgetting; (threshold, smoothing, low, high, follows disturbances)."""

    Q: Array
    Q_gamma: Array
    R: Array
    forgetting: Array
    scalars: Array


_FORGETTING = 3  # numbers of the forgetting
# Indices into a row of ``advance``, the first fields of an Estimate, and their number.
(
    EFFECTIVENESS, STD, SMOOTHED, RAW, ALPHA, RATE, NIS, ALARMS, ERROR_ALPHA, ERROR_RATE, ERROR_STD_ALPHA, ERROR_STD_RATE, FIELDS,
) = range(13)  # fmt: skip
THRESHOLD, SMOOTHING, LOWEST, HIGHEST, FOLLOWS, _SCALARS = range(6)  # indices into the scalars, and their number
_LEAK = 1.0 - 1.0 / 15.0


@compiled
def _disturbances(
    state: _State, settings: _Settings, A: Array, B: Array, c: Array, u: Array, z: Array, k: int
) -> Array:
    """Return the variances of disturbances estimated from the readings, (n,), to add to Q, so that sigma and test are valid in rough air.

    The residual of one step between readings, e = z - (A z_last + B K u + c), contains the disturbances; in a leaky sum over about 15
    ticks the sensor noise, which enters as differences, nearly cancels, and lasting gusts accumulate. The mean square of this sum over
    the last seconds, minus the share of the sensors, gives the variance of the equivalent white noise. As
    ``filter_bank.disturbance``, for n states.
    """
    slow = max(1.0 / 300.0, 1.0 / (k + 20.0))
    found = np.zeros(z.size)
    for i in range(z.size):
        predicted = c[i]
        for j in range(z.size):
            predicted += A[i, j] * state.last[j]
        for j in range(u.size):
            predicted += B[i, j] * state.smoothed[j] * u[j]
        r = settings.R[i, i]
        state.sums[i] = _LEAK * state.sums[i] + z[i] - predicted
        seen = min(state.sums[i] ** 2, 4.0 * (state.squares[i] + r))
        state.squares[i] += slow * (seen - state.squares[i])
        found[i] = max(0.0, (1.0 - _LEAK * _LEAK) * (state.squares[i] - 1.6 * r))
    return found


@compiled
def advance(
    state: _State, settings: _Settings, A: Array, B: Array, c: Array, u: Array, z: Array, offset: float, k: int
) -> Array:
    """Take the readings of tick k; return (l, 12), one row per input with the fields of an Estimate.

    Args:
        state, settings: state, updated, and settings of the filter.
        A, B, c: model of the period that ends now, (n, n), (n, l), (n,).
        u: (l,) mean deflections over this period.
        z: (n,) readings of all states.
        offset: added to the returned first state.
        k: number of the tick; 0 resets the filter.

    """
    n, inputs = z.size, u.size
    threshold, keep, low, high = (
        settings.scalars[THRESHOLD],
        settings.scalars[SMOOTHING],
        settings.scalars[LOWEST],
        settings.scalars[HIGHEST],
    )
    innovation, S, nis = np.zeros(n), np.zeros((n, n)), 0.0
    if k == 0:
        state.x[:], state.V[:, :], state.Px[:, :] = z, 0.0, settings.R
    else:
        Q = settings.Q.copy()
        if settings.scalars[FOLLOWS] > 0.0:
            more = _disturbances(state, settings, A, B, c, u, z, k)
            for i in range(n):
                Q[i, i] += more[i]
        x, V, Px, Pg = predict(
            state.x, state.V, state.Px, state.gamma, state.Pg, A, B, u, c, Q, settings.Q_gamma, settings.forgetting
        )
        x, V, Px, gamma, Pg, innovation, S, nis = correct(x, V, Px, state.gamma, Pg, np.eye(n), settings.R, z)
        state.x[:], state.V[:, :], state.Px[:, :], state.gamma[:], state.Pg[:, :] = x, V, Px, gamma, Pg
    state.last[:] = z
    L = state.terms.shape[0]
    rows = np.zeros((inputs, FIELDS))
    compensated = state.x + state.V @ state.gamma
    for i in range(inputs):
        state.terms[k % L, i] = state.gamma[i] ** 2 / state.Pg[i, i]
        above = 1.0 if np.mean(state.terms[:, i]) > threshold else 0.0
        if above > state.raised[i]:
            state.alarms[i] += 1.0
            state.sums[:] = 0.0  # the sums contain the change of K, not disturbances
        state.raised[i] = above
        raw = 1.0 + state.gamma[i]
        bounded = min(max(raw, low), high)
        state.smoothed[i] = keep * state.smoothed[i] + (1.0 - keep) * bounded
        rows[i, EFFECTIVENESS], rows[i, STD], rows[i, SMOOTHED], rows[i, RAW] = (
            bounded,
            sqrt(state.Pg[i, i]),
            state.smoothed[i],
            raw,
        )
        rows[i, ALPHA], rows[i, RATE], rows[i, NIS] = compensated[0] + offset, compensated[1], nis
        rows[i, ERROR_ALPHA], rows[i, ERROR_RATE], rows[i, ERROR_STD_ALPHA], rows[i, ERROR_STD_RATE] = (
            innovation[0],
            innovation[1],
            sqrt(S[0, 0]),
            sqrt(S[1, 1]),
        )
    for i in range(inputs):
        rows[i, ALARMS] = state.alarms[i]
    return rows


_DIMENSIONS = layout(("states", "inputs", "terms", "dt", "alpha_trim", "is_scheduled", "tables"))
_AFTER = size(_DIMENSIONS)


@compiled
def _arrays(memory: Array, n: int, inputs: int, terms: int) -> tuple[_State, _Settings, int]:
    """Return state and settings of a memory, and the index of what follows them; the order is that of ``_Filter.packed``."""
    a = _AFTER
    square, wide, small = n * n, n * inputs, inputs * inputs
    Q, a = memory[a : a + square].reshape((n, n)), a + square
    Q_gamma, a = memory[a : a + small].reshape((inputs, inputs)), a + small
    R, a = memory[a : a + square].reshape((n, n)), a + square
    forgetting, a = memory[a : a + _FORGETTING], a + _FORGETTING
    scalars, a = memory[a : a + _SCALARS], a + _SCALARS
    x, a = memory[a : a + n], a + n
    V, a = memory[a : a + wide].reshape((n, inputs)), a + wide
    Px, a = memory[a : a + square].reshape((n, n)), a + square
    gamma, a = memory[a : a + inputs], a + inputs
    Pg, a = memory[a : a + small].reshape((inputs, inputs)), a + small
    sums, a = memory[a : a + n], a + n
    squares, a = memory[a : a + n], a + n
    last, a = memory[a : a + n], a + n
    smoothed, a = memory[a : a + inputs], a + inputs
    raised, a = memory[a : a + inputs], a + inputs
    alarms, a = memory[a : a + inputs], a + inputs
    tested, a = memory[a : a + terms * inputs].reshape((terms, inputs)), a + terms * inputs
    state = _State(x, V, Px, gamma, Pg, sums, squares, last, smoothed, raised, alarms, tested)
    return state, _Settings(Q, Q_gamma, R, forgetting, scalars), a


@compiled
def _write(rows: Array, out: Array) -> None:
    """Write the rows of ``advance`` into consecutive estimates."""
    width = out.size // rows.shape[0]
    for i in range(rows.shape[0]):
        out[i * width : i * width + rows.shape[1]] = rows[i]


@compiled
def observe_pitch(
    memory: Array, now: Array, then: Array, _turning: Array, _turned: Array, _command: float, k: int, out: Array
) -> None:
    """Take the readings of tick k: ``TwoStagePitch.update`` for compiled callers; see ``packed.Packable``."""
    head = record(memory, 0, _DIMENSIONS)
    state, settings, a = _arrays(memory, int(head.states), int(head.inputs), int(head.terms))
    model, work, schedule = memory[a : a + 8].reshape((2, 4)), memory[a + 8 : a + 16].reshape((2, 4)), memory[a + 16 :]
    m, before = record(now, 0, MEASUREMENT), record(then, 0, MEASUREMENT)
    if head.is_scheduled > 0.0 and k > 0:
        pitch_kernels.local_model(
            schedule, model, work, state.smoothed[0], head.dt, before.alpha_rad, before.q_rad_s, m.elevator_mean_rad,
            before.mach, before.altitude_m, before.theta_rad, before.phi_rad, 0.0,
        )  # fmt: skip
    A, B, c = model[:, :2].copy(), model[:, 2:3].copy(), model[:, 3].copy()
    u, z = np.empty(1), np.empty(2)
    u[0] = m.elevator_mean_rad
    z[0], z[1] = m.alpha_rad - head.alpha_trim, m.q_rad_s
    _write(advance(state, settings, A, B, c, u, z, head.alpha_trim, k), out)


@compiled
def observe_surfaces(
    memory: Array, now: Array, then: Array, turning: Array, turned: Array, _command: float, k: int, out: Array
) -> None:
    """Take the readings of tick k: ``TwoStageSurfaces.update_all`` for compiled callers; see ``packed.Packable``."""
    head = record(memory, 0, _DIMENSIONS)
    state, settings, a = _arrays(memory, int(head.states), int(head.inputs), int(head.terms))
    work, a = memory[a : a + 90].reshape((10, 9)), a + 90
    tables, schedule = memory[a : a + int(head.tables)], memory[a + int(head.tables) :]
    m, before = record(now, 0, MEASUREMENT), record(then, 0, MEASUREMENT)
    side, aside = record(turning, 0, LATERAL_MEASUREMENT), record(turned, 0, LATERAL_MEASUREMENT)
    if k > 0:
        lateral_kernels.local_model(
            schedule, tables, work, state.smoothed[0], head.dt, m.elevator_mean_rad, before.alpha_rad, before.q_rad_s,
            before.mach, before.altitude_m, before.theta_rad, before.phi_rad, aside.beta_rad, aside.p_rad_s, aside.r_rad_s,
        )  # fmt: skip
    A, B, c = work[:5, :5].copy(), work[:5, 5:8].copy(), work[:5, 8].copy()
    u, z = np.empty(3), np.empty(5)
    u[0], u[1], u[2] = m.elevator_mean_rad, side.aileron_mean_rad, side.rudder_mean_rad
    z[0], z[1], z[2], z[3], z[4] = m.alpha_rad, m.q_rad_s, side.beta_rad, side.p_rad_s, side.r_rad_s
    _write(advance(state, settings, A, B, c, u, z, 0.0, k), out)


class _Filter:
    """Filter, test and smoother for l inputs; the first two states are alpha and q."""

    def __init__(self, config: SurfacesConfig, noise: Array, b: Array, dt: float) -> None:
        n, inputs = len(noise), b.shape[1]
        disturbed = np.array(config.disturbances[:n]) * dt
        R = np.diag(noise**2)
        threshold = chi_square_threshold(config.test_window, config.false_alarm)
        # An error of a measured deflection changes the prediction by at most b (K = 1); it is treated as process noise.
        self._settings = _Settings(
            Q=np.diag(disturbed**2) + b @ b.T,
            Q_gamma=config.walk_std**2 * np.eye(inputs),
            R=R,
            forgetting=config.forgetting.packed(),
            scalars=np.array([threshold, config.smoothing, *config.bounds, float(config.follow_disturbances)]),
        )
        self._state = self._fresh(n, inputs, config)
        self._k = 0
        # Compile, or load from the cache, before the flight.
        trial, still = self._fresh(n, inputs, config), np.zeros(n)
        for k in (0, 1):
            advance(trial, self._settings, np.eye(n), np.zeros((n, inputs)), still, np.zeros(inputs), still, 0.0, k)

    def _fresh(self, n: int, inputs: int, config: SurfacesConfig) -> _State:
        R = self._settings.R
        return _State(
            np.zeros(n), np.zeros((n, inputs)), R.copy(), np.zeros(inputs), config.prior_std**2 * np.eye(inputs),
            np.zeros(n), np.diag(R).copy(), np.zeros(n),
            np.ones(inputs), np.zeros(inputs), np.zeros(inputs), np.zeros((config.test_window, inputs)),
        )  # fmt: skip

    @property
    def smoothed(self) -> float:
        """Smoothed K-hat of the elevator."""
        return float(self._state.smoothed[0])

    def packed(self, *more: Array, dt: float, alpha_trim: float = 0.0, tables: int = 0) -> Array:
        """Return the memory of ``observe_pitch`` or ``observe_surfaces``; ``more`` follows state and settings."""
        terms, inputs = self._state.terms.shape
        head = [len(self._state.x), inputs, terms, dt, alpha_trim, float(more[-1].size > 0), tables]
        arrays = (np.array(head, dtype=np.float64), *self._settings, *self._state, *more)
        return np.concatenate([array.ravel() for array in arrays])

    def take(self, readings: Array, A: Array, B: Array, c: Array, u: Array, offset: float) -> list[Estimate]:
        """Return the estimates of all inputs at the next tick; ``offset`` is added to alpha."""
        rows = advance(self._state, self._settings, A, B, c, u, readings, offset, self._k)
        self._k += 1
        return [Estimate(*row) for row in rows.tolist()]


def _parts(model: Array, n: int, inputs: int) -> tuple[Array, Array, Array]:
    """Return A, B and c of [A | B | c]."""
    rows = model[:n]
    return rows[:, :n].copy(), rows[:, n : n + inputs].copy(), rows[:, n + inputs].copy()


class TwoStagePitch:
    """The two-stage filter of (alpha, q) and the elevator's effectiveness; an Estimator.

    Args:
        config: settings.
        onboard: on-board knowledge of aircraft and sensors.

    Raises:
        ValueError: the model is the schedule, but none is on board.

    """

    readings = 2.0
    compiled_update = staticmethod(observe_pitch)

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
            pitch_kernels.local_model(
                self._schedule, self._model, self._work, 1.0, self._dt, 0.0, 0.0, 0.0, 0.6, 0.0, 0.0, 0.0, 0.0
            )

    def packed(self) -> Array:
        """Return the memory of ``observe_pitch``."""
        schedule = np.zeros(0) if self._schedule is None else self._schedule
        return self._filter.packed(self._model, self._work, schedule, dt=self._dt, alpha_trim=self._alpha_trim)

    def update(self, measurement: Measurement) -> Estimate:
        """Take the readings of the next tick, return the estimate that includes them."""
        m, model = measurement, self._model
        if self._schedule is not None and self._last is not None:
            then = self._last
            pitch_kernels.local_model(
                self._schedule, model, self._work, self._filter.smoothed, self._dt, then.alpha_rad, then.q_rad_s,
                m.elevator_mean_rad, then.mach, then.altitude_m, then.theta_rad, then.phi_rad, 0.0,
            )  # fmt: skip
        self._last = m
        readings = np.array([m.alpha_rad - self._alpha_trim, m.q_rad_s])
        u = np.array([m.elevator_mean_rad])
        return self._filter.take(readings, *_parts(model, 2, 1), u, self._alpha_trim)[0]


class TwoStageSurfaces:
    """The two-stage filter of (alpha, q, beta, p, r) and the effectiveness of all three surfaces; a SurfacesEstimator.

    Args:
        config: settings.
        onboard: on-board knowledge of aircraft and sensors.

    Raises:
        ValueError: the schedule or the model of roll and yaw is not on board.

    """

    readings = 5.0
    surfaces: tuple[str, ...] = SURFACES
    compiled_update = staticmethod(observe_surfaces)

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
        lateral_kernels.local_model(
            self._schedule, self._tables, self._work, 1.0, self._dt, 0.0, 0.0, 0.0, 0.6, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        )

    def packed(self) -> Array:
        """Return the memory of ``observe_surfaces``."""
        tables = self._tables
        return self._filter.packed(self._work, tables, self._schedule, dt=self._dt, tables=tables.size)

    def update_all(self, measurement: Measurement, lateral: LateralMeasurement) -> Sequence[Estimate]:
        """Take the readings of the next tick, return the estimates of elevator, aileron and rudder that include them."""
        m, turning, work = measurement, lateral, self._work
        if self._last is not None:
            then, turned = self._last
            lateral_kernels.local_model(
                self._schedule, self._tables, work, self._filter.smoothed, self._dt, m.elevator_mean_rad,
                then.alpha_rad, then.q_rad_s, then.mach, then.altitude_m, then.theta_rad, then.phi_rad,
                turned.beta_rad, turned.p_rad_s, turned.r_rad_s,
            )  # fmt: skip
        self._last = m, turning
        readings = np.array([m.alpha_rad, m.q_rad_s, turning.beta_rad, turning.p_rad_s, turning.r_rad_s])
        u = np.array([m.elevator_mean_rad, turning.aileron_mean_rad, turning.rudder_mean_rad])
        return self._filter.take(readings, *_parts(work, 5, 3), u, 0.0)


class TwoStagePrior(Settings):
    """Prior of K, whose mean is 1."""

    effectiveness_std: Positive = 0.63
    """Standard deviation of K."""


class TwoStageSettings(EstimatorSettings):
    """Two-stage Kalman filter with forgetting (Wu, Zhang and Zhou 2000): of the elevator, or of all commanded surfaces."""

    reads_accelerometer: ClassVar[bool] = False

    on_short_period: ClassVar[Mapping[str, Any]] = MappingProxyType(
        {"follow_disturbances": False, "alpha_disturbance_deg_s": 0.6, "q_disturbance_deg_s2": 6.0}
    )

    kind: Literal["two-stage"] = "two-stage"
    memory: Literal["expanding", "fading", "variable"] = "variable"
    """Forgetting of K: none, constant, or variable, which keeps the variance within limits."""
    window: Annotated[int, between(2, 10000)] = 3
    """L, the number of samples that the test for a loss averages."""
    forgetting: Annotated[float, between(0.5, 1), only_with(memory="fading")] = 0.98
    """Forgetting factor per tick; 1 forgets nothing."""
    variance_min: Annotated[Positive, only_with(memory="variable")] = 2e-5
    """Variance of K, along each principal axis of the covariance, that forgetting keeps at least."""
    variance_max: Annotated[Positive, only_with(memory="variable")] = 1.0
    """Variance of K above which forgetting stops."""
    walk_std: NonNegative = 1e-4
    """Standard deviation of the random walk of K per tick."""
    false_alarm: Annotated[float, between(0, 0.5, open_low=True)] = 1e-6
    """Probability of an alarm per tick and surface, by the chi-square law, which is exact for independent estimates only."""
    follow_disturbances: bool = True
    """Raise the process noise to the level that the readings show. Default with model "short-period": false."""
    alpha_disturbance_deg_s: NonNegative = 0.05
    """Process noise of alpha: standard deviation of a rate, held for a tick. Default with model "short-period": 0.6."""
    q_disturbance_deg_s2: NonNegative = 0.3
    """Process noise of q: standard deviation of an acceleration, held for a tick. Default with model "short-period": 6."""
    beta_disturbance_deg_s: NonNegative = 0.05
    """Process noise of the sideslip: standard deviation of a rate; with lateral.enabled."""
    p_disturbance_deg_s2: NonNegative = 1.0
    """Process noise of the roll rate: standard deviation of an acceleration; with lateral.enabled."""
    r_disturbance_deg_s2: NonNegative = 0.3
    """Process noise of the yaw rate: standard deviation of an acceleration; with lateral.enabled."""
    prior: TwoStagePrior = TwoStagePrior()
    """Prior of K."""

    @property
    def detects_changes(self) -> bool:
        """Whether it has a test for a change of K."""
        return True

    @property
    def constant_over(self) -> int | None:
        """Ticks over which it takes K as constant: K is a random walk, and all readings count."""
        return None

    def estimates(self, *, lateral: bool) -> tuple[str, ...]:
        """Return the surfaces whose effectiveness it estimates: all that are commanded."""
        return SURFACES if lateral else SURFACES[:1]

    def idle(self, place: str, surroundings: Surroundings) -> dict[str, str]:
        """Return the keys of roll and yaw without effect."""
        keys = ("beta_disturbance_deg_s", "p_disturbance_deg_s2", "r_disturbance_deg_s2")
        return {} if surroundings.lateral else {f"{place}.{key}": "lateral.enabled = false" for key in keys}

    def conflicts(self, place: str, surroundings: Surroundings) -> list[str]:
        """Return the problems of limits that do not rise, and of a model that has no roll and yaw."""
        problems = []
        if self.memory == "variable" and not self.variance_min < self.variance_max:
            problems.append(
                f"{place}.variance_min: must be below variance_max = {self.variance_max:g} (got {self.variance_min:g})"
            )
        if surroundings.lateral and self.model != "scheduled":
            problems.append(
                f"{place}.model: must be 'scheduled' with kind = '{self.kind}' and lateral.enabled = true (got '{self.model}')"
            )
        return problems

    def build(self, onboard: OnBoard) -> TwoStagePitch | TwoStageSurfaces:
        """Return the estimator of the elevator, or of all surfaces if the model of roll and yaw is on board."""
        forgetting: Forgetting = NoForgetting()
        if self.memory == "fading":
            forgetting = ConstantForgetting(self.forgetting)
        elif self.memory == "variable":
            forgetting = VariableForgetting(self.variance_min, self.variance_max)
        config = SurfacesConfig(
            forgetting=forgetting,
            walk_std=self.walk_std,
            test_window=self.window,
            false_alarm=self.false_alarm,
            smoothing=self.smoothing,
            bounds=self.bounds,
            prior_std=self.prior.effectiveness_std,
            follow_disturbances=self.follow_disturbances,
            scheduled=self.model == "scheduled",
            disturbances=(
                self.alpha_disturbance_deg_s * DEG,
                self.q_disturbance_deg_s2 * DEG,
                self.beta_disturbance_deg_s * DEG,
                self.p_disturbance_deg_s2 * DEG,
                self.r_disturbance_deg_s2 * DEG,
            ),
        )
        return TwoStagePitch(config, onboard) if onboard.lateral is None else TwoStageSurfaces(config, onboard)
