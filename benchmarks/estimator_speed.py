"""Microseconds per update of the estimators, and of filterpy's Kalman filter for the same augmented state (alpha, q, K).

    python benchmarks/estimator_speed.py [--rounds 9]

All are fed the readings of one flight of 16.5 s, from Python, one measurement at a time, and take turns; medians over the rounds with their
range, ratios taken round by round. The plain filter (all data, the short-period model, no tests) is the one that filterpy has too: its
estimates are compared as well.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable, Sequence

import numpy as np
from filterpy.kalman import KalmanFilter

from flightbed.assembly import sensor_noise
from flightbed.estimation.base import Estimator, OnBoard
from flightbed.estimation.loop_gain import LoopGain, LoopGainConfig
from flightbed.factories import differentiated_rls, loop_gain
from flightbed.mission import fly, plan
from flightbed.plan import Plan
from flightbed.scenario import load_scenario
from flightbed.settings import EstimatorSettings
from flightbed.signals import Measurement

PLAIN = LoopGainConfig(memory="expanding", alpha_disturbance_rad_s=0.0, q_disturbance_rad_s2=0.0, bounds=(-9.0, 9.0))


class _Theirs:
    """The same filter out of filterpy's parts."""

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
        return self._filter.x


def _timed(make: Callable[[], Estimator | _Theirs], readings: Sequence[Measurement]) -> float:
    update = make().update
    began = time.perf_counter()
    for measurement in readings:
        update(measurement)
    return (time.perf_counter() - began) / len(readings) * 1e6


def _onboard(planned: Plan) -> OnBoard:
    return OnBoard(planned.design, sensor_noise(planned.scenario), planned.scenario.rates.control_hz, planned.schedule)


def measure(rounds: int) -> None:
    """Print the comparison."""
    scenario = load_scenario("elevator-loss", ["seed=1"])
    readings = [sample.measurement for sample in fly(scenario)]
    onboard = _onboard(plan(scenario))

    def kind(**settings: object) -> Callable[[], Estimator]:
        given = EstimatorSettings.model_validate({"name": "x", **settings})
        make = differentiated_rls if given.kind == "differentiated-rls" else loop_gain
        return lambda: make(given, onboard)

    cases: dict[str, Callable[[], Estimator | _Theirs]] = {
        "filterpy, plain filter": lambda: _Theirs(onboard),
        "plain filter": lambda: LoopGain(PLAIN, onboard),
        "window of 30, scheduled": kind(),
        "window of 30, short period": kind(model="short-period"),
        "expanding, scheduled": kind(memory="expanding"),
        "differentiated-rls": kind(kind="differentiated-rls"),
    }
    times: dict[str, list[float]] = {name: [] for name in cases}
    for _ in range(rounds + 1):
        for name, make in cases.items():
            times[name].append(_timed(make, readings))
    ours, theirs = LoopGain(PLAIN, onboard), _Theirs(onboard)
    trim = onboard.design.alpha_trim_rad
    apart = 0.0
    for m in readings:
        e, x = ours.update(m), theirs.update(m)
        apart = max(apart, *np.abs(np.array([e.alpha_rad - trim, e.q_rad_s, e.effectiveness_raw]) - x))
    print(f"largest difference of (alpha, q, K) from filterpy's: {apart:.1e}")
    for name, values in times.items():
        kept = values[1:]  # the first round warms up
        ratio = statistics.median(t / o for t, o in zip(times["filterpy, plain filter"][1:], kept, strict=True))
        print(
            f"{name:<28} {statistics.median(kept):7.2f} us ({min(kept):.2f} to {max(kept):.2f}); filterpy takes {ratio:.1f} times as long"
        )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=9)
    measure(parser.parse_args().rounds)
