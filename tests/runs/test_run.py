"""Complete flights on the nonlinear aircraft, and their folders."""

from __future__ import annotations

import hashlib
import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import flightbed
from flightbed.analysis.result import Result
from flightbed.analysis.trace import read_trace
from flightbed.core import data
from flightbed.core.errors import AircraftError, NoTrimError, OutputError
from flightbed.core.units import DEG
from flightbed.flight.plan import plan
from flightbed.runs.run import run
from flightbed.scenario.reading import load_scenario

CONTRACT_COLUMNS = [
    "t_s",
    "q_cmd_deg_s",
    "q_ref_deg_s",
    "q_deg_s",
    "alpha_deg",
    "theta_deg",
    "q_meas_deg_s",
    "alpha_meas_deg",
    "elevator_cmd_deg",
    "elevator_deg",
    "mach",
    "altitude_ft",
    "nz_g",
    "effectiveness_true",
    "elevator_force_true",
    "cg_shift_cbar",
    "gust_up_fps",
]


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Result:
    return run(load_scenario("elevator-loss"), tmp_path_factory.mktemp("runs") / "elevator-loss")


SEEDS = pytest.mark.parametrize("seeds", [4, pytest.param(20, marks=pytest.mark.long)])


@SEEDS
def test_the_adaptive_flight_is_kept_over_all_seeds(seeds: int) -> None:
    """0 departures of 20: with 95 % confidence fewer than 14 % of flights depart (exact binomial)."""
    outcomes = [run(load_scenario("elevator-loss", [f"seed={seed}"])) for seed in range(seeds)]
    assert [r.metrics.departed for r in outcomes] == [False] * seeds
    assert all(len(r.trace) == 1650 for r in outcomes)
    assert max(np.abs(r.trace["alpha_deg"]).max() for r in outcomes) < 10.0
    final = np.array([r.metrics.estimators["scheduled"].median_abs_error_post for r in outcomes])
    assert np.median(final) < 0.05


@SEEDS
def test_the_fixed_law_departs_within_seconds_over_all_seeds(seeds: int) -> None:
    for seed in range(seeds):
        metrics = run(load_scenario("elevator-loss-fixed", [f"seed={seed}"])).metrics
        assert metrics.departed
        assert metrics.departed_at_s is not None
        assert 4.5 < metrics.departed_at_s < 12.0


def test_nothing_fails_nothing_departs() -> None:
    result = run(load_scenario("nominal"))
    assert not result.metrics.departed
    assert np.all(result.trace["effectiveness_true"] == 1.0)


def test_level_flight_shows_the_loss_without_dither() -> None:
    """No command at all: absolute deflection makes K observable; the adaptive aircraft stays controlled, the one with the fixed law departs."""
    adaptive = run(load_scenario("straight-and-level"))
    assert adaptive.metrics.estimators["scheduled"].rms_error_smoothed_post < 0.05
    assert np.abs(adaptive.trace["alpha_deg"] - adaptive.trace["alpha_deg"][0]).max() < 1.0
    assert run(load_scenario("straight-and-level", ["adaptation.enabled=false"])).metrics.departed


def test_where_the_elevator_trims_nothing_only_dither_shows_the_loss() -> None:
    """With the c.g. 5.7 % aft both filters find 80 % lost by the dither, and neither within 1.5 s without."""
    shaken = run(load_scenario("dithered-level"))
    still = run(load_scenario("dithered-level", ["command.kind=none"]))
    assert abs(shaken.summary.trim.elevator_deg) < 0.05
    for name, error in (("scheduled", 0.03), ("short-period", 0.08)):
        seen, blind = (r.metrics.estimators[name] for r in (shaken, still))
        assert seen.median_abs_error_post < error
        assert seen.first_within_20pct_s is not None
        assert seen.first_within_20pct_s < 0.6
        assert blind.first_within_20pct_s is None or blind.first_within_20pct_s > 1.5
    assert still.metrics.estimators["short-period"].median_abs_error_post > 0.6  # the prior, 1, against 0.2
    assert np.abs(shaken.trace["nz_g"] - 1.0).max() < 0.2
    assert np.std(shaken.trace["q_cmd_deg_s"][-450:]) == pytest.approx(np.std(shaken.trace["q_cmd_deg_s"][:450]))


def test_the_random_command_has_a_seed_of_its_own() -> None:
    def commanded(*overrides: str) -> list[float]:
        sets = ["command.kind=random", "duration_s=10", *overrides]
        return list(run(load_scenario("nominal", sets)).trace["q_cmd_deg_s"])

    plain = commanded()
    assert commanded("seed=7") == plain
    assert commanded("command.seed=7") != plain


@pytest.mark.parametrize(
    "overrides",
    [
        ["control.law=proportional-integral"],
        ["estimators.0.memory=fading", "estimators.0.forgetting=0.93"],
        ["aircraft.cg_shift_cbar=0.03", "condition.mach=0.6", "failures.0.to=0.4"],
        ["atmosphere.turbulence=light"],
        ["rates.control_hz=50", "rates.plant_hz=200", "estimators.0.window=15"],
        ["adaptation.feedback=position"],
        ["control.poles=[[-1.5,0],[-8,8],[-8,-8]]"],
        ["command.kind=constant", "command.amplitude_deg_s=1.0", "duration_s=8"],
    ],
    ids=lambda o: o[0],
)
def test_options_change_the_flight_and_the_aircraft_is_kept(flown: Result, overrides: list[str]) -> None:
    result = run(load_scenario("elevator-loss", overrides))
    assert not result.metrics.departed
    n = min(len(result.trace), len(flown.trace))
    assert not np.array_equal(result.trace["q_deg_s"][:n], flown.trace["q_deg_s"][:n])


@pytest.mark.parametrize("plant_hz", [100, 200])
def test_failure_acts_at_its_tick_and_not_before(plant_hz: int) -> None:
    rate = [f"rates.plant_hz={plant_hz}", "duration_s=5"]
    failed, healthy = (run(load_scenario(name, rate)).trace for name in ("elevator-loss", "nominal"))
    truth = failed["effectiveness_true"]
    assert np.flatnonzero(np.diff(truth)).tolist() == [449]
    assert (truth[449], truth[450]) == (1.0, 0.2)
    assert np.array_equal(failed["q_deg_s"][:451], healthy["q_deg_s"][:451])
    assert failed["q_deg_s"][451] != healthy["q_deg_s"][451]


def test_failures_act_in_order_of_time_whatever_their_order_in_the_file() -> None:
    two = ["failures.0.at_s=2", "failures.0.to=0.8", "failures.1.at_s=1", "failures.1.to=0.9", "duration_s=3"]
    truth = run(load_scenario("nominal", two)).trace["effectiveness_true"]
    assert [truth[99], truth[100], truth[199], truth[200], truth[-1]] == [1.0, 0.9, 0.9, 0.8, 0.8]


CG = ["failures.1.kind=cg-shift", "failures.1.at_s=2", "failures.1.shift_cbar=0.03"]


def test_elevator_and_airframe_fail_side_by_side() -> None:
    """Neither replaces the other; tracking counts from the first, K from the elevator's own."""
    result = run(load_scenario("elevator-loss", [*CG, "failures.0.kind=structural", "failures.0.force_to=0.7"]))
    t = result.trace
    columns = [t[name] for name in ("effectiveness_true", "elevator_force_true", "cg_shift_cbar")]
    assert [tuple(c[k] for c in columns) for k in (199, 200, 449, 450, len(t) - 1)] == [
        (1.0, 1.0, 0.0), (1.0, 1.0, 0.03), (1.0, 1.0, 0.03), (0.2, 0.7, 0.03), (0.2, 0.7, 0.03),
    ]  # fmt: skip
    assert (result.summary.failed_at_s, result.summary.metrics.estimators_since_s) == (2.0, 4.5)


def test_a_cg_shift_acts_at_its_tick_and_not_before() -> None:
    calm = ["adaptation.enabled=false", "duration_s=3"]
    moved, healthy = (
        run(load_scenario("elevator-loss-fixed", [*calm, "failures.0.at_s=2.9", *o])).trace for o in (CG, [])
    )
    assert np.array_equal(moved["q_deg_s"][:201], healthy["q_deg_s"][:201])
    assert moved["q_deg_s"][201] != healthy["q_deg_s"][201]


def test_what_a_force_alone_does() -> None:
    """The moment is unchanged: K is 1 without a change to detect, but the flight differs."""
    kind = ["failures.0.kind=structural", "failures.0.at_s=2", "failures.0.to=1", "failures.0.force_to=0"]
    hurt, healthy = (run(load_scenario("nominal", [*o, "duration_s=5"])) for o in (kind, []))
    assert np.array_equal(hurt.trace["q_deg_s"][:201], healthy.trace["q_deg_s"][:201])
    assert hurt.trace["alpha_deg"][201] != healthy.trace["alpha_deg"][201]
    assert hurt.metrics.estimators_since_s == 2.0


def test_gusts_are_flown_told_and_no_part_of_the_trim() -> None:
    gust = ["gusts.0.at_s=1", "gusts.0.up_fps=20", "gusts.0.rise_s=0.5", "gusts.0.hold_s=0.2"]
    more = ["gusts.1.at_s=3", "gusts.1.up_fps=-5", "gusts.1.rise_s=0.25"]
    still, blown = (
        run(load_scenario("nominal", ["command.kind=none", "duration_s=5", *o])) for o in ([], [*gust, *more])
    )
    assert blown.plan.trim == still.plan.trim
    air = blown.trace["gust_up_fps"]
    assert air[[0, 100, 125, 150, 170, 195, 220, 325, 350, -1]] == pytest.approx(
        [0, 0, 10, 20, 20, 10, 0, -5, 0, 0], abs=1e-9
    )
    assert np.array_equal(blown.trace["alpha_deg"][:101], still.trace["alpha_deg"][:101])
    # Upward air lifts the nose into it: w / V, less what the aircraft has yielded in half a second.
    rise = (blown.trace["alpha_deg"] - still.trace["alpha_deg"])[150] * DEG
    assert 0.6 < rise * still.trace["airspeed_m_s"][150] / (20 * 0.3048) < 1.0
    assert np.abs(blown.trace["nz_g"] - still.trace["nz_g"]).max() > 0.2


def test_gusts_leave_the_turbulence_as_it_is() -> None:
    """With the same seed the turbulence is the same: the effect of a gust in turbulence equals that in calm air within a few per cent."""
    gust = ["gusts.0.at_s=0.5", "gusts.0.up_fps=5", "gusts.0.rise_s=0.2", "command.kind=none", "duration_s=1.5"]
    gust += ["adaptation.enabled=false", "estimators=[]", "sensors.q_std_deg_s=1e-9", "sensors.alpha_std_deg=1e-9"]
    added = []
    for air in ("none", "light"):
        blown, still = (
            run(load_scenario("nominal", [*o, f"atmosphere.turbulence={air}"])).trace["alpha_deg"]
            for o in (gust, gust[3:])
        )
        added.append(blown - still)
    assert np.abs(added[1] - added[0]).max() < 0.05 * np.abs(added[0]).max()


@pytest.mark.parametrize("law", ["proportional", "proportional-integral"])
@pytest.mark.parametrize("feedback", ["effective", "position"])
def test_the_command_is_what_law_and_correction_say(law: str, feedback: str) -> None:
    """Recomputed from the trace alone: smoothed K-hat, floor, trim included, stops, the integral held at the stops."""
    harder = ["command.amplitude_deg_s=7", "failures.0.to=0.15"]  # so that the stops are reached
    result = run(load_scenario("elevator-loss", [f"control.law={law}", f"adaptation.feedback={feedback}", *harder]))
    t, gains, trim = result.trace, result.plan.gains, result.plan.trim
    assert gains is not None
    believed = np.maximum(t["scheduled.effectiveness_smoothed"], 0.08)
    fed = t["elevator_meas_deg"] * DEG * (believed if feedback == "effective" else 1.0)
    q, alpha, r = t["q_meas_deg_s"] * DEG, t["alpha_meas_deg"] * DEG, t["q_ref_deg_s"] * DEG
    demand = trim.elevator_rad + gains.reference * r + gains.alpha * (alpha - trim.alpha_rad) + gains.q * q
    demand = demand + gains.elevator * (fed - trim.elevator_rad)
    integral, cut, times_cut = 0.0, False, 0
    for k in range(len(t)):
        wanted = (demand[k] + integral) / believed[k]
        command = min(max(wanted, -25 * DEG), 25 * DEG)
        assert t["elevator_cmd_deg"][k] * DEG == pytest.approx(command, abs=1e-9), k
        if not cut:  # of the tick before
            integral += gains.integral * (r[k] - q[k]) / 100
        cut = command != wanted
        times_cut += cut
    assert times_cut > 10


def test_the_sensors_are_as_noisy_as_the_scenario_says(flown: Result) -> None:
    for measured, true, std in (("q_meas_deg_s", "q_deg_s", 0.1108), ("alpha_meas_deg", "alpha_deg", 0.03)):
        error = flown.trace[measured] - flown.trace[true]
        assert np.std(error) == pytest.approx(std, rel=4 / np.sqrt(2 * len(error)))


def test_the_seed_reaches_the_air() -> None:
    """Two seeds fly through different turbulence: with perfect sensors only the air can cause the difference."""
    calm = ["atmosphere.turbulence=moderate", "sensors.q_std_deg_s=1e-9", "sensors.alpha_std_deg=1e-9", "duration_s=2"]
    calm += ["adaptation.enabled=false", "command.kind=none", "estimators=[]"]
    one, two = (run(load_scenario("nominal", [*calm, f"seed={seed}"])).trace["alpha_deg"] for seed in (1, 2))
    assert np.abs(one - two).max() > 0.05


def test_the_folder_holds_what_the_contract_says(flown: Result) -> None:
    assert flown.folder is not None
    assert sorted(p.name for p in flown.folder.iterdir()) == [
        "flight.rrd",
        "metrics.json",
        "report.html",
        "scenario.toml",
        "trace.parquet",
    ]
    assert load_scenario(flown.folder / "scenario.toml") == flown.plan.scenario
    assert flown.plan.scenario.aircraft.sha256 == flown.plan.aircraft.sha256
    trace = read_trace(flown.folder / "trace.parquet")
    assert trace.estimators == ("scheduled", "expanding")
    assert set(CONTRACT_COLUMNS) <= set(trace.columns)
    for name in trace.estimators:
        assert {f"{name}.effectiveness", f"{name}.effectiveness_std", f"{name}.effectiveness_smoothed"} <= set(
            trace.columns
        )
    for column in trace.columns:
        np.testing.assert_array_equal(trace[column], flown.trace[column])
    assert trace.to_pandas().shape == (1650, len(trace.columns))
    metrics = json.loads((flown.folder / "metrics.json").read_text())
    assert {
        "scenario", "seed", "departed", "departed_at_s", "tracking_rms_pre_deg_s", "tracking_rms_post_deg_s", "estimators",
        "wall_time_s", "real_time_factor", "versions",
    } <= set(metrics)  # fmt: skip
    assert set(metrics["estimators"]["scheduled"]) == {
        "final", "median_abs_error_post", "rms_error_smoothed_post", "std_pre", "first_within_20pct_s",
        "first_within_20pct_smoothed_s", "nis_mean", "detected_at_s", "false_alarms", "nees_mean_post", "efficiency",
        "nis_expected",
    }  # fmt: skip


def test_units_are_in_the_column_metadata(flown: Result) -> None:
    import pyarrow.parquet as pq

    assert flown.folder is not None
    schema = pq.read_schema(flown.folder / "trace.parquet")
    units = {field.name: field.metadata[b"unit"].decode() for field in schema}
    assert units["q_deg_s"] == "deg/s"
    assert units["altitude_ft"] == "ft"
    assert units["t_s"] == "s"
    assert units["gust_up_fps"] == "ft/s"
    assert units["cg_shift_cbar"] == "mean aerodynamic chord"
    assert units["scheduled.effectiveness"] == "1"


def _fingerprint(result_columns: dict[str, np.ndarray]) -> str:
    digest = hashlib.sha256()
    for name, values in result_columns.items():
        digest.update(name.encode() + values.tobytes())
    return digest.hexdigest()


def test_a_flight_repeated_in_another_process_is_bit_identical(flown: Result) -> None:
    code = (
        "import hashlib, flightbed\n"
        "d = hashlib.sha256()\n"
        "for n, v in flightbed.run(flightbed.load_scenario('elevator-loss')).trace.columns.items(): d.update(n.encode() + v.tobytes())\n"
        "print(d.hexdigest())"
    )
    other = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip()
    assert other == _fingerprint(dict(flown.trace.columns))
    assert other != _fingerprint(dict(run(load_scenario("elevator-loss", ["seed=1"])).trace.columns))


def test_the_resolved_scenario_reflies_the_same_flight(flown: Result) -> None:
    assert flown.folder is not None
    again = run(load_scenario(flown.folder / "scenario.toml"))
    assert _fingerprint(dict(again.trace.columns)) == _fingerprint(dict(flown.trace.columns))


def test_samples_stream_from_fly() -> None:
    samples = flightbed.fly(load_scenario("nominal"))
    first = next(samples)
    assert first.tick == 0
    assert first.truth.alpha_rad == pytest.approx(0.0148, abs=1e-4)
    assert len(first.estimates) == 2
    assert [next(samples).tick for _ in range(3)] == [1, 2, 3]


def test_no_trim_names_the_condition() -> None:
    with pytest.raises(NoTrimError, match=r"^no trim at Mach 0\.30, 40000 ft: .*alpha.*residual 0\.13 g in lift"):
        plan(load_scenario("nominal", ["condition.mach=0.3", "condition.altitude_ft=40000"]))


def test_an_earlier_run_is_replaced_and_anything_else_is_refused(tmp_path: Path) -> None:
    short = load_scenario("nominal", ["duration_s=0.2"])
    target = tmp_path / "run"
    run(short, target, rerun=False)
    run(load_scenario("nominal", ["duration_s=0.3"]), target, rerun=False)
    assert len(read_trace(target / "trace.parquet")) == 30
    assert [p.name for p in tmp_path.iterdir()] == ["run"]
    (target / "thesis.tex").write_text("mine")
    with pytest.raises(OutputError, match=r"holds 'thesis\.tex', which is not from a run"):
        run(short, target, rerun=False)
    assert (target / "thesis.tex").read_text() == "mine"
    file = tmp_path / "file"
    file.write_text("mine")
    with pytest.raises(OutputError, match="is a file"):
        run(short, file, rerun=False)


def test_a_failed_write_leaves_the_old_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    short, target = load_scenario("nominal", ["duration_s=0.2"]), tmp_path / "run"
    run(short, target, rerun=False)
    before = (target / "trace.parquet").read_bytes()

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("flightbed.analysis.trace.Trace.write", full)
    with pytest.raises(OutputError, match="cannot be written: No space left on device"):
        run(short, target, rerun=False)
    assert (target / "trace.parquet").read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["run"]


def test_runs_that_end_at_once_take_a_folder_each(tmp_path: Path) -> None:
    """Two processes, one name: two complete folders, none overwritten."""
    code = (
        "import sys, flightbed\n"
        "s = flightbed.load_scenario('nominal', ['duration_s=0.2', 'seed=' + sys.argv[1]])\n"
        "print(flightbed.run(s, 'runs/nominal', rerun=False, replace=False).folder)"
    )
    started = [
        subprocess.Popen([sys.executable, "-c", code, str(seed)], cwd=tmp_path, stdout=subprocess.PIPE, text=True)
        for seed in range(2)
    ]
    folders = {process.communicate(timeout=120)[0].strip() for process in started}
    assert folders == {"runs/nominal", "runs/nominal-2"}
    seeds = {json.loads((tmp_path / f / "metrics.json").read_text())["seed"] for f in folders}
    assert seeds == {0, 1}
    assert sorted(p.name for p in (tmp_path / "runs").iterdir()) == sorted(Path(f).name for f in folders)


def test_a_long_flight_stays_upright_and_ends_in_time() -> None:
    """Two minutes after the doublets: the stock model's spiral mode, unstable here, is held by the wing leveller."""
    result = run(load_scenario("nominal", ["duration_s=120"]))
    assert result.summary.ended == "time"
    assert result.summary.bank_max_deg < 0.1
    assert np.abs(result.trace["psi_deg"]).max() < 1.0


def test_a_flight_ends_at_the_ground() -> None:
    dive = ["condition.altitude_ft=2000", "command.kind=constant", "command.amplitude_deg_s=-4", "duration_s=60"]
    result = run(load_scenario("nominal", dive))
    assert result.summary.ended == "ground"
    assert not result.metrics.departed
    assert result.trace["altitude_ft"][-1] < 0.0 < result.trace["altitude_ft"][-2]


def test_a_failure_that_the_flight_does_not_reach_is_not_reported() -> None:
    lost = run(load_scenario("elevator-loss-fixed", ["failures.1.at_s=16", "failures.1.to=0.1"]))
    assert lost.summary.failed_at_s == 4.5
    only = run(load_scenario("elevator-loss-fixed", ["failures.0.at_s=16", "aircraft.cg_shift_cbar=0.5"]))
    assert only.metrics.departed
    assert only.summary.failed_at_s is None
    assert only.metrics.tracking_rms_post_deg_s is None


def test_a_resolved_scenario_names_the_very_aircraft(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Written with an absolute path and a fingerprint: it flies from any folder, and rejects a changed aircraft."""
    own = tmp_path / "own"
    shutil.copytree(data.find("aircraft", "f16"), own)
    monkeypatch.chdir(tmp_path)
    run(load_scenario("nominal", ["aircraft.model=own", "duration_s=0.5"]), "out", rerun=False)
    monkeypatch.chdir("/")
    again = load_scenario(tmp_path / "out" / "scenario.toml")
    assert again.aircraft.model == str(own)
    assert run(again).trace["q_deg_s"][-1] == read_trace(tmp_path / "out" / "trace.parquet")["q_deg_s"][-1]
    text = (own / "aircraft.toml").read_text()
    (own / "aircraft.toml").write_text(text.replace("rate_limit_deg_s = 60.0", "rate_limit_deg_s = 50.0"))
    with pytest.raises(AircraftError, match=r"is not the aircraft of this scenario"):
        run(again)
    assert run(load_scenario(tmp_path / "out" / "scenario.toml", ['aircraft.sha256=""'])).summary.ended == "time"


def test_public_names_are_functions_whatever_was_imported_first() -> None:
    """`trim`, `linearize` and `short_period` are also modules: the package must give the functions."""
    code = (
        "import flightbed.models.trim, flightbed.models.linearize, flightbed.avionics.short_period, flightbed.runs.run, flightbed\n"
        "assert all(callable(getattr(flightbed, n)) for n in ('load_scenario run trim linearize short_period fly').split())\n"
        "assert all(hasattr(flightbed, n) for n in flightbed.__all__)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
