"""Flights commanded in g: Kemp's chapter 6 on the F-16. Seeds are fixed; the benchmark gives figures with intervals."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from flightbed.aircraft.overlay import Aircraft
from flightbed.analysis.comparison import load_runs
from flightbed.analysis.pull_up import PullUp, command_g, increment_g, pull_up
from flightbed.analysis.result import fly_plan
from flightbed.analysis.summary_text import run_text
from flightbed.analysis.trace import Trace
from flightbed.campaigns import run as campaigns
from flightbed.campaigns.report.headline import headline
from flightbed.campaigns.report.page import campaign_report
from flightbed.control.load_factor.design import closed_loop_poles, gain_table
from flightbed.core.atmosphere import standard_air
from flightbed.core.errors import ScenarioError
from flightbed.core.units import FT, G0
from flightbed.flight.assembly import assemble
from flightbed.flight.loop import fly
from flightbed.flight.plan import plan
from flightbed.models.envelope import DYNAMIC_PRESSURES_PSF, PSF, pitch_points
from flightbed.report.comparison_report import comparison_report
from flightbed.runs.run import run
from flightbed.scenario.reading import load_scenario
from flightbed.telemetry.comparison import write_comparison
from tests.telemetry.reading import series

SCHEDULED = ("control.law=nz-scheduled",)
SOFT = (*SCHEDULED, "control.poles=[[-1.68,0.84],[-1.68,-0.84],[-4.2,0]]")
THESIS = (
    "control.identification.prior=thesis", "control.identification.prior_var=1", "control.identification.gain_filter_rad_s=0",
)  # fmt: skip
FILTERED = (*THESIS, "control.identification.command_filter_rad_s=20")
ALL = (0, 1, 2, 3)
SEEDS = pytest.mark.parametrize("seeds", [ALL[:1], pytest.param(ALL, marks=pytest.mark.long)], ids=["one", "all"])


@cache
def _flown(name: str, *sets: str, seed: int = 0) -> Trace:
    """Fly a scenario; each flight once."""
    return fly_plan(plan(load_scenario(name, (*sets, f"seed={seed}"))))[0]


def _measured(name: str, *sets: str, seeds: tuple[int, ...] = ALL) -> list[PullUp]:
    scenario = load_scenario(name, sets)
    return [pull_up(_flown(name, *sets, seed=seed).columns, control_hz=100, ticks=scenario.ticks) for seed in seeds]


def test_gains_have_the_same_signs_over_the_whole_table(f16: Aircraft) -> None:
    points = pitch_points(f16, cg_shift_cbar=0.0176)
    assert [point.level for point in points] == [False, *[True] * 10]  # at 25 lb/ft^2 the F-16 cannot fly level
    table = gain_table(points)
    assert np.all(np.sign(table.gains) == [1.0, 1.0, -1.0, -1.0])
    for point in points[1:]:
        gains = table.at(point.dynamic_pressure_pa)
        assert closed_loop_poles(point, gains, actuator_rad_s=20.2).real.max() < -3.0


@pytest.mark.parametrize("law", ["nz-adaptive", "nz-scheduled"])
def test_below_the_lowest_level_point_both_laws_fly(law: str) -> None:
    slow = (
        "failures=[]",
        "condition.mach=0.2",
        "condition.altitude_ft=1000",
        "command.amplitude_g=0.1",
        f"control.law={law}",
    )
    (found,) = _measured("cg-shift", *slow, seeds=(0,))  # 56 lb/ft^2
    assert not found.lost
    assert max(found.overshoot, found.undershoot) < 0.15


def test_points_have_the_given_conditions_and_obey_kinematics(f16: Aircraft) -> None:
    ahead, aft = (pitch_points(f16, cg_shift_cbar=shift) for shift in (0.0176, 0.0676))
    assert [p.dynamic_pressure_pa / PSF for p in ahead] == pytest.approx(DYNAMIC_PRESSURES_PSF)
    for one, other in zip(ahead, aft, strict=True):
        # a_n = V (q - alpha') / g along the lift; the body-fixed accelerometer agrees at small alpha
        speed = np.sqrt(2.0 * one.dynamic_pressure_pa / 1.225)
        if one.dynamic_pressure_pa > 200.0 * PSF:
            assert one.c[0] == pytest.approx(-speed / G0 * one.A[0, 0], rel=0.05)
            assert one.d == pytest.approx(-speed / G0 * one.b[0], rel=0.05)
        assert other.A[1, 0] > one.A[1, 0]  # less stable


def test_a_flight_in_g_has_no_pitch_rate_command_and_a_throttle() -> None:
    planned = plan(load_scenario("throttle-and-cg", ["duration_s=13", "command.start_s=11"]))
    samples = list(fly(assemble(planned)))
    assert samples[-1].load_factor is not None
    trace, metrics = fly_plan(planned)
    assert metrics.tracking_rms_pre_deg_s is None  # there is no pitch-rate command
    assert np.all(np.isnan(trace["q_ref_deg_s"]))
    # Full throttle from 10 s on; before that, either of the two settings.
    throttle = trace["throttle_cmd_norm"]
    assert set(throttle[:1000]) == {0.1, 1.0}
    assert set(throttle[1000:]) == {1.0}
    assert np.all(np.abs(trace["airspeed_m_s"][:1000] / FT - 502.0) < 5.0)
    assert trace["airspeed_m_s"][-1] / FT > 520.0
    assert trace["thrust_n"][-1] > 2.0 * trace["thrust_n"][900]
    assert np.max(np.abs(command_g(trace.columns)[1100:])) == pytest.approx(2.0, abs=1e-6)
    assert np.array_equal(trace["nz_meas_g"], trace["nz_g"])
    assert trace["model_a_1"][-1] == samples[-1].load_factor.model_a_1


def test_without_an_autothrottle_the_throttle_is_constant() -> None:
    trace = _flown("cg-shift", "control.autothrottle.enabled=false", "duration_s=13")
    assert np.all(np.isnan(trace["throttle_cmd_norm"]))
    assert np.ptp(trace["thrust_n"][300:900]) < 0.05 * trace["thrust_n"][600]


def test_the_noise_of_the_accelerometer_does_not_change_the_other_sensors() -> None:
    quiet, noisy = (_flown("cg-shift", *SCHEDULED, f"sensors.nz_std_g={std}", "duration_s=13") for std in (0.0, 0.01))
    error = noisy["nz_meas_g"] - noisy["nz_g"]
    n = len(error)
    assert error.std() == pytest.approx(0.01, rel=4.0 / np.sqrt(2 * n))
    assert abs(error.mean()) < 4.0 * 0.01 / np.sqrt(n)
    for measured, true in (("q_meas_deg_s", "q_deg_s"), ("theta_meas_deg", "theta_deg")):
        assert quiet[measured] - quiet[true] == pytest.approx(noisy[measured] - noisy[true], abs=1e-9)


@SEEDS
@pytest.mark.parametrize(("name", "margin"), [("cg-shift", 0.01), ("throttle-and-cg", 0.02)])
def test_after_the_cg_shift_the_adaptive_law_overshoots_less(name: str, margin: float, seeds: tuple[int, ...]) -> None:
    adaptive, scheduled, soft = (_measured(name, *more, seeds=seeds) for more in ((), SCHEDULED, SOFT))
    assert not any(found.lost for found in (*adaptive, *scheduled, *soft))
    for mine, theirs, softly in zip(adaptive, scheduled, soft, strict=True):
        assert mine.overshoot < theirs.overshoot - margin
        assert mine.overshoot < softly.overshoot - margin
        assert mine.disturbance_g < softly.disturbance_g / 2.0


@SEEDS
def test_overshoot_is_the_price_of_a_fast_response(seeds: tuple[int, ...]) -> None:
    """The scheduled law with the same poles tracks a pull-up more closely, with and without the shift: adaptation is not the only cause of the overshoot."""
    adaptive, scheduled = (_measured("cg-shift", *more, seeds=seeds) for more in ((), SCHEDULED))
    for mine, theirs in zip(adaptive, scheduled, strict=True):
        assert mine.tracking_rms_g > theirs.tracking_rms_g


@SEEDS
def test_flutter_and_its_remedies(seeds: tuple[int, ...]) -> None:
    loss = ("failures.0.to=0.2",)
    thesis, filtered, calm = (_measured("pull-up-loss", *loss, *more, seeds=seeds) for more in (THESIS, FILTERED, ()))
    assert min(found.flutter_deg for found in thesis) > 0.6
    assert max(found.flutter_deg for found in filtered) < 0.8 * min(found.flutter_deg for found in thesis)
    assert max(found.flutter_deg for found in calm) < 0.25


@SEEDS
@pytest.mark.parametrize("to", [0.5, 0.35, 0.2])
def test_elevator_losses_are_survived_with_less_overshoot(to: float, seeds: tuple[int, ...]) -> None:
    loss = f"failures.0.to={to}"
    adaptive, scheduled = (_measured("pull-up-loss", loss, *more, seeds=seeds) for more in ((), SCHEDULED))
    assert not any(found.lost for found in (*adaptive, *scheduled))
    for mine, theirs in zip(adaptive, scheduled, strict=True):
        assert mine.overshoot < theirs.overshoot - 0.02
        assert mine.undershoot < theirs.undershoot


def test_accelerometer_noise_loses_the_aircraft_with_the_thesis_settings_only() -> None:
    noise = ("sensors.nz_std_g=0.005",)
    assert sum(found.lost for found in _measured("cg-shift", *noise, *THESIS)) >= 3
    assert not any(found.lost for found in _measured("cg-shift", *noise))


@pytest.mark.parametrize("law", ["nz-adaptive", "nz-scheduled"])
def test_a_complete_loop_is_flown(law: str) -> None:
    trace = _flown("loop", f"control.law={law}")
    assert len(trace) == 4200
    assert np.sum(trace["q_deg_s"]) / 100.0 == pytest.approx(360.0, abs=10.0)
    held = increment_g(trace.columns)[700:3900]
    assert 3.8 < held.min()
    assert held.max() < 4.2
    assert np.max(np.abs(trace["beta_deg"])) < 0.1


@pytest.mark.parametrize("law", ["nz-adaptive", "nz-scheduled"])
def test_the_command_is_tracked_from_333_to_680_feet_per_second(law: str) -> None:
    trace = _flown("speed-range", f"control.law={law}")
    assert len(trace) == 6000
    assert trace["airspeed_m_s"][[0, -1]] / FT == pytest.approx([332.6, 680.0], abs=2.0)
    pressure = [0.7 * standard_air(h * FT).pressure_pa / PSF for h in trace["altitude_ft"]] * trace["mach"] ** 2
    assert (
        DYNAMIC_PRESSURES_PSF[1] < pressure.min() < pressure.max() < DYNAMIC_PRESSURES_PSF[-1]
    )  # range of the gain schedule
    level = np.cos(np.radians(trace["theta_meas_deg"])) * np.cos(np.radians(trace["phi_meas_deg"]))
    error = increment_g(trace.columns) - (trace["nz_ref_g"] - level)
    assert (
        max(float(np.sqrt(np.mean(part**2))) for part in np.split(error, 6)) < 0.3
    )  # a lag of the response to +-0.5 g
    assert np.max(np.abs(increment_g(trace.columns))) < 0.65


@pytest.mark.parametrize("form", ["plain", "factored"])
def test_single_precision_gives_nearly_the_same_flight(form: str) -> None:
    identified = f"control.identification.form={form}"
    single = _flown("cg-shift", identified, "control.identification.precision=single")
    double = _flown("cg-shift", identified)
    off = np.max(np.abs(single["nz_g"] - double["nz_g"]))
    assert 0.0 < off < 0.01


def test_without_the_prefilter_the_fixed_law_runs_into_the_rate_limit() -> None:
    trace = _flown("loop", "control.law=nz-scheduled", "command.filter_rad_s=0")
    rate = np.abs(np.diff(trace["elevator_deg"])) * 100.0
    assert np.mean(rate[500:3000] > 59.0) > 0.9
    adaptive = _flown("loop", "command.filter_rad_s=0")
    assert np.mean(np.abs(np.diff(adaptive["elevator_deg"][500:3000])) * 100.0 > 59.0) < 0.02


@pytest.mark.parametrize(("mach", "cycles"), [(0.27, True), (0.28, False)])
def test_below_the_speed_range_the_fixed_law_oscillates_at_its_rate_limit(mach: float, cycles: bool) -> None:
    slow = [f"condition.mach={mach}", "duration_s=20"]
    fixed = _flown("speed-range", *SCHEDULED, *slow)
    assert (np.mean(np.abs(np.diff(fixed["elevator_deg"][1000:])) * 100.0 > 59.0) > 0.9) == cycles
    adaptive = _flown("speed-range", *slow)
    assert np.mean(np.abs(np.diff(adaptive["elevator_deg"][1000:])) * 100.0 > 59.0) < 0.02


def test_the_correction_by_k_works_with_the_scheduled_law() -> None:
    """With the prefilter: at a step the corrected loop demands 1/K times the elevator, which saturates its rate."""
    adapt = ["adaptation.enabled=true", "adaptation.estimator=k", 'estimators=[{name="k"}]', "command.filter_rad_s=3"]
    corrected = _measured("pull-up-loss", *SCHEDULED, *adapt, seeds=(0,))[0]
    fixed = _measured("pull-up-loss", *SCHEDULED, "command.filter_rad_s=3", seeds=(0,))[0]
    assert corrected.disturbance_g < 0.7 * fixed.disturbance_g
    assert corrected.tracking_rms_g < fixed.tracking_rms_g
    stepped = _flown("pull-up-loss", *SCHEDULED, *adapt[:3])
    assert np.mean(np.abs(np.diff(stepped["elevator_deg"][1200:1700])) * 100.0 > 59.0) > 0.9


def test_the_metrics_of_a_flight_in_g_are_in_g(tmp_path: Path) -> None:
    result = run(load_scenario("cg-shift"), tmp_path / "run", rerun=False)
    trace, summary = result.trace, result.summary
    error, late = trace["nz_g"] - trace["nz_ref_g"], trace["t_s"] >= 10.3 - 1e-9
    assert summary.metrics.tracking_rms_post_nz_g == pytest.approx(np.sqrt(np.mean(error[late] ** 2)))
    assert summary.metrics.tracking_rms_post_deg_s is None
    one = pull_up(trace.columns, control_hz=100, ticks=1800)
    expected = [
        getattr(summary.metrics, f"pull_up_{key}")
        for key in ("overshoot", "undershoot", "disturbance_g", "flutter_deg")
    ]
    assert expected == [one.overshoot, one.undershoot, one.disturbance_g, one.flutter_deg]
    assert "nz - nz_ref" in run_text(result.plan.scenario, summary)
    page = (tmp_path / "run" / "report.html").read_text()
    assert "RMS of nz - reference" in page
    assert "pull_up_overshoot" in page
    other = run(load_scenario("nominal", ["duration_s=1"])).metrics
    assert other.tracking_rms_pre_nz_g is None is other.pull_up_overshoot


def test_a_campaign_of_flights_in_g_reports_the_load_factor() -> None:
    flown = campaigns.fly(load_scenario("cg-shift", ["sensors.nz_std_g=0.002"]), 7)
    assert "RMS of nz - nz_ref" in flown.reason
    campaign_report(flown)
    assert "Median RMS of nz - nz_ref from 0.3 s after the failure" in headline(flown.summary)
    overshoots = flown.quantity("pull_up_overshoot").known
    assert len(set(overshoots)) == 7


def test_both_laws_in_one_recording_and_on_one_page(tmp_path: Path) -> None:
    short = ["duration_s=13"]
    folders = [tmp_path / law for law in ("nz-adaptive", "nz-scheduled")]
    for folder in folders:
        run(load_scenario("cg-shift", [*short, f"control.law={folder.name}"]), folder, rerun=False, report=False)
    runs = load_runs(folders)
    write_comparison(tmp_path / "both.rrd", runs, tables=())
    for entity, column in (("1_nz_adaptive", "nz_g"), ("2_nz_scheduled", "nz_g")):
        index = int(entity[0]) - 1
        _, values = series(tmp_path / "both.rrd", f"/load_factor/{entity}", "Scalars:scalars")
        assert values == pytest.approx(runs[index].trace[column])
    _, reference = series(tmp_path / "both.rrd", "/load_factor/nz_reference/1_nz_adaptive", "Scalars:scalars")
    assert reference == pytest.approx(runs[0].trace["nz_ref_g"])
    (section,) = (s for s in comparison_report(runs).sections if s.heading == "Flights")
    assert section.items


@pytest.mark.parametrize(
    ("sets", "problem"),
    [
        (["adaptation.enabled=true", "adaptation.estimator=k", 'estimators=[{name="k"}]'],
         "adaptation.enabled: must be false with control.law = 'nz-adaptive', which identifies its own model (got true)"),
        (["control.poles=[[-1,0],[-2,0]]"],
         "control.poles: must be three with control.law = 'nz-adaptive': two states and the integral (got 2)"),
        (["control.poles=[[-4,2],[-4,2],[-10,0]]"],
         "control.poles: complex ones must come in conjugate pairs, [re, im] and [re, -im] (got [[-4.0, 2.0], [-4.0, 2.0], [-10.0, 0.0]])"),
        (["control.autothrottle.then_fps=600", "control.autothrottle.then_at_s=99"],
         "control.autothrottle.then_at_s: must be no later than the last tick, 17.99 s (got 99)"),
        (["control.autothrottle.low_norm=1"], "control.autothrottle.low_norm: must be below high_norm = 1 (got 1)"),
        (["command.amplitude_deg_s=3"], "command.amplitude_deg_s: has no effect with control.law = 'nz-adaptive'"),
        (["command.kind=none", "command.amplitude_g=3"], "command.amplitude_g: 'none' has no such key ('3-2-1-1', 'chirp', 'constant', 'dither', 'doublet', 'multisine', 'pulse', 'random' have it); remove it"),
        (["command.count=3"], "command.count: 'pulse' has no such key ('3-2-1-1', 'chirp', 'doublet', 'multisine', 'random' have it); remove it"),
        (["control.law=nz-scheduled", "control.identification.patience=3"],
         "control.identification: 'nz-scheduled' has no such key ('nz-adaptive' has it); remove it"),
        (["control.law=proportional", "control.autothrottle.enabled=true"],
         "control.autothrottle: 'proportional' has no such key ('nz-adaptive', 'nz-scheduled' have it); remove it"),
        (["control.autothrottle.then_at_s=3"], "control.autothrottle.then_at_s: has no effect with control.autothrottle.then_fps = 0"),
        (["control.autothrottle.enabled=false", "control.autothrottle.high_norm=0.9"],
         "control.autothrottle.high_norm: has no effect with control.autothrottle.enabled = false"),
        (["control.gains={alpha=1, q_s=1, elevator=0, reference_s=1}"],
         "control.gains: 'nz-adaptive' has no such key ('proportional', 'proportional-integral' have it); remove it"),
        (["control.law=nz-scheduled", "adaptation.enabled=true", "adaptation.feedback=position"],
         "adaptation.feedback: has no effect with control.law = 'nz-scheduled'"),
        (['estimators=[{name="p", kind="plid"}]', "estimators.0.window=9"], "estimators.0.window: 'plid' has no such key ('input-kalman', 'loop-gain', 'retrospective-cost', 'two-stage' have it)"),
        (['estimators=[{name="p"}]', "estimators.0.block_fade=1.1"],
         "estimators.0.block_fade: 'loop-gain' has no such key ('plid' has it)"),
    ],
)  # fmt: skip
def test_contradictions_and_idle_keys(sets: list[str], problem: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        load_scenario("cg-shift", sets)
    assert any(problem in line for line in caught.value.problems), caught.value.problems


def test_a_linear_aircraft_has_no_envelope() -> None:
    linear = next(n for n in ("thesis-loss", "nominal") if load_scenario(n).aircraft.model != "f16")
    with pytest.raises(ScenarioError, match="'nz-scheduled' is scheduled over the envelope"):
        plan(load_scenario(linear, ["control={law='nz-scheduled'}"]))
