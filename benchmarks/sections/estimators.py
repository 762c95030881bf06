"""An update of each estimator, and of filterpy's Kalman filter for the same augmented state (alpha, q, K).

All get the readings of one flight, from Python, one measurement at a time. The plain filter (all data, the short-period model, no
tests) also exists in filterpy: the estimates of both are compared.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from filterpy.kalman import KalmanFilter
from measuring import Column, Effort, Table

from flightbed.avionics.onboard import OnBoard
from flightbed.config import kinds
from flightbed.core.signals import Measurement
from flightbed.core.timing import interleaved, ratios, seconds
from flightbed.estimation.base import Estimator
from flightbed.estimation.loop_gain.estimator import LoopGain, LoopGainConfig
from flightbed.flight.assembly import sensor_noise
from flightbed.flight.plan import Plan, plan
from flightbed.runs.run import fly
from flightbed.scenario.reading import load_scenario

from .loop import ESTIMATORS, SCENARIO

PLAIN = LoopGainConfig(memory="expanding", alpha_disturbance_rad_s=0.0, q_disturbance_rad_s2=0.0, bounds=(-9.0, 9.0))
THEIRS = "filterpy, plain filter"
_APART = 1e-9  # rad, rad/s and of K: more is not rounding


class _Theirs:
    """The same filter, built from filterpy's parts."""

    def __init__(self, onboard: OnBoard) -> None:
        self._design, noise = onboard.design, onboard.noise
        self._A, self._b = self._design.discrete(onboard.control_hz)
        self._known = np.array([*(self._b * self._design.elevator_trim_rad), 0.0])
        self._filter = KalmanFilter(dim_x=3, dim_z=2)
        self._filter.H, self._filter.R = np.eye(2, 3), np.diag([noise.alpha_rad**2, noise.q_rad_s**2])
        self._filter.Q = np.zeros((3, 3))
        self._filter.Q[:2, :2] = noise.elevator_rad**2 * np.outer(self._b, self._b)
        self._filter.F, self._begun = np.eye(3), False

    def update(self, m: Measurement) -> np.ndarray:
        z = np.array([m.alpha_rad - self._design.alpha_trim_rad, m.q_rad_s])
        if not self._begun:
            self._filter.x = np.array([*z, PLAIN.prior_effectiveness])
            self._filter.P = np.diag([*np.diag(self._filter.R), PLAIN.prior_effectiveness_var])
            self._begun = True
        else:
            self._filter.F[:2, :2], self._filter.F[:2, 2] = self._A, self._b * m.elevator_mean_rad
            self._filter.predict()
            self._filter.x = self._filter.x - self._known
            self._filter.update(z)
        x: np.ndarray = self._filter.x
        return x


def measure(effort: Effort) -> list[Table]:
    """Return the table of the estimators."""
    scenario = load_scenario(SCENARIO, ["seed=1", *effort.overrides])
    readings = [sample.measurement for sample in fly(scenario)]
    onboard = _onboard(plan(scenario))
    makers: dict[str, Callable[[], Estimator | _Theirs]] = {
        THEIRS: lambda: _Theirs(onboard),
        "plain filter": lambda: LoopGain(PLAIN, onboard),
        **{name: partial(_made, given, onboard) for name, given in ESTIMATORS.items()},
    }
    taken = interleaved({name: partial(_update_us, make, readings) for name, make in makers.items()}, effort.rounds)
    apart = _difference(onboard, readings)
    if not apart < _APART:
        raise RuntimeError(f"the plain filter and filterpy's are {apart:.1e} apart: not the same filter")
    return [
        Table(
            f"{len(readings)} readings of one flight of {SCENARIO}",
            (Column("an update", "us", ".2f"), Column("filterpy takes so many times as long", "1", ".1f")),
            {name: [times, None if name == THEIRS else ratios(taken[THEIRS], times)] for name, times in taken.items()},
            f"Largest difference of (alpha, q, K) between the plain filter and filterpy's, SI: {apart:.1e}.",
        )
    ]


def _onboard(planned: Plan) -> OnBoard:
    return OnBoard(planned.design, sensor_noise(planned.scenario), planned.scenario.rates.control_hz, planned.schedule)


def _made(given: Mapping[str, Any], onboard: OnBoard) -> Estimator:
    made: Estimator = kinds.ESTIMATORS.make(name="x", **given).build(onboard)
    return made


def _update_us(make: Callable[[], Estimator | _Theirs], readings: Sequence[Measurement]) -> float:
    """Return microseconds of the processor per update over the readings of a flight; the construction of the estimator is not included."""
    update = make().update

    def feed() -> None:
        for measurement in readings:
            update(measurement)

    return 1e6 * seconds(feed, clock=time.thread_time) / len(readings)


def _difference(onboard: OnBoard, readings: Sequence[Measurement]) -> float:
    """Return the largest difference between the plain filter and filterpy's over the readings."""
    ours, theirs, trim = LoopGain(PLAIN, onboard), _Theirs(onboard), onboard.design.alpha_trim_rad
    apart = 0.0
    for m in readings:
        e, x = ours.update(m), theirs.update(m)
        apart = max(apart, *np.abs(np.array([e.alpha_rad - trim, e.q_rad_s, e.effectiveness_raw]) - x).tolist())
    return apart
