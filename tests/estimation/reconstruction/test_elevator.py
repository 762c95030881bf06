"""The elevator's acting deflection on the aircraft: accuracy, K from it, and deviations that no K explains."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from flightbed.analysis.trace import Trace, collect, read_trace
from flightbed.avionics.onboard import OnBoard
from flightbed.core.actuator import Actuator, ActuatorOnBoard
from flightbed.core.errors import ScenarioError
from flightbed.core.signals import Measurement
from flightbed.core.units import DEG
from flightbed.estimation.reconstruction.elevator import ElevatorReconstruction, ReconstructionConfig
from flightbed.estimation.reconstruction.methods import WalkSettings
from flightbed.estimation.reconstruction.regression_kernels import ACTUATOR, OFFSET, STAGGERED
from flightbed.flight.assembly import assemble, sensor_noise
from flightbed.flight.loop import fly
from flightbed.flight.plan import plan
from flightbed.runs.run import run
from flightbed.scenario.reading import load_scenario
from flightbed.scenario.tables import Scenario
from tests.lateral_flight import rolling

NAMES = ("retrospective", "random-walk")
KINDS = dict(zip(NAMES, ("retrospective-cost", "input-kalman"), strict=True))
BOTH = [f'estimators.{1 + i}={{name="{name}", kind="{kind}"}}' for i, (name, kind) in enumerate(KINDS.items())]


@cache
def _flown(name: str, *settings: str) -> Trace:
    """Fly a scenario with both reconstructions; each flight once."""
    added = () if "retrospective" in {e.name for e in load_scenario(name).estimators} else BOTH
    return run(load_scenario(name, [*added, *settings])).trace


def _error(trace: Trace, name: str) -> np.ndarray:
    """Reconstructed minus acting deflection, mean of the period that ended at a tick, deg."""
    return np.asarray(trace[f"{name}.reconstructed_deg"] - trace["elevator_acting_deg"])


def _first(trace: Trace, name: str) -> tuple[float, float]:
    """Time of the first verdict, s (infinite without one), and its value."""
    raised = np.flatnonzero(trace[f"{name}.verdict"] > 0.0)
    return (
        (float(trace["t_s"][raised[0]]), float(trace[f"{name}.verdict"][raised[0]])) if raised.size else (np.inf, 0.0)
    )


@pytest.mark.parametrize("seed", range(3))
def test_the_deflection_that_acts_is_found_and_k_with_it(seed: int) -> None:
    trace = _flown("elevator-loss", f"seed={seed}")
    late = trace["t_s"] > 5.0
    truth, scheduled = trace["effectiveness_true"], trace["scheduled.effectiveness"]
    for name, rms_deg in zip(NAMES, (0.35, 0.26), strict=True):
        error = _error(trace, name)[100:]
        assert np.sqrt(np.mean(error**2)) < rms_deg  # the acting deflection moves by 1.3 deg RMS
        assert np.all(np.abs(trace[f"{name}.reconstructed_deg"]) < 30.0)
        off = np.median(np.abs(trace[f"{name}.effectiveness"] - truth)[late])
        assert off < 0.006
        assert off < 2.0 * np.median(np.abs(scheduled - truth)[late])
        assert trace[f"{name}.alarms"][-1] == 0.0  # K explains it all


@cache
def _readings(name: str, *settings: str) -> list[tuple[Measurement, float]]:
    """Fly a scenario as it stands, without the reconstructions, and return its readings and commands; each flight once."""
    return [(s.measurement, s.elevator_cmd_rad) for s in fly(assemble(plan(load_scenario(name, settings))))]


def _new(scenario: Scenario, name: str) -> ElevatorReconstruction:
    index = [e.name for e in scenario.estimators].index(name)
    estimator = assemble(plan(scenario)).estimators[index]
    assert isinstance(estimator, ElevatorReconstruction)
    return estimator


@pytest.mark.parametrize("name", NAMES)
def test_neither_position_nor_command_nor_k_enter_the_reconstruction(name: str) -> None:
    """With a constant elevator reading, the reconstruction is bit-identical; K differs."""
    short = "duration_s=6"
    scenario = load_scenario("elevator-loss", [*BOTH, short])
    estimator, blind = _new(scenario, name), _new(scenario, name)
    last = []
    for measurement, command in _readings("elevator-loss", short):
        hidden = measurement._replace(elevator_rad=0.05, elevator_mean_rad=0.05)
        one, other = estimator.update(measurement), blind.update(hidden)
        estimator.commanded(command)  # type: ignore[attr-defined]
        assert one.reconstructed_rad == other.reconstructed_rad
        last = [one, other]
    assert abs(last[0].effectiveness_raw - last[1].effectiveness_raw) > 0.1


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(
    ("scenario", "verdict", "within_s", "error_deg"),
    [
        ("elevator-stuck", ACTUATOR, (1.5, 1.5), (0.4, 0.2)),
        ("elevator-floating", OFFSET, (1.5, 0.6), (1.5, 1.0)),  # while floating out at 90 deg/s
        ("elevator-bias", OFFSET, (2.5, 2.5), (0.5, 0.4)),
    ],
)
def test_a_deviation_that_no_k_explains_is_recognised(
    scenario: str, verdict: float, within_s: tuple[float, float], error_deg: tuple[float, float], name: str
) -> None:
    trace = _flown(scenario)
    at_s, offset_signs = _first(trace, name)
    assert 5.2 < at_s <= 5.2 + within_s[NAMES.index(name)]
    assert offset_signs == verdict
    after = trace["t_s"] > at_s
    allowed, acts = error_deg[NAMES.index(name)], trace["elevator_acting_deg"]
    assert np.sqrt(np.mean(_error(trace, name)[after] ** 2)) < allowed
    assert np.sqrt(np.mean((acts - acts[100])[after] ** 2)) > allowed  # error of a constant reconstruction from 1 s
    if scenario == "elevator-bias":
        assert trace[f"{name}.offset_deg"][-1] == pytest.approx(1.0, abs=0.5)
        # A filter of K alone estimates half the effectiveness; with the offset K is correct.
        assert trace["scheduled.effectiveness"][-1] < 0.7
        assert trace[f"{name}.effectiveness"][-1] > 0.9


@pytest.mark.parametrize("name", NAMES)
def test_a_hardover_is_recognised_before_the_aircraft_is_lost(name: str) -> None:
    trace = _flown("elevator-hardover", "duration_s=7")
    at_s, offset_signs = _first(trace, name)
    assert 5.2 < at_s < trace["t_s"][-1] < 6.2
    assert offset_signs == ACTUATOR


@pytest.mark.parametrize("seeds", [1, pytest.param(3, marks=pytest.mark.long)])
@pytest.mark.parametrize(
    "settings",
    [
        ["failures=[]"],
        ["failures=[]", "command.kind=none"],
        ["failures=[]", "atmosphere.turbulence=moderate"],
        ["failures=[]", "rates.delay_ticks=3"],
        ["failures=[]", "sensors.elevator_std_deg=0.1"],
        ["failures=[{kind='ramp', at_s=4.5, to=0.3, over_s=2.0}]"],
    ],
    ids=["calm", "level", "turbulence", "delay", "noisy position", "ramp"],
)
def test_nothing_is_declared_where_k_explains_all(settings: list[str], seeds: int) -> None:
    level = "command.kind=none" in settings  # the elevator answers to little but noise
    for seed in range(3 * seeds + 1 if level else seeds):
        trace = _flown("elevator-loss", *settings, f"seed={seed}")
        assert len(trace) == 1650
        for name in NAMES:
            assert trace[f"{name}.alarms"][-1] == 0.0, (name, seed)


@pytest.mark.parametrize("seeds", [2, pytest.param(5, marks=pytest.mark.long)])
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(("command", "least"), [("doublet", 0.14), ("none", 0.5)])
def test_in_a_closed_loop_the_threshold_alone_does_not_hold(name: str, command: str, least: float, seeds: int) -> None:
    """A tenth of the windows should exceed it on each side; the law responds to the noise, and o is biased. Hence the tolerance."""
    loose = [
        f"estimators.{i}.{key}"
        for i in (1, 2)
        for key in ("offset_deg=1e-9", "false_alarm=0.02", "follow_disturbances=false")
    ]
    windows, above = 0, 0
    for seed in range(seeds):
        flight = ("failures=[]", f"command.kind={command}", f"seed={seed}")
        estimator = _new(load_scenario("elevator-loss", [*BOTH, *flight, *loose]), name)
        for measurement, _ in _readings("elevator-loss", *flight):
            estimator.update(measurement)
            closed = estimator._memory.ages[1 : 1 + STAGGERED] == 0.0
            windows += int(closed.sum())
            above += int(np.sum(estimator._memory.offset_signs[1 : 1 + STAGGERED][closed] > 0.0))
    assert windows == 110 * seeds
    assert above > least * windows


@pytest.mark.parametrize("delay_ticks", [0, 2])
def test_the_actuator_on_board_is_the_limit_of_the_aircrafts(delay_ticks: int) -> None:
    """JSBSim's actuator advances by whole plant steps: twice the rate, half the difference of the mean position over a period."""
    off_deg = []
    for plant_hz in (100, 200, 400):
        settings = ["failures=[]", f"rates.plant_hz={plant_hz}", f"rates.delay_ticks={delay_ticks}", "duration_s=8"]
        planned = plan(load_scenario("elevator-loss", settings))
        actuator, apart = ActuatorOnBoard(planned.aircraft.actuator, 100, delay_ticks), []
        assert np.isnan(actuator.mean())  # before the first command
        for sample in fly(assemble(planned)):
            apart.append((actuator.mean() - sample.truth.elevator_mean_rad) / DEG)
            actuator.commanded(sample.elevator_cmd_rad)
        off_deg.append(np.sqrt(np.mean(np.square(apart[100:]))))
    assert off_deg[1] < 0.03
    assert off_deg[0] / off_deg[1] == pytest.approx(2.0, abs=0.3)
    assert off_deg[1] / off_deg[2] == pytest.approx(2.0, abs=0.3)


def test_the_actuator_on_board_turns_round_where_the_aircrafts_does() -> None:
    """After a loss to 0.1 the law commands ten times the elevator, oscillating at the rate limit."""
    planned = plan(load_scenario("marginal-authority", ["adaptation.oracle=true"]))
    actuator, apart, rates, last = ActuatorOnBoard(planned.aircraft.actuator, 100, 0), [], [], 0.0
    for sample in fly(assemble(planned)):
        apart.append((actuator.mean() - sample.truth.elevator_mean_rad) / DEG)
        actuator.commanded(sample.elevator_cmd_rad)
        rates.append(abs(sample.truth.elevator_rad - last) / DEG * 100.0)
        last = sample.truth.elevator_rad
    assert np.mean(np.array(rates[1:]) > 59.0) > 0.05
    assert np.max(np.abs(apart[1:])) < 0.35  # half a plant step at 60 deg/s is 0.15


def test_the_actuator_on_board_keeps_its_rate_and_its_stops() -> None:
    actuator, hz = Actuator(lag_rad_s=20.0, rate_limit_rad_s=1.0, min_rad=-0.3, max_rad=0.3), 100
    onboard = ActuatorOnBoard(actuator, hz, 0)
    onboard.commanded(0.0)
    onboard.mean()
    means = []
    for _ in range(100):
        onboard.commanded(5.0)
        means.append(onboard.mean())
    assert np.diff(means[:20]) == pytest.approx(1.0 / hz)  # at its rate
    assert means[0] == pytest.approx(0.5 / hz)
    assert means[-1] == pytest.approx(0.3, abs=1e-6)
    assert max(means) <= 0.3


def test_only_who_reconstructs_has_columns_for_it_and_they_survive_a_file(tmp_path: Path) -> None:
    trace = _flown("elevator-bias", "duration_s=6")
    own = {"reconstructed_deg", "reconstructed_std_deg", "offset_deg", "offset_std_deg", "verdict"}
    for name in ("scheduled", *NAMES):
        columns = {column.partition(".")[2] for column in trace.columns if column.startswith(f"{name}.")}
        assert (own <= columns) == (name in NAMES)
        assert (own & columns == set()) == (name not in NAMES)
    acting = trace["effectiveness_true"] * trace["elevator_mean_meas_deg"] + trace["elevator_offset_deg"]
    np.testing.assert_allclose(trace["elevator_acting_deg"], acting, atol=1e-12)  # the feedback has no noise here
    assert "elevator_acting_deg" not in run(load_scenario("level-loss", ["duration_s=5"])).trace.columns
    file = tmp_path / "trace.parquet"
    trace.write(file)
    again = read_trace(file)
    for column in trace.columns:
        np.testing.assert_array_equal(again[column], trace[column])


def test_reconstructions_do_not_disturb_other_estimators() -> None:
    scenario = load_scenario("elevator-bias", ["duration_s=3", "failures=[]"])
    names = [e.name for e in scenario.estimators]
    plain = collect(fly(assemble(plan(scenario))), estimators=names, control_hz=100)
    alone = run(load_scenario("elevator-bias", ["duration_s=3", "failures=[]", "estimators.1.unknown=gust"])).trace
    for column in (c for c in plain.columns if c.startswith("scheduled.")):
        np.testing.assert_array_equal(alone[column], plain[column], err_msg=column)


@pytest.mark.parametrize("name", NAMES)
def test_the_law_can_be_corrected_by_it(name: str) -> None:
    own = run(load_scenario("elevator-loss", [*BOTH, f"adaptation.estimator={name}"]))
    assert not own.summary.metrics.departed
    theirs = _flown("elevator-loss", "seed=0")
    late = theirs["t_s"] >= 4.8 - 1e-9
    found = own.summary.metrics.tracking_rms_post_deg_s
    best = np.sqrt(np.mean((theirs["q_deg_s"] - theirs["q_ref_deg_s"])[late] ** 2))
    assert found is not None
    assert found < 1.3 * best


@pytest.mark.parametrize("name", NAMES)
def test_it_flies_where_aileron_and_rudder_are_commanded(name: str) -> None:
    table = f'estimators=[{{name="{name}", kind="{KINDS[name]}"}}]'
    trace = run(rolling([table, "adaptation.enabled=false", "failures=[]", "duration_s=6"])).trace
    assert trace[f"{name}.alarms"][-1] == 0.0
    assert np.sqrt(np.mean(_error(trace, name)[100:] ** 2)) < 0.6


CALM = ("failures=[]", "duration_s=4")


@pytest.mark.parametrize("name", NAMES)
def test_readings_that_jump_put_it_to_the_readings(name: str) -> None:
    """After a spike of 1000 deg/s the estimator restarts and is accurate again within a second."""
    estimator, errors = _new(load_scenario("elevator-loss", [*BOTH, *CALM]), name), []
    for k, (measurement, _) in enumerate(_readings("elevator-loss", *CALM)):
        spike = measurement._replace(q_rad_s=2000.0) if k == 200 else measurement
        found = estimator.update(spike)
        assert np.all(np.isfinite(found))
        errors.append((found.reconstructed_rad - measurement.elevator_mean_rad) / DEG)
    assert np.sqrt(np.mean(np.square(errors[320:]))) < 0.5


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("field", ["alpha_rad", "elevator_mean_rad", "mach"])
def test_readings_that_are_not_finite_give_nan_and_the_estimate_recovers(name: str, field: str) -> None:
    estimator, errors, estimates = _new(load_scenario("elevator-loss", [*BOTH, *CALM]), name), [], []
    for k, (measurement, _) in enumerate(_readings("elevator-loss", *CALM)):
        estimates.append(estimator.update(measurement._replace(**{field: np.nan}) if 200 <= k < 205 else measurement))
        errors.append((estimates[-1].reconstructed_rad - measurement.elevator_mean_rad) / DEG)
    assert all(np.isnan(found.effectiveness_smoothed) for found in estimates[200:205])
    assert np.all(np.isfinite(estimates[205:]))
    assert estimates[205].effectiveness == pytest.approx(estimates[199].effectiveness, abs=0.05)  # K is not forgotten
    assert np.sqrt(np.mean(np.square(errors[320:]))) < 0.5


def test_a_missing_schedule_is_an_error() -> None:
    planned = plan(load_scenario("nominal", ["estimators=[]", "adaptation.enabled=false"]))
    assert planned.schedule is None
    settings = load_scenario("elevator-loss", BOTH).estimators[2]
    board = OnBoard(planned.design, sensor_noise(planned.scenario), 100)
    with pytest.raises(ValueError, match="the estimator's model is the schedule, but there is none on board"):
        settings.build(board)
    config = ReconstructionConfig(WalkSettings(), scheduled=False)
    found = ElevatorReconstruction(config, board).update(Measurement(0.01, 0.0, -0.02, -0.02))
    assert np.isfinite(found.reconstructed_rad)
    quiet = ElevatorReconstruction(config, replace(board, actuator=None))
    quiet.commanded(0.1)  # no actuator on board


ONE = 'estimators.0={name="one", kind="retrospective-cost"}'
WALK = 'estimators.0={name="one", kind="input-kalman"}'
GUST = 'estimators.0={name="one", kind="retrospective-cost", unknown="gust"}'


@pytest.mark.parametrize(
    ("overrides", "problem"),
    [
        ([ONE, "estimators.0.window=5"], "estimators.0.window: must be between 6 and 10000 (got 5)"),
        ([ONE, "estimators.0.input_step_deg=1"], "estimators.0.input_step_deg: 'retrospective-cost' has no such key ('input-kalman' has it); remove it"),
        ([ONE, "estimators.0.memory=window"], "estimators.0.memory: 'retrospective-cost' has no such key ('loop-gain', 'two-stage' have it); remove it"),
        ([ONE, "estimators.0.prior.state=fixed"], "estimators.0.prior.state: 'retrospective-cost' has no such key ('loop-gain' has it); remove it"),
        *(([WALK, f"estimators.0.{key}=1"], f"estimators.0.{key}: 'input-kalman' has no such key ('retrospective-cost' has it); remove it") for key in ("order", "horizon", "regularization", "initial_covariance", "input_forgetting", "saturation_deg")),
        *(([GUST, f"estimators.0.{key}=0.5"], f"estimators.0.{key}: has no effect with estimators.0.unknown = 'gust'") for key in ("forgetting", "smoothing", "false_alarm", "offset_deg", "alpha_disturbance_deg_s")),
        *(([f"estimators.0.{key}=1"], f"estimators.0.{key}: 'loop-gain' has no such key ('{only}' has it); remove it") for key, only in (("order", "retrospective-cost"), ("input_step_deg", "input-kalman"))),
        *(([f"estimators.0.{key}={value}"], f"estimators.0.{key}: 'loop-gain' has no such key ('input-kalman', 'retrospective-cost' have it); remove it") for key, value in (("offset_deg", 1), ("unknown", "gust"))),
        ([GUST, "adaptation.enabled=true", "adaptation.estimator=one"], "adaptation.estimator: must estimate the elevator's effectiveness (got 'one', which does not)"),
        (["gusts.0={at_s=1, up_fps=5}"], "gusts.0.rise_s: is missing"),
        (["gusts.0={at_s=1, up_fps=5, shape='sine'}"], "gusts.0.frequency_hz: is missing"),
        (["gusts.0={at_s=1, up_fps=5, shape='sine', frequency_hz=1}", "gusts.0.rise_s=1"], "gusts.0.rise_s: 'sine' has no such key ('1-cos' has it); remove it"),
        (["gusts.0={at_s=1, up_fps=5, shape='sine', frequency_hz=50}"],
         "gusts.0.frequency_hz: must be below half of rates.control_hz = 100, the Nyquist frequency (got 50)"),
        (["gusts.0={at_s=1, up_fps=5, rise_s=1}", "gusts.0.frequency_hz=1"], "gusts.0.frequency_hz: '1-cos' has no such key ('sine' has it); remove it"),
    ],
)  # fmt: skip
def test_keys_that_contradict_or_have_no_effect_are_refused(overrides: list[str], problem: str) -> None:
    fixed = [] if "adaptation.enabled=true" in overrides else ["adaptation.enabled=false"]
    with pytest.raises(ScenarioError) as caught:
        load_scenario("elevator-loss", [*fixed, *overrides])
    assert any(text.endswith(problem) for text in caught.value.problems), caught.value.problems


def test_its_keys_are_welcome_where_they_act() -> None:
    keys = {
        ONE: ("order", "horizon", "regularization", "initial_covariance", "saturation_deg", "window", "offset_deg", "false_alarm", "q_disturbance_deg_s2"),
        WALK: ("input_step_deg", "window", "forgetting", "smoothing", "offset_deg", "prior.effectiveness", "alpha_disturbance_deg_s"),
    }  # fmt: skip
    for table, own in keys.items():
        sets = [
            f"estimators.0.{key}={10 if key in ('order', 'horizon', 'window') else 0.4 if key == 'false_alarm' else 0.5}"
            for key in own
        ]
        sets = [text.replace("forgetting=0.5", "forgetting=0.9") for text in sets]
        idle = load_scenario("elevator-loss", ["adaptation.enabled=false", table, *sets]).idle_keys()
        assert not {f"estimators.0.{key}" for key in own} & set(idle)


def test_every_key_of_the_method_does_something() -> None:
    readings = _readings("elevator-bias", "duration_s=8")

    def final(table: str, *more: str) -> tuple[float, ...]:
        scenario = load_scenario("elevator-loss", ["adaptation.enabled=false", table, *more])
        estimator, offset_signs = assemble(plan(scenario)).estimators[0], []
        for measurement, _ in readings:
            offset_signs.append(estimator.update(measurement))
        return (
            *offset_signs[-1][:4],
            offset_signs[300].reconstructed_rad,
            offset_signs[-1].offset_rad,
            sum(e.verdict for e in offset_signs),
        )

    for table, sets in {
        ONE: ("order=2", "horizon=3", "regularization=3", "initial_covariance=0.1", "input_forgetting=0.99", "saturation_deg=2", "window=60",
              "forgetting=0.9", "smoothing=0.5", "bounds=[0.0, 0.7]", "offset_deg=3", "q_disturbance_deg_s2=3", "model=short-period",
              "prior.effectiveness_std=0.01", "follow_disturbances=false"),
        WALK: ("input_step_deg=0.02", "false_alarm=1e-300", "alpha_disturbance_deg_s=3", "prior.effectiveness=0.1"),
    }.items():  # fmt: skip
        plain = final(table)
        for text in sets:
            assert final(table, f"estimators.0.{text}") != plain, text
