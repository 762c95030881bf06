"""Reconstruction of the elevator's acting deflection from alpha and q as an unknown input, and K from it; an estimator.

The known part is the aircraft's own pitch motion, gravity and thrust: x+ = A x + b u + c, x = (alpha, q), both measured, at every tick
from the on-board schedule (or the short period at the trim point). u is unknown: command, position and K do not enter. Two methods
reconstruct it: ``retrospective_cost`` (Gupta and others 2012) and, for comparison, a Kalman filter with u as a random walk in its state
(``input_kalman``). ``regression`` then regresses it on the measured deflection: the slope is K, and a test detects deviations that no K
explains.

Departures from the paper: its examples optimize the input of the last sample only, H~ = -C B, which amounts to a difference quotient of
the noisy readings. Here the inputs of the last ``horizon`` samples are optimized together, and least squares fits all of them: the same
method with other Markov parameters retained.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import isfinite, nan

import numpy as np

from flightbed.avionics import pitch_kernels
from flightbed.avionics.onboard import OnBoard
from flightbed.core.actuator import ActuatorOnBoard
from flightbed.core.compiled import Array
from flightbed.core.signals import Estimate, Measurement
from flightbed.core.units import DEG
from flightbed.estimation.loop_gain import filter_bank
from flightbed.estimation.reconstruction import observers, regression
from flightbed.estimation.reconstruction.input_kalman import random_walk
from flightbed.estimation.reconstruction.input_model import InputModel
from flightbed.estimation.reconstruction.methods import (
    NOTHING,
    Method,
    RandomWalkMethod,
    RetrospectiveCostMethod,
    RetrospectiveSettings,
    WalkSettings,
)
from flightbed.estimation.reconstruction.observers import FAR
from flightbed.estimation.reconstruction.regression import FollowingConfig
from flightbed.estimation.reconstruction.regression_kernels import ALARMS, follow, restart


@dataclass(frozen=True)
class ReconstructionConfig:
    """Settings of the estimator.

    Attributes:
        method: settings of the method, which also select it.
        following: settings of the regression on the measured deflection, and of the test.
        scheduled: the model is the schedule, not the short period at the trim point.
        alpha_disturbance_rad_s, q_disturbance_rad_s2: as in LoopGainConfig.

    """

    method: RetrospectiveSettings | WalkSettings
    following: FollowingConfig = field(default_factory=FollowingConfig)
    scheduled: bool = True
    alpha_disturbance_rad_s: float = 0.05 * DEG
    q_disturbance_rad_s2: float = 0.3 * DEG


class PitchMotion:
    """On-board model of the pitch motion over one period, at a measurement.

    Args:
        onboard: on-board knowledge of the aircraft.
        scheduled: True: the schedule; False: the short period at the trim point.

    Raises:
        ValueError: the model is the schedule, but none is on board.

    """

    def __init__(self, onboard: OnBoard, *, scheduled: bool) -> None:
        if scheduled and onboard.schedule is None:
            raise ValueError("the estimator's model is the schedule, but there is none on board")
        self._schedule = onboard.schedule.packed() if scheduled and onboard.schedule else None
        self._dt, design = 1.0 / onboard.control_hz, onboard.design
        discrete, trim = design.discrete(onboard.control_hz), np.array([design.alpha_trim_rad, 0.0])
        affine = trim - discrete.A @ trim - discrete.b * design.elevator_trim_rad
        self._rows, self._work = np.column_stack([discrete.A, discrete.b, affine]), np.zeros((2, 4))

    def packed(self) -> tuple[dict[str, float], tuple[Array, Array], Array]:
        """Return values of the head of ``observers``, its arrays of the model, and the schedule (empty without one)."""
        schedule = np.zeros(0) if self._schedule is None else self._schedule
        values = {"is_scheduled": float(schedule.size > 0), "dt": self._dt}
        return values, (self._rows, self._work), schedule

    def rows(self, m: Measurement, acting_rad: float) -> Array:
        """Return (2, 4), [A | b | c] of x+ = A x + b u + c, x = (alpha, q), u the deflection that acts, linearized at ``acting_rad``.

        The next call overwrites the array.
        """
        if self._schedule is not None:
            pitch_kernels.local_model(
                self._schedule, self._rows, self._work, 1.0, self._dt, m.alpha_rad, m.q_rad_s, acting_rad,
                m.mach, m.altitude_m, m.theta_rad, m.phi_rad, 0.0,
            )  # fmt: skip
        return self._rows


class Disturbances:
    """Disturbances estimated from the readings, as in ``filter_bank.disturbance``, in standard deviations of the sensors; owns its sums."""

    def __init__(self) -> None:
        self._bank, self._settings, self._tick = filter_bank.new_bank(1), np.ones(23), 0
        for row in (filter_bank.SMOOTHED, filter_bank.SQUARE_ALPHA, filter_bank.SQUARE_RATE):
            self._bank[row, 0] = 1.0

    def packed(self) -> tuple[Array, Array]:
        """Return bank and settings of ``filter_bank.disturbance``."""
        return self._bank, self._settings

    def variances(self, model: InputModel, acting: float, y: Array) -> Array:
        """Return the variances (2,) of the disturbances of alpha and q in a tick.

        Args:
            model: model of the period that ends now.
            acting: deflection that K and o explain, deg.
            y: (2,) readings at the end of the period.

        """
        rows = np.column_stack([model.A, model.B, model.G])
        more = filter_bank.disturbance(self._bank, self._settings, rows, acting, y[0], y[1], self._tick)
        self.at(y)
        return np.array(more)

    def at(self, y: Array) -> None:
        """Take the readings (2,) at the start of a period."""
        self._bank[filter_bank.LAST_ALPHA, 0], self._bank[filter_bank.LAST_RATE, 0] = y
        self._tick += 1


class ElevatorReconstruction:
    """The acting deflection by one of the methods, K by regression, and the test; an Estimator, and Commanded.

    Only the test uses the commands. ``alarms`` counts the declared deviations that no K explains; ``verdict`` is the kind of the present
    one: ``regression_kernels.OFFSET`` (the acting deflection does not follow the measured one: a bias, or a detached surface) or
    ``regression_kernels.ACTUATOR`` (the measured deflection does not follow the command: stuck, hardover, rate-limited).

    Args:
        config: settings.
        onboard: on-board knowledge of aircraft and sensors; without an actuator the commands are not used.

    Raises:
        ValueError: the model is the schedule, but none is on board.

    """

    readings = 2.0
    compiled_update = staticmethod(observers.observe_elevator)

    def __init__(self, config: ReconstructionConfig, onboard: OnBoard) -> None:
        noise, dt = onboard.noise, 1.0 / onboard.control_hz
        self._config = config
        self._motion = PitchMotion(onboard, scheduled=config.scheduled)
        self._sigma = np.array([noise.alpha_rad, noise.q_rad_s])
        disturbed = np.array([config.alpha_disturbance_rad_s, config.q_disturbance_rad_s2]) * dt / self._sigma
        self._Q = disturbed**2
        self._method: Method
        if isinstance(config.method, WalkSettings):
            self._method = RandomWalkMethod(config.method, self._Q)
        else:
            self._method = RetrospectiveCostMethod(config.method.config(DEG))
        self._settings = regression.packed(config.following, noise.elevator_rad)
        self._window = config.following.window
        self._actuator = (
            ActuatorOnBoard(onboard.actuator, onboard.control_hz, onboard.delay_ticks) if onboard.actuator else None
        )
        self._follows = config.following.follow_disturbances
        self._reset(config)
        for _ in range(2):  # compile, or load from the cache, before the flight
            self.update(Measurement(0.0, 0.0, 0.0, 0.0, 0.6, 0.0, 0.0, 0.0))
        assert self._before is not None
        self._rough.variances(self._before, 0.0, np.zeros(2))
        restart(self._memory, self._window)
        self._reset(config)

    def _reset(self, config: ReconstructionConfig) -> None:
        self._memory = regression.begin(self._method.states, config.following)
        self._rough, self._acting, self._explained = Disturbances(), 0.0, (1.0, 0.0)
        self._before: InputModel | None = None
        self._tick, self._lost = 0, False

    def _model(self, m: Measurement) -> InputModel:
        """Return the model of the period that starts now, readings in standard deviations and the input in deg."""
        sigma = self._sigma
        scaled = self._motion.rows(m, self._acting) / sigma[:, None]
        return InputModel(scaled[:, :2] * sigma, scaled[:, 2:3] * DEG, np.eye(2), scaled[:, 3:4])

    def packed(self) -> Array | None:
        """Return the memory of ``observers.observe_elevator``; None for a retrospective cost without regularization."""
        method, n = self._config.method, self._method.states
        values, model, schedule = self._motion.packed()
        if isinstance(method, WalkSettings):
            walk = random_walk(1, step_std=method.step_rad / DEG, initial_std=method.initial_rad / DEG)
            memory = observers.walk_memory(np.diag(self._Q), NOTHING * np.eye(2), walk)
            values |= {"is_walk": 1.0}
            F, G = np.zeros((n, n)), np.zeros((n, 2))
        else:
            config = method.config(DEG)
            if config.regularization <= 0.0:
                return None
            assert isinstance(self._method, RetrospectiveCostMethod)
            memory, (F, G) = observers.retrospective_memory(2, config), self._method.propagation
            values |= {
                "order": config.order, "horizon": method.horizon, "initial_covariance": config.initial_covariance,
            }  # fmt: skip
        values |= dict(zip(("sigma_alpha", "sigma_q"), self._sigma.tolist(), strict=True))
        values |= dict(zip(("process_alpha", "process_q"), self._Q.tolist(), strict=True))
        values |= {
            "states": n,
            "window": self._window,
            "follows": float(self._follows),
            "method": memory.size,
            "slope": 1.0,
        }
        queue = np.zeros(0)
        if self._actuator is not None:
            values |= self._actuator.packed()
            queue = np.zeros(int(values["delay"]))
        following = regression.begin(n, self._config.following)
        return observers.pack(
            values,
            queue,
            *model,
            np.zeros((2, 4)),
            *Disturbances().packed(),
            self._settings,
            *following,
            F,
            G,
            memory,
            schedule,
        )

    def commanded(self, elevator_cmd_rad: float) -> None:
        """Take the command of the period that starts now, rad."""
        if self._actuator is not None:
            self._actuator.commanded(elevator_cmd_rad)

    def update(self, measurement: Measurement) -> Estimate:
        """Take the readings of the next tick, return the estimate that includes them; nan, except alarms, if a reading is not finite."""
        m = measurement
        asked = self._actuator.mean() / DEG if self._actuator is not None else nan
        model, y = self._model(m), np.array([m.alpha_rad, m.q_rad_s]) / self._sigma
        process, deflection = self._Q, m.elevator_mean_rad / DEG
        if not isfinite(float(model.A.sum() + model.B.sum() + model.G.sum() + y.sum()) + deflection):
            self._lost = True
            return Estimate(nan, nan, nan, nan, nan, nan, nan, alarms=float(self._memory.marks[ALARMS]))
        if self._lost:  # restart, keeping K
            self._lost, self._before = False, None
            restart(self._memory, self._window)
        if self._before is None:
            self._method.begin(model, y)
        if self._before is not None and self._follows and self._tick >= self._window:
            process = process + self._rough.variances(
                self._before, self._explained[0] * deflection + self._explained[1], y
            )
        else:
            self._rough.at(y)
        self._before, self._tick = model, self._tick + 1
        found = self._method.take(model, y)
        if not (isfinite(found.input) and np.all(np.abs(found.innovation) < FAR)):
            self._method.begin(model, y)
            found = self._method.take(model, y)
            restart(self._memory, self._window)
        estimate = follow(
            *self._memory, self._settings, found.F, found.G, process, model.B[:, 0], found.innovation, found.input,
            deflection, asked,
        )  # fmt: skip
        self._explained = estimate.slope, estimate.offset
        self._acting = min(max(found.input, -90.0), 90.0) * DEG
        state, (alpha, q) = found.state * self._sigma, self._sigma
        return Estimate(
            effectiveness=estimate.effectiveness,
            effectiveness_std=estimate.effectiveness_std,
            effectiveness_smoothed=estimate.effectiveness_smoothed,
            effectiveness_raw=estimate.effectiveness_raw,
            alpha_rad=float(state[0]),
            q_rad_s=float(state[1]),
            nis=estimate.nis,
            alarms=estimate.alarms,
            innovation_alpha_rad=estimate.innovation_alpha * alpha,
            innovation_q_rad_s=estimate.innovation_q * q,
            innovation_alpha_std_rad=estimate.innovation_alpha_std * alpha,
            innovation_q_std_rad_s=estimate.innovation_q_std * q,
            reconstructed_rad=found.input * DEG,
            reconstructed_std_rad=estimate.noise_std * DEG,
            offset_rad=estimate.offset * DEG,
            offset_std_rad=estimate.offset_std * DEG,
            verdict=estimate.verdict,
        )
