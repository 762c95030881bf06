"""Detection, held estimate and disturbances, with known truth."""

from __future__ import annotations

import numpy as np
import pytest

from flightbed import load_scenario, run
from flightbed.avionics.onboard import OnBoard
from flightbed.avionics.short_period import ShortPeriod
from flightbed.core.signals import Measurement, SensorNoise
from flightbed.core.units import DEG
from flightbed.estimation.loop_gain import filter_bank
from flightbed.estimation.loop_gain.estimator import LoopGain, LoopGainConfig
from tests.linear_flight import fly_linear

QUIET = {"alpha_disturbance_rad_s": 0.02 * DEG, "q_disturbance_rad_s2": 0.1 * DEG}
ALERT = LoopGainConfig(alarm_threshold=30.0, hold_std=0.3, **QUIET)


def test_a_loss_is_declared_within_a_window_and_once(design: ShortPeriod) -> None:
    """On the exact linear aircraft; 20 seeds."""
    delays = []
    for seed in range(20):
        samples, _ = fly_linear(design, config=ALERT, effectiveness=0.4, seed=seed, at_tick=200, adapt=True)
        alarms = np.array([s.estimates[0].alarms for s in samples])
        assert alarms[199] == 0.0, seed
        delays.append(np.flatnonzero(alarms)[0] - 200)
        late = np.array([s.estimates[0].effectiveness_smoothed for s in samples[240:]])
        assert np.sqrt(np.mean((late - 0.4) ** 2)) < 0.03, seed
    assert np.median(delays) <= 10
    assert max(delays) <= 30


def test_nothing_is_declared_when_nothing_changes(design: ShortPeriod) -> None:
    """20 flights of 4.5 s at a threshold of 30: an exceedance has odds of some 4e-8 per independent look."""
    for seed in range(20):
        samples, _ = fly_linear(design, config=ALERT, effectiveness=1.0, seed=seed, adapt=True)
        assert samples[-1].estimates[0].alarms == 0.0, seed


def test_detection_brings_the_estimate_sooner(design: ShortPeriod) -> None:
    into = {}
    for threshold in (0.0, 30.0):
        config = LoopGainConfig(alarm_threshold=threshold, **QUIET)
        found = []
        for seed in range(10):
            samples, _ = fly_linear(design, config=config, effectiveness=0.3, seed=seed, at_tick=200, adapt=True)
            error = np.array([abs(s.estimates[0].effectiveness_smoothed - 0.3) for s in samples[200:]])
            found.append(np.flatnonzero(error < 0.06)[0])
        into[threshold] = np.median(found)
    assert into[30.0] < 0.8 * into[0.0]


def test_an_estimate_without_information_is_held_and_sigma_grows(design: ShortPeriod, rng: np.random.Generator) -> None:
    """The elevator stays at zero, so K has no effect. With the hold the estimate stays; without, it goes to 1, the prior."""
    noise = SensorNoise(0.03 * DEG, 0.1108 * DEG)
    b = design.discrete(100)
    ends, stds = {}, {}
    for hold in (0.0, 0.3):
        generator = np.random.default_rng(rng.integers(2**32) if hold == 0.0 else 5)
        estimator = LoopGain(LoopGainConfig(hold_std=hold, **QUIET), OnBoard(design, noise, 100))
        x, found = np.zeros(2), []
        for k in range(600):
            d = 3 * DEG * np.sin(0.2 * k) if k < 300 else 0.0
            readings = x + generator.standard_normal(2) * [noise.alpha_rad, noise.q_rad_s]
            found.append(estimator.update(Measurement(readings[0] + design.alpha_trim_rad, readings[1], d, d)))
            x = b.A @ x + b.b * ((0.4 * d if k < 299 else 0.0) - design.elevator_trim_rad)
            x *= 0.9 if k > 300 else 1.0  # keeps the state in range by other means than the elevator
        ends[hold], stds[hold] = found[299].effectiveness_smoothed, found[-1].effectiveness_std
    assert ends[0.3] == pytest.approx(0.4, abs=0.05)
    assert stds[0.3] > 0.25
    assert stds[0.0] > 0.5


@pytest.mark.parametrize(("follow", "honest"), [(True, True), (False, False)])
def test_sigma_is_honest_in_rough_air_if_disturbances_are_followed(
    design: ShortPeriod, follow: bool, honest: bool
) -> None:
    """White pitch accelerations of 40 deg/s^2 per tick, unknown to the filter; NEES of K over 10 flights."""
    noise = SensorNoise(0.03 * DEG, 0.1108 * DEG)
    step, trim = design.discrete(100), design.elevator_trim_rad
    nees = []
    for seed in range(10):
        generator = np.random.default_rng(seed)
        config = LoopGainConfig(follow_disturbances=follow, bounds=(-9.0, 9.0), **QUIET)
        estimator = LoopGain(config, OnBoard(design, noise, 100))
        x, d = np.zeros(2), trim
        for k in range(1000):
            readings = x + generator.standard_normal(2) * [noise.alpha_rad, noise.q_rad_s]
            found = estimator.update(Measurement(readings[0] + design.alpha_trim_rad, readings[1], d, d))
            if k > 400 and k % 30 == 0:
                nees.append(((found.effectiveness_raw - 1.0) / found.effectiveness_std) ** 2)
            d = trim + 0.5 * readings[0] + 0.5 * readings[1] + 3 * DEG * np.sin(0.07 * k)
            x = step.A @ x + step.b * (d - trim) + [0.0, 0.4 * DEG * float(generator.standard_normal())]
    assert bool(0.4 < np.mean(nees) < 2.0) is honest, np.mean(nees)


def test_the_tick_with_all_of_it_gives_the_same_compiled_and_plain(rng: np.random.Generator) -> None:
    settings = filter_bank.pack_settings(
        Q=np.diag([1e-10, 1e-8]), x0=np.array([0.0, 0.0, 1.0]), P0=np.diag([1e-5, 1e-4, 0.4]), inflation=1.0, begin=filter_bank.ANCHORED,
        keep=0.9, bounds=(0.0, 1.0), r=np.array([3e-7, 4e-6]), model=np.array([[0.99, 0.01, 0.0, 0.0], [0.02, 0.99, -0.14, 0.0]]),
        threshold=12.0, adaptive=True, hold_var=0.09,
    )  # fmt: skip
    one, two = filter_bank.new_bank(10), filter_bank.new_bank(10)
    x, alarms = np.zeros(2), 0.0
    for k in range(80):
        u = 0.05 * np.sin(0.3 * k)
        z0, z1 = (x + rng.standard_normal(2) * [5e-4, 2e-3]).tolist()
        compiled = filter_bank.tick(one, settings, u, z0, z1, k)
        plain = filter_bank.tick.py_func(two, settings, u, z0, z1, k)
        assert compiled == pytest.approx(plain, rel=1e-9, abs=1e-13)
        alarms = compiled[7]
        x = np.array([[0.99, 0.01], [0.02, 0.99]]) @ x + [0.0, -0.14 * u * (1.0 if k < 40 else 0.2)]
    assert alarms >= 1.0


def test_the_smoothed_estimate_does_not_wander_where_nothing_shows_k() -> None:
    """Trim elevator zero (c.g. 5.7 % aft), level flight after a loss during one doublet: 5 s later the estimate is unchanged."""
    wrong = {}
    for hold in (0.0, 0.3):
        sets = [
            f"estimators.0.hold_std={hold}",
            "aircraft.cg_shift_cbar=0.057",
            "command.count=1",
            "failures.0.to=0.3",
            "failures.0.at_s=3",
        ]
        trace = run(load_scenario("elevator-loss", sets)).trace
        late = trace["t_s"] > 6.5
        wrong[hold] = float(np.sqrt(np.mean((trace["scheduled.effectiveness_smoothed"] - 0.3)[late] ** 2)))
        assert np.mean(trace["scheduled.effectiveness_std"][late]) > 0.1
    assert wrong[0.3] < 0.13
    assert wrong[0.3] < 0.5 * wrong[0.0]
