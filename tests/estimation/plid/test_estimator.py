"""K from the model that PLID identifies: projection, transfer function, and flights of the exact linear aircraft."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import freqz, lfilter, ss2tf

from flightbed.analysis.result import fly_plan
from flightbed.avionics.onboard import OnBoard
from flightbed.avionics.short_period import ShortPeriod
from flightbed.core.signals import Estimate, Measurement, SensorNoise
from flightbed.core.units import DEG
from flightbed.estimation.plid.estimator import (
    PlidEffectiveness,
    PlidEffectivenessConfig,
    band_pass,
    project,
    transfer_function,
)
from flightbed.estimation.plid.factored import FACTORED
from flightbed.estimation.plid.identify import CONVENTIONAL, Form
from flightbed.flight.assembly import sensor_noise
from flightbed.flight.plan import plan
from flightbed.scenario.reading import load_scenario
from flightbed.testing.readings import readings_of_flights

SILENT, NOISY = SensorNoise(0.03 * DEG, 1e-7 * DEG), SensorNoise(0.03 * DEG, 0.1108 * DEG)


def test_the_projection_is_generalized_least_squares(rng: np.random.Generator) -> None:
    for _ in range(20):
        root = rng.standard_normal((2, 2))
        S, h, b = root @ root.T + 0.01 * np.eye(2), rng.standard_normal(2), rng.standard_normal(2)
        white = np.linalg.inv(np.linalg.cholesky(S))
        (expected,), *_ = np.linalg.lstsq((white @ h)[:, None], white @ b, rcond=None)
        found, std = project(b, h, S)
        assert found == pytest.approx(expected, rel=1e-9)
        assert std == pytest.approx(1.0 / np.linalg.norm(white @ h), rel=1e-9)
        assert project(0.3 * h, h, S)[0] == pytest.approx(0.3, rel=1e-9)


def test_an_indefinite_covariance_weighs_nothing() -> None:
    h, S = np.array([1.0, 2.0]), np.array([[1.0, 2.0], [2.0, 1.0]])
    assert project(0.4 * h, h, S) == pytest.approx((0.4, np.sqrt(h @ S @ h) / 5.0))
    assert project(0.4 * h, h, -np.eye(2))[1] == 0.0


def test_the_transfer_function_is_scipy_s(design: ShortPeriod) -> None:
    held = design.discrete(100.0)
    a, b = transfer_function(held.A, held.b)
    numerator, denominator = ss2tf(held.A, held.b[:, None], np.array([[0.0, 1.0]]), np.zeros((1, 1)))
    assert a[::-1] == pytest.approx(-denominator[1:])
    assert b[::-1] == pytest.approx(numerator[0, 1:])


def _flown(
    design: ShortPeriod,
    rng: np.random.Generator,
    noise: SensorNoise,
    config: PlidEffectivenessConfig,
    ticks: int = 1500,
) -> list[Estimate]:
    """An aircraft that is exactly linear, its K 1 and from tick 500 on 0.4, its elevator driven at random about a trim."""
    step, x, d = design.discrete(100), np.zeros(2), 0.0
    estimator, found = PlidEffectiveness(config, OnBoard(design, noise, 100)), []
    for k in range(ticks):
        q = x[1] + noise.q_rad_s * float(rng.standard_normal())
        elevator = design.elevator_trim_rad + d
        found.append(estimator.update(Measurement(design.alpha_trim_rad + x[0], q, elevator, elevator)))
        d = 0.98 * d + 0.4 * DEG * float(rng.standard_normal()) + 0.4 * float(x[1]) + 0.5 * float(x[0])
        x = step.A @ x + step.b * (1.0 if k < 500 else 0.4) * d
    return found


@pytest.mark.parametrize("form", [CONVENTIONAL, FACTORED])
def test_without_noise_k_is_found(form: Form, design: ShortPeriod, rng: np.random.Generator) -> None:
    found = _flown(design, rng, SILENT, PlidEffectivenessConfig(scheduled=False, block_fade=1.05, form=form))
    assert found[499].effectiveness_raw == pytest.approx(1.0, abs=0.01)
    assert found[-1].effectiveness_raw == pytest.approx(0.4, abs=0.01)
    assert found[-1].effectiveness_smoothed == pytest.approx(0.4, abs=0.01)


def test_the_band_pass_is_scipy_s_of_the_analog_one() -> None:
    config = PlidEffectivenessConfig()
    b, a = band_pass(config, 100)
    w0, w, z = config.washout_rad_s, config.filter_rad_s, config.filter_damping
    at = np.array([0.2, 1.0, 5.0, 20.0])  # rad/s; the rule warps frequencies as tan
    s = 1j * 200.0 * np.tan(at / 200.0)
    _, found = freqz(b, a, worN=at / 100.0)
    assert found == pytest.approx(s / (s + w0) * w * w / (s * s + 2 * z * w * s + w * w), rel=1e-9)


def test_the_filter_runs_as_lfilter_does_from_rest(design: ShortPeriod, rng: np.random.Generator) -> None:
    config = PlidEffectivenessConfig()
    estimator = PlidEffectiveness(replace(config, scheduled=False), OnBoard(design, NOISY, 100))
    signals = rng.standard_normal((50, 2))
    found = np.array([estimator._band(row) for row in signals])
    assert found == pytest.approx(lfilter(*band_pass(config, 100), signals, axis=0), abs=1e-12)


def test_factored_single_precision_agrees_with_double(design: ShortPeriod) -> None:
    configs = [
        PlidEffectivenessConfig(scheduled=False, form=FACTORED),
        PlidEffectivenessConfig(scheduled=False, form=FACTORED, dtype="float32"),
    ]
    runs = [_flown(design, np.random.default_rng(7), NOISY, config) for config in configs]
    raw = np.array([[e.effectiveness_raw for e in run] for run in runs])
    assert 0.0 < np.max(np.abs(raw[0] - raw[1])) < 0.01


def test_with_noise_a_healthy_k_is_unbiased_to_a_few_percent_and_sigma_is_no_smaller_than_the_errors(
    design: ShortPeriod,
) -> None:
    config = PlidEffectivenessConfig(scheduled=False)
    ends = [_flown(design, np.random.default_rng(seed), NOISY, config, ticks=500)[-1] for seed in range(10)]
    errors = np.array([e.effectiveness_raw - 1.0 for e in ends])
    stds = np.array([e.effectiveness_std for e in ends])
    assert abs(np.mean(errors)) < 0.03
    assert np.mean((errors / stds) ** 2) < 2.0
    assert np.max(stds) < 0.2


def test_without_the_band_pass_the_noise_in_the_loop_hides_the_loss(design: ShortPeriod) -> None:
    onboard = OnBoard(design, NOISY, 100)
    readings = readings_of_flights(onboard)["K drops to 0.5"]
    ends = {}
    for bandwidth in (20.0, 1e4):  # rad/s; the second passes everything up to half the sampling rate
        config = PlidEffectivenessConfig(scheduled=False, filter_rad_s=bandwidth)
        estimator = PlidEffectiveness(config, onboard)
        ends[bandwidth] = [estimator.update(m) for m in readings][-1].effectiveness_raw
    assert ends[20.0] == pytest.approx(0.5, abs=0.05)
    assert ends[1e4] > 1.0


def test_before_anything_moves_sigma_is_the_prior_s(design: ShortPeriod) -> None:
    held = design.discrete(100.0)
    _, healthy = transfer_function(held.A, held.b)
    estimator = PlidEffectiveness(PlidEffectivenessConfig(scheduled=False), OnBoard(design, NOISY, 100))
    found = estimator.update(Measurement(0.05, 0.0, 0.0, 0.0))
    # two coefficients, each known to 63 % of its healthy value and independent
    assert found.effectiveness_std == pytest.approx(0.63 / np.sqrt(2.0), rel=1e-6)
    assert np.all(healthy != 0.0)


def test_it_stands_beside_the_others_on_an_elevator_loss() -> None:
    plid = '{name="plid", kind="plid", model="MODEL"}'
    entries = [
        f"estimators.{i}={plid.replace('MODEL', m).replace('plid', m, 1)}"
        for i, m in ((2, "scheduled"), (3, "short-period"))
    ]
    entries = [entry.replace('name="scheduled"', 'name="on-schedule"') for entry in entries]
    planned = plan(load_scenario("elevator-loss", entries))
    trace, metrics = fly_plan(planned)
    for name in ("on-schedule", "short-period"):
        error = metrics.estimators[name].median_abs_error_post
        assert error is not None
        assert error < 0.05
    assert sensor_noise(planned.scenario).nz_g == 0.0
    assert np.all(np.isfinite(trace["on-schedule.nis"][1:]))


def test_a_schedule_that_is_not_there_is_an_error(design: ShortPeriod) -> None:
    with pytest.raises(ValueError, match="schedule"):
        PlidEffectiveness(PlidEffectivenessConfig(scheduled=True), OnBoard(design, NOISY, 100))
