"""The estimator in the loop: consistency with a true model, memories, bounds, smoothing."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Literal

import numpy as np
import pytest
from scipy.stats import chi2

from flightbed.avionics.onboard import OnBoard
from flightbed.avionics.short_period import ShortPeriod
from flightbed.core.signals import Measurement, SensorNoise
from flightbed.core.units import DEG
from flightbed.estimation.loop_gain import filter_bank
from flightbed.estimation.loop_gain.estimator import LoopGain, LoopGainConfig, LoopGainPrior, LoopGainSettings
from flightbed.studies.methods.record import estimate_record
from tests.linear_flight import NOISE, fly_linear

RUNS = 200
# Two-sided bound that a consistent filter exceeds once in 10,000 seeds; the seed is fixed.
TAIL = 0.5e-4
EXPANDING = LoopGainConfig(
    memory="expanding",
    prior_effectiveness=0.6,
    prior_effectiveness_var=0.15**2,
    bounds=(-9.0, 9.0),
    alpha_disturbance_rad_s=0.0,
    q_disturbance_rad_s2=0.0,
)


@pytest.mark.parametrize("config", [EXPANDING, replace(EXPANDING, memory="window")], ids=["expanding", "window"])
def test_nis_and_nees_are_chi_square_when_the_model_is_true(
    rng: np.random.Generator, design: ShortPeriod, config: LoopGainConfig
) -> None:
    """Over 200 flights with K drawn from the prior: innovations and final errors have the predicted variances."""
    nis_sum, nees_sum, nis_count, nees_x = 0.0, 0.0, 0, 0.0
    for _ in range(RUNS):
        K = rng.normal(config.prior_effectiveness, np.sqrt(config.prior_effectiveness_var))
        samples, estimator = fly_linear(design, config=config, effectiveness=K, seed=int(rng.integers(2**31)), ticks=91)
        assert isinstance(estimator, LoopGain)
        final = samples[-1]
        # Window: the last innovations of three windows that share no sample, so that the draws are independent.
        used = samples[1:] if config.memory == "expanding" else [samples[30], samples[60], samples[90]]
        nis_sum += sum(s.estimates[0].nis for s in used)
        nis_count += 2 * len(used)
        nees_sum += ((final.estimates[0].effectiveness_raw - K) / final.estimates[0].effectiveness_std) ** 2
        if config.memory == "expanding":
            error = np.array(
                [
                    estimator._bank[0, 0] - (final.truth.alpha_rad - design.alpha_trim_rad),
                    estimator._bank[1, 0] - final.truth.q_rad_s,
                    estimator._bank[2, 0] - K,
                ]
            )
            nees_x += float(error @ np.linalg.solve(estimator._bank[3:12, 0].reshape(3, 3), error))
    assert chi2.ppf(TAIL, nis_count) < nis_sum < chi2.ppf(1 - TAIL, nis_count), (nis_sum, nis_count)
    assert chi2.ppf(TAIL, RUNS) < nees_sum < chi2.ppf(1 - TAIL, RUNS), (nees_sum, RUNS)
    if config.memory == "expanding":
        assert chi2.ppf(TAIL, 3 * RUNS) < nees_x < chi2.ppf(1 - TAIL, 3 * RUNS), (nees_x, 3 * RUNS)


def test_innovations_are_white_with_the_predicted_sigma(rng: np.random.Generator, design: ShortPeriod) -> None:
    """With a true model; 60 flights of 90 ticks, each reading's innovations over their sigma."""
    ratios = []
    for _ in range(60):
        K = rng.normal(EXPANDING.prior_effectiveness, np.sqrt(EXPANDING.prior_effectiveness_var))
        samples, _ = fly_linear(design, config=EXPANDING, effectiveness=K, seed=int(rng.integers(2**31)), ticks=91)
        estimates = [s.estimates[0] for s in samples]
        of = [
            (e.innovation_alpha_rad, e.innovation_q_rad_s, e.innovation_alpha_std_rad, e.innovation_q_std_rad_s)
            for e in estimates
        ]
        assert of[0] == (0.0, 0.0, 0.0, 0.0)
        ratios.append([[alpha / alpha_std, q / q_std] for alpha, q, alpha_std, q_std in of[1:]])
    over = np.array(ratios)  # flights, ticks, readings
    n = over[..., 0].size
    for reading in range(2):
        assert chi2.ppf(TAIL, n) < np.sum(over[..., reading] ** 2) < chi2.ppf(1 - TAIL, n)
        assert abs(np.sum(over[:, 1:, reading] * over[:, :-1, reading])) < 4.0 * np.sqrt(n)  # 4 sigma of white noise


def test_innovations_equal_those_of_filterpy(design: ShortPeriod) -> None:
    """The augmented filter written out for filterpy, fed the same readings of one flight."""
    from filterpy.kalman import KalmanFilter

    samples, _ = fly_linear(design, config=EXPANDING, effectiveness=0.5, seed=3, ticks=91)
    A, b = design.discrete(100.0)
    first = samples[0].measurement
    theirs = KalmanFilter(dim_x=3, dim_z=2)
    theirs.x = np.array([first.alpha_rad - design.alpha_trim_rad, first.q_rad_s, EXPANDING.prior_effectiveness])
    R = np.diag([NOISE.alpha_rad**2, NOISE.q_rad_s**2])
    theirs.P = np.diag([*np.diag(R), EXPANDING.prior_effectiveness_var])
    theirs.H, theirs.R = np.eye(2, 3), R
    theirs.Q = np.zeros((3, 3))
    theirs.Q[:2, :2] = NOISE.elevator_rad**2 * np.outer(b, b)
    for sample in samples[1:]:
        m, ours = sample.measurement, sample.estimates[0]
        theirs.F = np.eye(3)
        theirs.F[:2, :2], theirs.F[:2, 2] = A, b * m.elevator_mean_rad
        theirs.x = theirs.F @ theirs.x - np.array([*(b * design.elevator_trim_rad), 0.0])
        theirs.P = theirs.F @ theirs.P @ theirs.F.T + theirs.Q
        theirs.update(np.array([m.alpha_rad - design.alpha_trim_rad, m.q_rad_s]))
        np.testing.assert_allclose(
            [ours.innovation_alpha_rad, ours.innovation_q_rad_s], theirs.y, rtol=1e-7, atol=1e-12
        )
        estimate = [ours.alpha_rad - design.alpha_trim_rad, ours.q_rad_s, ours.effectiveness_raw]
        np.testing.assert_allclose(estimate, theirs.x, rtol=0.0, atol=1e-10)
        sigma = np.sqrt(np.diag(theirs.S))
        np.testing.assert_allclose([ours.innovation_alpha_std_rad, ours.innovation_q_std_rad_s], sigma, rtol=1e-9)


def test_nees_with_process_noise(rng: np.random.Generator, design: ShortPeriod) -> None:
    """The same with process noise in the plant and in the filter: 300 records, full state."""
    A, b = design.discrete(100.0)
    Q, R = np.diag([1e-5, 2e-3]) ** 2, np.diag([NOISE.alpha_rad, NOISE.q_rad_s]) ** 2
    x0, P0 = np.array([0.0, 0.0, 0.6]), np.diag([1e-3, 1e-2, 0.2]) ** 2
    runs, N, total, nis = 300, 60, 0.0, 0.0
    for _ in range(runs):
        truth = rng.multivariate_normal(x0, P0)
        x, K, u, z = truth[:2], truth[2], 0.02 * rng.standard_normal(N), np.empty((N, 2))
        for k in range(N):
            x = A @ x + K * b * u[k] + rng.multivariate_normal(np.zeros(2), Q)
            z[k] = x + rng.multivariate_normal(np.zeros(2), R)
        out = estimate_record(A, b, np.eye(2), Q=Q, R=R, u=u, z=z, x0=x0, P0=P0)
        error = np.append(out.x[-1] - x, out.effectiveness[-1] - K)
        total += float(error @ np.linalg.solve(out.P[-1], error))
        nis += float(out.nis.sum())
    assert chi2.ppf(TAIL, 3 * runs) < total < chi2.ppf(1 - TAIL, 3 * runs), (total, 3 * runs)
    assert chi2.ppf(TAIL, 2 * N * runs) < nis < chi2.ppf(1 - TAIL, 2 * N * runs), (nis, 2 * N * runs)


def _measurements(rng: np.random.Generator, design: ShortPeriod, ticks: int) -> list[Measurement]:
    samples, _ = fly_linear(design, config=EXPANDING, effectiveness=0.5, seed=int(rng.integers(2**31)), ticks=ticks)
    return [s.measurement for s in samples]


@pytest.mark.parametrize("prior", ["measurement", "fixed", "corrected"])
@pytest.mark.parametrize("input_at", ["mean", "start", "end"])
def test_window_equals_refiltering_the_last_30_samples(
    rng: np.random.Generator, design: ShortPeriod, prior: str, input_at: str
) -> None:
    """At every tick the bank agrees with a single filter started 30 samples ago."""
    config = LoopGainConfig(
        window=30, prior_state=prior, input_at=input_at, prior_alpha_rad=-0.025, prior_q_rad_s=-0.042, prior_alpha_var=3e-5,
        prior_q_var=3e-4, prior_effectiveness=0.8, prior_effectiveness_var=0.4, q_disturbance_rad_s2=0.1,
        alpha_disturbance_rad_s=0.01, bounds=(-99.0, 99.0),
    )  # fmt: skip
    measurements = _measurements(rng, design, 120)
    estimator = LoopGain(config, OnBoard(design, NOISE, 100))
    estimates = [estimator.update(m) for m in measurements]
    A, b = design.discrete(100.0)
    Q, R = np.diag([1e-4, 1e-3]) ** 2, np.diag([NOISE.alpha_rad**2, NOISE.q_rad_s**2])
    model = np.column_stack([A, b, -b * design.elevator_trim_rad])
    for k in range(30, 120):
        first = measurements[k - 30]
        x, P, H = np.array([-0.025, -0.042, 0.8]), np.diag([3e-5, 3e-4, 0.4]), np.eye(2, 3)
        reading = np.array([first.alpha_rad - design.alpha_trim_rad, first.q_rad_s])
        if prior == "measurement":
            x[:2], P[:2, :2] = reading, R
        elif prior == "corrected":
            weight = P[:2, :2] @ np.linalg.inv(P[:2, :2] + R)
            x[:2] += weight @ (reading - x[:2])
            P[:2, :2] -= weight @ P[:2, :2]
        for before, m in zip(measurements[k - 30 : k], measurements[k - 29 : k + 1], strict=True):
            # the textbook filter, matrix by matrix
            u = {"mean": m.elevator_mean_rad, "start": before.elevator_rad, "end": m.elevator_rad}[input_at]
            F = np.eye(3)
            F[:2, :2], F[:2, 2] = model[:, :2], model[:, 2] * u
            x = F @ x + np.append(model[:, 3], 0.0)
            P = F @ P @ F.T
            P[:2, :2] += Q
            S = H @ P @ H.T + R
            gain = np.linalg.solve(S, H @ P).T
            x = x + gain @ (np.array([m.alpha_rad - design.alpha_trim_rad, m.q_rad_s]) - H @ x)
            P = P - gain @ H @ P
        assert estimates[k].effectiveness_raw == pytest.approx(x[2], abs=1e-9)
        assert estimates[k].effectiveness_std == pytest.approx(np.sqrt(P[2, 2]), rel=1e-8)
        assert estimates[k].alpha_rad == pytest.approx(x[0] + design.alpha_trim_rad, abs=1e-12)
        assert estimates[k].q_rad_s == pytest.approx(x[1], abs=1e-12)


def test_fading_memory_forgets_at_its_nominal_rate(rng: np.random.Generator, design: ShortPeriod) -> None:
    """K drops in flight: fading memory follows, the expanding one lags; lambda = 1 is the expanding one exactly."""

    def final(config: LoopGainConfig) -> tuple[float, float]:
        samples, _ = fly_linear(design, config=config, effectiveness=0.3, at_tick=300, seed=7, ticks=450)
        return samples[-1].estimates[0].effectiveness_raw, samples[-1].estimates[0].effectiveness_std

    expanding, expanding_std = final(EXPANDING)
    fading, fading_std = final(replace(EXPANDING, memory="fading", forgetting=0.95))
    assert final(replace(EXPANDING, memory="fading", forgetting=1.0)) == (expanding, expanding_std)
    assert abs(fading - 0.3) < 0.02 < abs(expanding - 0.3)
    assert fading_std > 1.5 * expanding_std


def test_deviation_form_is_right_on_the_plant_of_the_thesis(design: ShortPeriod) -> None:
    """x' = A x + K b (delta - delta_trim): unbiased where the plant has that form, biased where K scales the trim too."""
    deviation = replace(EXPANDING, absolute=False)
    runs = [
        fly_linear(design, config=deviation, effectiveness=0.4, seed=s, absolute=False)[0][-1].estimates[0]
        for s in range(20)
    ]
    errors = np.array([(e.effectiveness_raw - 0.4) / e.effectiveness_std for e in runs])
    assert abs(errors.mean()) < 4.0 / np.sqrt(len(runs))
    wrong = fly_linear(design, config=deviation, effectiveness=0.4, seed=0, absolute=True)[0][-1].estimates[0]
    assert abs(wrong.effectiveness_raw - 0.4) > 5.0 * wrong.effectiveness_std


def test_bounds_come_before_smoothing(design: ShortPeriod) -> None:
    """Sillence S 5.5: eq (85) smooths the bounded estimate; smoothing starts at 1."""
    config = LoopGainConfig(window=5, smoothing=0.7, bounds=(0.45, 0.55))
    samples, _ = fly_linear(design, config=config, effectiveness=0.5, seed=3, ticks=200)
    smoothed = 1.0
    hit = 0
    for sample in samples:
        e = sample.estimates[0]
        assert e.effectiveness == min(max(e.effectiveness_raw, 0.45), 0.55)
        smoothed = 0.7 * smoothed + 0.3 * e.effectiveness
        assert e.effectiveness_smoothed == pytest.approx(smoothed, abs=1e-14)
        hit += e.effectiveness != e.effectiveness_raw
    assert hit > 10


def test_adaptation_rescues_the_linear_plant(design: ShortPeriod) -> None:
    """K = 0.1 on the unstable linear model: the fixed loop is unstable, the corrected one stays within 10 deg."""
    config = LoopGainConfig()
    fixed, _ = fly_linear(design, config=config, effectiveness=0.1, at_tick=200, seed=1, ticks=1500)
    adaptive, _ = fly_linear(design, config=config, effectiveness=0.1, at_tick=200, seed=1, ticks=1500, adapt=True)
    assert len(fixed) < 1500
    assert len(adaptive) == 1500
    assert max(abs(s.truth.alpha_rad) for s in adaptive) < np.deg2rad(10)


@pytest.mark.parametrize("filters", [1, 7])
def test_the_tick_gives_the_same_compiled_and_plain(rng: np.random.Generator, filters: int) -> None:
    settings = filter_bank.pack_settings(
        Q=np.diag([1e-8, 1e-6]), x0=np.array([0.0, 0.0, 0.8]), P0=np.diag([1e-5, 1e-4, 0.4]), inflation=1.02, begin=filter_bank.ANCHORED,
        keep=0.9, bounds=(0.0, 1.0), r=np.array([3e-7, 4e-6]), model=np.array([[0.99, 0.01, 0.0, 1e-5], [0.02, 0.99, -0.14, 2e-4]]),
    )  # fmt: skip
    one, two = filter_bank.new_bank(filters), filter_bank.new_bank(filters)
    for k in range(40):
        u, z0, z1 = (float(v) for v in 0.01 * rng.standard_normal(3))
        compiled = filter_bank.tick(one, settings, u, z0, z1, k)
        plain = filter_bank.tick.py_func(two, settings, u, z0, z1, k)
        assert compiled == pytest.approx(plain, rel=1e-10, abs=1e-14)


def test_defaults_of_class_and_scenario_are_one() -> None:
    """Field by field, in SI: the Python class and a scenario without settings give the same filter."""
    settings = LoopGainSettings.model_validate({"name": "x", "model": "short-period"})
    assert settings.config() == LoopGainConfig()


def test_every_setting_of_a_scenario_reaches_the_filter() -> None:
    """No value is a default, so a setting that is not passed on fails the test."""
    settings = LoopGainSettings(
        name="x", model="scheduled", input="deviation", input_at="end", memory="fading", window=17, forgetting=0.93, smoothing=0.7, bounds=(0.1, 1.2),
        alpha_disturbance_deg_s=0.3, q_disturbance_deg_s2=4.0, alarm_threshold=12.0, follow_disturbances=True, hold_std=0.2,
        prior=LoopGainPrior(state="fixed", first_reading="used", alpha_deg=-1.4, q_deg_s=-2.4, alpha_std_deg=0.3, q_std_deg_s=2.0, effectiveness=0.8, effectiveness_std=0.5),
    )  # fmt: skip
    found = settings.config()
    assert found == LoopGainConfig(
        memory="fading", window=17, forgetting=0.93, smoothing=0.7, bounds=(0.1, 1.2), absolute=False, scheduled=True,
        alarm_threshold=12.0, follow_disturbances=True, hold_std=0.2,
        alpha_disturbance_rad_s=0.3 * DEG, q_disturbance_rad_s2=4.0 * DEG, input_at="end", prior_state="corrected",
        prior_alpha_rad=-1.4 * DEG, prior_q_rad_s=-2.4 * DEG, prior_alpha_var=(0.3 * DEG) ** 2, prior_q_var=(2.0 * DEG) ** 2,
        prior_effectiveness=0.8, prior_effectiveness_var=0.25,
    )  # fmt: skip
    default = LoopGainConfig()
    assert all(getattr(found, f.name) != getattr(default, f.name) for f in fields(LoopGainConfig))


@pytest.mark.parametrize(
    ("state", "first_reading", "begin"),
    [("measurement", "left-out", "measurement"), ("fixed", "left-out", "fixed"), ("fixed", "used", "corrected")],
)
def test_the_prior_selects_the_start_of_a_filter(
    state: Literal["measurement", "fixed"], first_reading: Literal["left-out", "used"], begin: str
) -> None:
    prior = LoopGainPrior(state=state, first_reading=first_reading)
    settings = LoopGainSettings(name="x", model="short-period", prior=prior)
    assert settings.config() == LoopGainConfig(prior_state=begin)


@pytest.mark.parametrize("input_at", ["mean", "start", "end"])
def test_the_scenario_selects_the_input(input_at: Literal["mean", "start", "end"]) -> None:
    settings = LoopGainSettings(name="x", model="short-period", input_at=input_at)
    assert settings.config() == LoopGainConfig(input_at=input_at)


def test_noise_of_the_position_transducer_widens_sigma(rng: np.random.Generator, design: ShortPeriod) -> None:
    measurements = _measurements(rng, design, 60)

    def sigma(elevator_std: float) -> float:
        noise = SensorNoise(NOISE.alpha_rad, NOISE.q_rad_s, elevator_std)
        estimator = LoopGain(LoopGainConfig(), OnBoard(design, noise, 100))
        return [estimator.update(m) for m in measurements][-1].effectiveness_std

    assert sigma(0.005) > 1.1 * sigma(0.0)
