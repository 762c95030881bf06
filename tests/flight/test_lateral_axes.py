"""Flights with commanded aileron and rudder: tracking, recording, metrics, correction by 1/K, and error messages."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from flightbed.aircraft.overlay import load_aircraft
from flightbed.analysis.events import departure_reason
from flightbed.analysis.metrics import SETTLING_S, measure
from flightbed.analysis.result import Result
from flightbed.analysis.trace import collect, from_rows, read_trace, true_share
from flightbed.core.errors import EstimateError, ScenarioError
from flightbed.core.signals import Health, LateralNoise, LateralSample, LateralTruth, Sample
from flightbed.core.units import DEG
from flightbed.estimation.two_stage.estimator import TwoStagePitch, TwoStageSurfaces
from flightbed.flight.assembly import assemble
from flightbed.flight.loop import fly
from flightbed.flight.plan import plan
from flightbed.flight.record import row_packer, row_width
from flightbed.plant.sensors import LateralSensors
from flightbed.runs.run import run
from flightbed.scenario.estimates import detectors, estimates
from flightbed.scenario.reading import load_scenario
from tests.lateral_flight import NAMES, SOON, rolling


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Result:
    return run(rolling(), tmp_path_factory.mktemp("runs") / "run", rerun=False, report=False)


@pytest.fixture(scope="module")
def samples() -> list[Sample]:
    return list(fly(assemble(plan(rolling(SOON)))))


def test_roll_rate_and_sideslip_track_their_references_and_the_wings_level(flown: Result) -> None:
    trace = flown.trace
    assert not flown.metrics.departed
    assert len(trace) == 1200
    for column, reference, left in (("p_deg_s", "p_ref_deg_s", 0.4), ("beta_deg", "beta_ref_deg", 0.7)):
        missed = np.sqrt(np.mean((trace[column] - trace[reference]) ** 2)) / np.sqrt(np.mean(trace[reference] ** 2))
        assert missed < left, column
    assert np.abs(trace["phi_deg"]).max() < 45.0


def test_tracking_is_worse_without_a_correction(flown: Result) -> None:
    fixed = run(rolling(["adaptation.enabled=false"])).metrics
    assert fixed.tracking_rms_post_p_deg_s is not None
    assert flown.metrics.tracking_rms_post_p_deg_s is not None
    assert fixed.tracking_rms_post_p_deg_s > 1.2 * flown.metrics.tracking_rms_post_p_deg_s
    assert fixed.tracking_rms_pre_p_deg_s == pytest.approx(flown.metrics.tracking_rms_pre_p_deg_s, rel=0.1)


def test_with_the_oracle_the_flight_equals_the_healthy_one_within_the_stops() -> None:
    """With the true K of both surfaces the law increases their deflections so that p and beta move as without a failure."""
    small = ["lateral.roll.amplitude_deg_s=4", "lateral.sideslip.amplitude_deg=0.5", "estimators=[]"]
    corrected = run(rolling([*small, "adaptation.oracle=true"])).trace
    healthy = run(rolling([*small, "failures=[]", "adaptation.enabled=false"])).trace
    # At the failure K times position steps; the actuator needs some time to compensate.
    weak = corrected["t_s"] > 7.0
    for column in ("p_deg_s", "beta_deg"):
        assert np.abs(corrected[column] - healthy[column])[weak].max() < 0.002 * np.abs(healthy[column]).max(), column
    ratio = np.linalg.norm(corrected["aileron_deg"][weak]) / np.linalg.norm(healthy["aileron_deg"][weak])
    assert ratio == pytest.approx(1.0 / 0.4, rel=0.02)


def test_both_ways_of_recording_give_the_same_trace(samples: list[Sample]) -> None:
    """Sample by sample, and all packed rows together; every field is in its column, in its unit."""
    packed = b"".join(map(row_packer(len(NAMES), lateral=True), samples))
    assert len(packed) == 8 * row_width(len(NAMES), lateral=True) * len(samples)
    one = from_rows(np.frombuffer(packed), estimators=NAMES, control_hz=100, lateral=True)
    other = collect(iter(samples), estimators=NAMES, control_hz=100)
    assert list(one.columns) == list(other.columns)
    for name in one.columns:
        np.testing.assert_array_equal(one[name], other[name], err_msg=name)
    picked = samples[123]
    assert picked.lateral is not None
    values: dict[str, float] = {
        "p_cmd_deg_s": picked.lateral.p_cmd_rad_s, "p_ref_deg_s": picked.lateral.p_ref_rad_s,
        "beta_cmd_deg": picked.lateral.beta_cmd_rad, "beta_ref_deg": picked.lateral.beta_ref_rad,
        "aileron_cmd_deg": picked.lateral.aileron_cmd_rad, "rudder_cmd_deg": picked.lateral.rudder_cmd_rad,
        "beta_deg": picked.lateral.truth.beta_rad, "p_deg_s": picked.lateral.truth.p_rad_s,
        "r_deg_s": picked.lateral.truth.r_rad_s, "aileron_deg": picked.lateral.truth.aileron_rad,
        "rudder_deg": picked.lateral.truth.rudder_rad, "beta_meas_deg": picked.lateral.measurement.beta_rad,
        "p_meas_deg_s": picked.lateral.measurement.p_rad_s, "r_meas_deg_s": picked.lateral.measurement.r_rad_s,
        "aileron_mean_meas_deg": picked.lateral.measurement.aileron_mean_rad,
        "rudder_mean_meas_deg": picked.lateral.measurement.rudder_mean_rad,
    }  # fmt: skip
    for name, value in values.items():
        assert one[name][123] == pytest.approx(value / DEG, rel=1e-15), name
    assert one["effectiveness_aileron_true"][123] == picked.lateral.truth.aileron_effectiveness == 0.4
    assert one["surfaces.rudder.effectiveness"][123] == picked.estimates[2].effectiveness
    assert one["pitch.nis"][123] == picked.estimates[3].nis


def test_the_file_restores_the_trace(flown: Result) -> None:
    assert flown.folder is not None
    read = read_trace(flown.folder / "trace.parquet")
    assert read.estimators == flown.trace.estimators == NAMES
    for name in flown.trace.columns:
        np.testing.assert_array_equal(read[name], flown.trace[name], err_msg=name)


def test_a_flight_is_reproducible_to_the_last_bit(samples: list[Sample]) -> None:
    again = list(fly(assemble(plan(rolling(SOON)))))
    pack = row_packer(len(NAMES), lateral=True)
    assert b"".join(map(pack, again)) == b"".join(map(pack, samples))


def test_sensors_of_roll_and_yaw_do_not_change_the_pitch_axis() -> None:
    """The noise of alpha and q is unchanged: roll and yaw have their own random streams."""
    sensed, alone = (assemble(plan(rolling([f"lateral.enabled={on}", "failures=[]", "adaptation.enabled=false"]))).sensors
                     for on in ("true", "false"))  # fmt: skip
    np.testing.assert_array_equal(sensed.errors, alone.errors)


def test_sensors_of_roll_and_yaw_have_the_given_noise() -> None:
    noise, ticks = LateralNoise(1e-3, 2e-3, 3e-3, 4e-3, 0.0), 20_000
    sensors = LateralSensors(noise, ticks=ticks, seed=np.random.SeedSequence(3))
    truth = LateralTruth(0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7)
    off = np.array([sensors.read(k, truth) for k in range(ticks)]) - truth[:7]
    # Five standard errors of the standard deviation of that many draws.
    np.testing.assert_allclose(off[:, :4].std(axis=0), [1e-3, 2e-3, 3e-3, 4e-3], rtol=5.0 / np.sqrt(2 * ticks))
    np.testing.assert_array_equal(off[:, [4, 6]], 0.0)
    np.testing.assert_allclose(
        off[:, 5], off[:, 3], rtol=0.0, atol=1e-15
    )  # the averaged position carries the same error
    assert np.abs(np.corrcoef(off[:, :4].T) - np.eye(4)).max() < 5.0 / np.sqrt(ticks)


def test_each_estimate_is_compared_with_the_true_k_of_its_surface(flown: Result) -> None:
    trace, measured = flown.trace, flown.metrics.estimators
    assert [true_share(name) for name in NAMES] == [
        "effectiveness_true", "effectiveness_aileron_true", "effectiveness_rudder_true", "effectiveness_true",
    ]  # fmt: skip
    for name, at_s, to in (("surfaces.aileron", 4.0, 0.4), ("surfaces.rudder", 6.0, 0.5)):
        truth = trace[true_share(name)]
        np.testing.assert_array_equal(truth, np.where(trace["t_s"] >= at_s - 1e-9, to, 1.0))
        late = trace["t_s"] >= at_s + SETTLING_S - 1e-9
        error = np.abs(trace[f"{name}.effectiveness"] - truth)
        assert measured[name].median_abs_error_post == np.median(error[late])
        assert measured[name].median_abs_error_post < 0.05
        within = np.flatnonzero((trace["t_s"] >= at_s - 1e-9) & (error <= 0.2 * truth))[0]
        assert measured[name].first_within_20pct_s == pytest.approx(trace["t_s"][within] - at_s)
        found = measured[name].detected_at_s
        assert found is not None
        assert found < 0.5
        assert measured[name].efficiency is None
    assert measured["surfaces"].efficiency is not None
    assert {measured[name].nis_expected for name in NAMES[:3]} == {5.0}


def test_tracking_metrics_cover_all_commanded_axes(flown: Result) -> None:
    trace, metrics = flown.trace, flown.metrics
    before, late = trace["t_s"] < 4.0 - 1e-9, trace["t_s"] >= 4.0 + SETTLING_S - 1e-9
    for when, ticks in (("pre", before), ("post", late)):
        for key, column, reference in (("p_deg_s", "p_deg_s", "p_ref_deg_s"), ("beta_deg", "beta_deg", "beta_ref_deg")):
            expected = np.sqrt(np.mean((trace[column] - trace[reference])[ticks] ** 2))
            assert getattr(metrics, f"tracking_rms_{when}_{key}") == pytest.approx(expected, rel=1e-12)
            assert flown.summary.to_dict()[f"tracking_rms_{when}_{key}"] == getattr(
                metrics, f"tracking_rms_{when}_{key}"
            )
    pitch = run(load_scenario("nominal", ["duration_s=0.5"])).metrics.to_dict()
    keys = [f"tracking_rms_{when}_{key}" for when in ("pre", "post") for key in ("p_deg_s", "beta_deg")]
    assert [pitch[key] for key in keys] == [None] * 4


def test_a_large_sideslip_is_a_departure() -> None:
    """The loop ends after the sample beyond 25 deg; metrics and messages agree."""

    class Slipping:
        def __init__(self, plant: Any) -> None:
            self._plant, self._calls = plant, 0

        def sense_lateral(self, health: Health) -> LateralTruth:
            self._calls += 1
            truth: LateralTruth = self._plant.sense_lateral(health)
            return truth._replace(beta_rad=(self._calls - 1) * 0.5 * DEG)

        def __getattr__(self, name: str) -> Any:
            return getattr(self._plant, name)

    flight = assemble(plan(rolling(["estimators=[]", "adaptation.enabled=false"])))
    assert flight.lateral is not None
    slipping = replace(flight, lateral=replace(flight.lateral, plant=Slipping(flight.plant)))
    trace = collect(fly(slipping), estimators=(), control_hz=100)
    assert trace["beta_deg"][-1] == pytest.approx(25.5)
    assert len(trace) == 52
    measured = measure(trace, alpha_trim_deg=trace["alpha_deg"][0], failed_at_s=None)
    assert (measured.departed, measured.departed_at_s) == (True, 0.51)
    assert departure_reason(trace) == "sideslip more than 25 deg"
    assert not measure(
        trace.with_column("beta_deg", 0.9 * trace["beta_deg"]), alpha_trim_deg=0.8, failed_at_s=None
    ).departed


def test_delay_ticks_delay_aileron_and_rudder_commands() -> None:
    prompt, late = (run(rolling([f"rates.delay_ticks={n}", "duration_s=1", "failures=[]"])).trace for n in (0, 3))
    first = [int(np.flatnonzero(np.abs(t["aileron_deg"]) > 1e-9)[0]) for t in (prompt, late)]
    assert first[1] - first[0] == 3


def test_names_of_estimates_and_detectors_are_known_before_take_off() -> None:
    scenario = rolling()
    assert estimates(scenario) == detectors(scenario) == NAMES
    pitch = rolling(["lateral.enabled=false", "failures=[]"])
    assert estimates(pitch) == detectors(pitch) == ("surfaces", "pitch")
    assert isinstance(assemble(plan(scenario)).estimators[0], TwoStageSurfaces)
    assert isinstance(assemble(plan(pitch)).estimators[0], TwoStagePitch)


def test_a_smoothed_k_that_is_nan_is_an_error() -> None:
    class Broken:
        surfaces = ("elevator", "aileron", "rudder")

        def __init__(self, inner: TwoStageSurfaces) -> None:
            self._inner, self._tick = inner, 0

        def update_all(self, *readings: Any) -> list[Any]:
            estimates = list(self._inner.update_all(*readings))
            if self._tick == 7:
                estimates[1] = estimates[1]._replace(effectiveness_smoothed=float("nan"))
            self._tick += 1
            return estimates

    flight = assemble(plan(rolling()))
    inner = flight.estimators[0]
    assert isinstance(inner, TwoStageSurfaces)
    with pytest.raises(
        EstimateError, match="smoothed K of aileron or rudder is nan at t = 0.07 s; the correction 1/K needs a finite K"
    ):
        list(fly(replace(flight, estimators=[Broken(inner), *flight.estimators[1:]])))


def test_an_estimator_of_several_surfaces_needs_lateral_axes() -> None:
    with pytest.raises(ValueError, match="needs a flight with lateral axes"):
        replace(assemble(plan(rolling())), lateral=None)


@pytest.mark.parametrize(
    ("settings", "problem"),
    [
        (["lateral.enabled=false"], "failures.0.surface: the stock laws control aileron and rudder (got 'aileron'); set lateral.enabled to true"),
        (["failures.0.kind=structural", "failures.0.force_to=1"], "failures.0.surface: must be 'elevator' (got 'aileron')"),
        (["failures.0.surface=flap"], "failures.0.surface: must be 'elevator', 'aileron' or 'rudder' (got 'flap')"),
        (["failures.0={kind='bias', surface='aileron', at_s=1}"], "failures.0.bias_deg: is missing"),
        (["failures.0={kind='hardover', surface='aileron', at_s=1, side='left'}"], "failures.0.side: must be 'low' or 'high' (got 'left')"),
        (["lateral.roll.kind=multisine", "lateral.roll.low_hz=3", "lateral.roll.high_hz=2"], "lateral.roll.low_hz: must be no higher than high_hz = 2 (got 3)"),
        (["lateral.beta_deg=0"], "lateral.beta_deg: must be above 0"),
        (["lateral.roll.gain=1"], "unknown key lateral.roll.gain"),
    ],
)  # fmt: skip
def test_invalid_settings_have_an_error_message(settings: list[str], problem: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        rolling(settings)
    assert any(problem in text for text in caught.value.problems), caught.value.problems


@pytest.mark.parametrize("failures", [[], [{"kind": "bias", "at_s": 1.0, "bias_deg": 1.0}]])
def test_a_linear_aircraft_has_neither_roll_and_yaw_nor_actuators(failures: list[dict[str, Any]]) -> None:
    raw = load_scenario("thesis-loss").to_dict()
    raw |= {"failures": failures} if failures else {"lateral": {"enabled": True}}
    with pytest.raises(
        ScenarioError, match="failures.0.kind: 'bias'" if failures else "lateral.enabled: must be False"
    ):
        plan(load_scenario(raw))


def test_actuator_failures_need_the_properties_of_the_overlay(monkeypatch: pytest.MonkeyPatch) -> None:
    f16 = load_aircraft("f16")
    named = {key: path for key, path in f16.properties.items() if key not in ("rudder_stuck", "aileron_offset_rad")}
    scenario = rolling(
        [
            "failures=[{kind='stuck', surface='rudder', at_s=1}, {kind='floating', surface='aileron', at_s=1}, "
            "{kind='stuck', at_s=1}]"
        ]
    )
    monkeypatch.setattr("flightbed.flight.plan.load_flyable", lambda _: replace(f16, properties=named))
    with pytest.raises(ScenarioError) as caught:
        plan(scenario)
    assert list(caught.value.problems) == [
        "failures.0.kind: 'stuck' needs properties.rudder_stuck, which the overlay of f16 does not name",
        "failures.1.kind: 'floating' needs properties.aileron_offset_rad, which the overlay of f16 does not name",
    ]
    monkeypatch.setattr("flightbed.flight.plan.load_flyable", lambda _: replace(f16, lateral={}))
    with pytest.raises(
        ScenarioError, match="lateral.enabled: must be false with the aircraft f16, whose overlay has no"
    ):
        plan(rolling())


def test_the_recorder_accepts_a_lateral_sample(samples: list[Sample]) -> None:
    assert all(isinstance(sample.lateral, LateralSample) for sample in samples)
    assert [sample.tick for sample in samples] == list(range(300))
