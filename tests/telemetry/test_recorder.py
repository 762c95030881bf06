"""The recording: verified by Rerun's own tool, and equal to the trace when read back."""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest
from rerun.chunk import RrdReader

from flightbed.analysis.result import Result
from flightbed.core import data
from flightbed.core.errors import OutputError
from flightbed.core.signals import Sample
from flightbed.core.units import DEG, FT
from flightbed.flight.record import row_packer
from flightbed.runs.run import run
from flightbed.scenario.reading import Scenario, load_scenario
from flightbed.telemetry import mesh
from flightbed.telemetry.channels import with_room
from flightbed.telemetry.chase import quaternions
from flightbed.telemetry.flight_info import FlightInfo, result_info
from flightbed.telemetry.live import Live
from flightbed.telemetry.recording import write_recording
from tests.flights import ShippedFlight, representative
from tests.lateral_flight import rolling
from tests.telemetry.reading import rerun, series, static_text

# entity -> its lines, computed from the trace's columns independently of telemetry/channels.py
K = "effectiveness"
LINES = {
    "/pitch_rate": ["q_ref_deg_s", "q_deg_s"],
    "/alpha": ["alpha_deg"],
    "/elevator": ["elevator_cmd_deg", "elevator_deg", -25.0, 25.0],
    "/effectiveness": [f"{K}_true", f"scheduled.{K}_smoothed", f"expanding.{K}_smoothed", "effectiveness_stable_min"],
    "/sigma": [f"log10 {K}_bound", f"log10 scheduled.{K}_std", f"log10 expanding.{K}_std"],
    "/nis/scheduled": ["scheduled.nis", 5.991464547107979],
    "/nis/expanding": ["expanding.nis", 5.991464547107979],
    "/excitation": ["excitation_deg_s2"],
    "/mach": ["mach"],
    "/altitude": ["altitude_ft"],
    "/load_factor": ["nz_g"],
    "/attitude": ["theta_deg", "phi_deg"],
    "/forces": ["lift_n", "drag_n", "thrust_n"],
}
# The same for a flight with roll and yaw, with the estimators "surfaces" (all three surfaces) and "pitch".
ROLL_YAW = {
    **{entity: lines for entity, lines in LINES.items() if "/nis/" not in entity},
    "/effectiveness": [f"{K}_true", f"surfaces.{K}_smoothed", f"pitch.{K}_smoothed", "effectiveness_stable_min"],
    "/sigma": [f"log10 {K}_bound", f"log10 surfaces.{K}_std", f"log10 pitch.{K}_std"],
    "/nis/surfaces": ["surfaces.nis", 11.070497693516351],  # five readings
    "/nis/pitch": ["pitch.nis", 5.991464547107979],
    "/roll_rate": ["p_ref_deg_s", "p_deg_s"],
    "/bank": ["phi_deg"],
    "/aileron": ["aileron_cmd_deg", "aileron_deg", -21.5, 21.5],
    "/effectiveness_aileron": [f"{K}_aileron_true", f"surfaces.aileron.{K}_smoothed"],
    "/sideslip": ["beta_ref_deg", "beta_deg"],
    "/rudder": ["rudder_cmd_deg", "rudder_deg", -30.0, 30.0],
    "/effectiveness_rudder": [f"{K}_rudder_true", f"surfaces.rudder.{K}_smoothed"],
}


@pytest.fixture(scope="module")
def turned(tmp_path_factory: pytest.TempPathFactory) -> Result:
    return run(rolling(), tmp_path_factory.mktemp("runs") / "rolling", report=False)


@pytest.fixture(scope="module")
def turning(turned: Result) -> Path:
    assert turned.folder is not None
    return turned.folder / "flight.rrd"


@pytest.mark.parametrize("entity", ROLL_YAW)
def test_every_line_of_roll_and_yaw_reads_back_equal_to_the_trace(turned: Result, turning: Path, entity: str) -> None:
    _assert_reads_back(turned, turning, entity, ROLL_YAW[entity])


@pytest.mark.parametrize("entity", LINES)
def test_every_line_reads_back_equal_to_the_trace(flown: Result, recording: Path, entity: str) -> None:
    _assert_reads_back(flown, recording, entity, LINES[entity])


def _assert_reads_back(flown: Result, recording: Path, entity: str, lines: list[str | float]) -> None:
    times, values = series(recording, entity, "Scalars:scalars")
    np.testing.assert_allclose(times, flown.trace["t_s"], atol=1e-9)
    for found, line in zip(values.reshape(len(times), -1).T, lines, strict=True):
        if isinstance(line, str) and line.startswith("log10 "):
            np.testing.assert_allclose(10.0**found, np.maximum(flown.trace[line[6:]], 1e-4), rtol=1e-12)
        elif isinstance(line, float):
            np.testing.assert_allclose(found, line, rtol=1e-9)
        else:
            np.testing.assert_array_equal(found, flown.trace[line])


@pytest.mark.parametrize("name", ["scheduled", "expanding"])
def test_innovations_are_shown_over_their_sigma(flown: Result, recording: Path, name: str) -> None:
    _, values = series(recording, f"/innovation/{name}", "Scalars:scalars")
    trace = flown.trace
    for i, (key, unit) in enumerate((("alpha", "deg"), ("q", "deg_s"))):
        ratio = trace[f"{name}.innovation_{key}_{unit}"][1:] / trace[f"{name}.innovation_{key}_std_{unit}"][1:]
        np.testing.assert_array_equal(values[1:, i], ratio)
        assert values[0, i] == 0.0  # the first readings have no prediction
    np.testing.assert_array_equal(values[:, 2:], np.tile([2.0, -2.0], (len(values), 1)))


def test_nothing_numeric_is_in_the_recording_that_is_not_compared_here(recording: Path) -> None:
    """Every new plot must be added to LINES."""
    entities = {
        c.entity_path for c in RrdReader(recording).stream() if "Scalars:scalars" in c.to_record_batch().schema.names
    }
    others = {entity for entity in entities if "/failure" not in entity and not entity.startswith("/innovation/")}
    assert others == set(LINES)


def test_nothing_numeric_of_roll_and_yaw_is_there_that_is_not_compared_here(turning: Path) -> None:
    entities = {
        c.entity_path for c in RrdReader(turning).stream() if "Scalars:scalars" in c.to_record_batch().schema.names
    }
    others = {entity for entity in entities if "/failure" not in entity and not entity.startswith("/innovation/")}
    assert others == set(ROLL_YAW)
    assert {e for e in entities if e.startswith("/innovation/")} >= {"/innovation/surfaces", "/innovation/pitch"}
    assert not any(
        "surfaces." in e for e in entities if e.startswith(("/innovation/", "/nis/"))
    )  # one filter, one innovation


def test_failures_of_all_surfaces_are_upright_in_all_plots_of_roll_and_yaw(turning: Path) -> None:
    for plot in ROLL_YAW:
        times, values = series(turning, f"{plot}/failure", "Scalars:scalars")
        np.testing.assert_allclose(times, [4.0, 4.0, 6.0, 6.0])
        assert values[0] < values[1] == values[2] > values[3], plot


@pytest.mark.parametrize(
    ("plot", "name"),
    [
        ("effectiveness", "surfaces"),
        ("effectiveness", "pitch"),
        ("effectiveness_aileron", "surfaces.aileron"),
        ("effectiveness_rudder", "surfaces.rudder"),
    ],
)
def test_bands_of_every_surface_are_two_sigma(turned: Result, turning: Path, plot: str, name: str) -> None:
    _, values = series(turning, f"/{plot}/{name}", "Measurements:values")
    _, variances = series(turning, f"/{plot}/{name}", "Measurements:variances")
    np.testing.assert_array_equal(values, turned.trace[f"{name}.effectiveness"])
    np.testing.assert_allclose(np.sqrt(variances), 2.0 * turned.trace[f"{name}.effectiveness_std"], rtol=1e-12)


def test_the_modes_are_those_of_each_surface(turned: Result, turning: Path) -> None:
    for surface, expected in (
        ("elevator", [(0.0, "healthy")]),
        ("aileron", [(0.0, "healthy"), (4.0, "failed")]),
        ("rudder", [(0.0, "healthy"), (6.0, "failed")]),
    ):
        times, states = series(turning, f"/mode/{surface}", "StateChange:state")
        assert list(zip(times, states, strict=True)) == expected
    for name in ("surfaces.aileron", "surfaces.rudder"):
        times, states = series(turning, f"/mode/detection_{name}", "StateChange:state")
        first = turned.trace["t_s"][np.argmax(turned.trace[f"{name}.alarms"] > 0.0)]
        assert list(states) == ["no change found", "change detected"]
        np.testing.assert_allclose(times, [0.0, first])


@pytest.mark.parametrize(
    ("keys", "surface"),
    [
        ("kind='stuck', surface='rudder'", "rudder"),
        ("kind='hardover', surface='aileron', side='low'", "aileron"),
        ("kind='rate-limit', surface='elevator', to=0.1", "elevator"),
        ("kind='bias', surface='aileron', bias_deg=2.0", "aileron"),
    ],
)
def test_a_surface_whose_actuator_fails_has_failed(keys: str, surface: str, tmp_path: Path) -> None:
    """K stays 1: the scenario has the information, the trace does not."""
    result = run(rolling([f"failures=[{{at_s=0.5, {keys}}}]", "duration_s=1"]), tmp_path / "run", report=False)
    assert np.all(result.trace["effectiveness_true"] == 1.0)
    for name in ("elevator", "aileron", "rudder"):
        times, states = series(tmp_path / "run" / "flight.rrd", f"/mode/{name}", "StateChange:state")
        after = [(0.5, "failed")] if name == surface else []
        assert list(zip(times, states, strict=True)) == [(0.0, "healthy"), *after], name


def test_saturation_is_reported_for_the_surface_that_saturates(tmp_path: Path) -> None:
    hard = ["failures=[]", "duration_s=2", "lateral.roll.amplitude_deg_s=300", "lateral.roll.filter_rad_s=0"]
    result = run(rolling(hard), tmp_path / "run", report=False)
    times, states = series(tmp_path / "run" / "flight.rrd", "/mode/saturation_aileron", "StateChange:state")
    inside = np.searchsorted(times, result.trace["t_s"] + 1e-9) - 1
    stopped = np.abs(result.trace["aileron_cmd_deg"]) >= 21.5 - 1e-6
    assert stopped.any()
    np.testing.assert_array_equal(np.array(states)[inside] == "saturated: stop", stopped)
    assert set(series(tmp_path / "run" / "flight.rrd", "/mode/saturation", "StateChange:state")[1]) == {"free"}


def test_ailerons_and_rudder_turn_with_their_surfaces_and_have_the_colour_of_their_k(
    turned: Result, turning: Path
) -> None:
    """Positive aileron: left trailing edge down, right one up. Positive rudder: trailing edge to the left."""
    from scipy.spatial.transform import Rotation

    below = "/world/cg/attitude"
    for entity, rear, axis, column, sense, at_s in (
        ("hinge_left/aileron", (-0.75, -2.0, 0.0), 2, "aileron_deg", 1.0, 4.0),
        ("hinge_right/aileron", (-0.75, 2.0, 0.0), 2, "aileron_deg", -1.0, 4.0),
        ("hinge_fin/rudder", (-1.0, 0.0, -2.0), 1, "rudder_deg", -1.0, 6.0),
    ):
        _, turns = series(turning, f"{below}/{entity}", "Transform3D:quaternion")
        moved = Rotation.from_quat(turns.reshape(-1, 4)).apply(rear)[:, axis]
        expected = -sense * rear[0] * np.sin(turned.trace[column] * DEG)
        np.testing.assert_allclose(moved, expected, atol=1e-5, err_msg=entity)
        assert np.ptp(moved) > 0.1
        times, colors = series(turning, f"{below}/{entity}", "Mesh3D:albedo_factor")
        np.testing.assert_allclose(times, [0.0, at_s])
        assert len(set(colors)) == 2


def test_a_flight_without_roll_and_yaw_has_nothing_of_them(recording: Path) -> None:
    entities = {c.entity_path for c in RrdReader(recording).stream()}
    assert not [
        e for e in entities if any(word in e for word in ("aileron", "rudder", "roll_rate", "sideslip", "bank"))
    ]


def test_the_bound_of_nis_is_that_of_the_readings_it_is_of(tmp_path: Path) -> None:
    from scipy.stats import chi2

    keys = ["duration_s=1", "failures.0.at_s=0.5", "estimators.1={name='rls', kind='differentiated-rls'}"]
    result = run(load_scenario("elevator-loss", keys), tmp_path / "run")
    assert result.summary.metrics.estimators["rls"].nis_expected == 1.0
    for name, readings in (("scheduled", 2), ("rls", 1)):
        _, values = series(tmp_path / "run" / "flight.rrd", f"/nis/{name}", "Scalars:scalars")
        np.testing.assert_allclose(values[:, 1], chi2.ppf(0.95, readings), rtol=1e-9)


def test_a_departure_is_a_mode(tmp_path: Path) -> None:
    result = run(load_scenario("elevator-loss-fixed"), tmp_path / "run")
    times, states = series(tmp_path / "run" / "flight.rrd", "/mode/elevator", "StateChange:state")
    assert list(states) == ["healthy", "failed", "departed", "departed"]
    assert times[2] == pytest.approx(result.summary.metrics.departed_at_s)


def test_a_recording_that_the_environment_forbids_is_refused(
    flown: Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RERUN", "off")
    with pytest.raises(OutputError, match=r"the environment variable RERUN disables recording \(got off\)"):
        write_recording(tmp_path / "flight.rrd", flown.trace, result_info(flown))


@pytest.mark.parametrize(
    ("low", "high", "expected"),
    [
        (-8.0, 8.5, (-10.8, 10.8)),
        (-4.7, 5.65, (-10.8, 10.8)),
        (0.765, 0.8, None),
        (-25.0, 25.0, None),
        (3.0, 3.0, None),
    ],
)
def test_an_axis_has_room_for_two_labels(flown: Result, low: float, high: float, expected: tuple | None) -> None:  # type: ignore[type-arg]
    trace = flown.trace.with_column("alpha_deg", np.linspace(low, high, len(flown.trace)))
    plot = next(p for p in result_info(flown).plots(trace) if p.key == "alpha")
    found = with_room(plot, trace).range
    assert found is None if expected is None else found == pytest.approx(expected)


@pytest.mark.parametrize("name", ["scheduled", "expanding"])
def test_the_band_is_two_sigma(flown: Result, recording: Path, name: str) -> None:
    _, values = series(recording, f"/effectiveness/{name}", "Measurements:values")
    _, variances = series(recording, f"/effectiveness/{name}", "Measurements:variances")
    np.testing.assert_array_equal(values, flown.trace[f"{name}.effectiveness"])
    np.testing.assert_allclose(np.sqrt(variances), 2.0 * flown.trace[f"{name}.effectiveness_std"], rtol=1e-12)


def test_the_recording_passes_reruns_own_verification_and_is_small(recording: Path) -> None:
    done = rerun("rrd", "verify", str(recording))
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize("name", representative(data.names("scenario")))
def test_recordings_of_all_scenarios_are_small(name: str, shipped_flight: ShippedFlight, tmp_path: Path) -> None:
    """At most 1.5 MB for 16.5 s, whatever flies; 2.7 MB with roll and yaw, which are half as much again; 0.2 MB for each reconstruction."""
    long = load_scenario(name).duration_s > 16.5
    result = run(load_scenario(name, ["duration_s=16.5"])) if long else shipped_flight(name)
    write_recording(tmp_path / "flight.rrd", result.trace, result_info(result))
    limit = 1.5e6 if result.plan.lateral is None else 2.7e6
    limit += 0.2e6 * sum(f"{name}.reconstructed_deg" in result.trace.columns for name in result.trace.estimators)
    assert (tmp_path / "flight.rrd").stat().st_size <= limit


def test_a_recording_of_roll_and_yaw_is_in_proportion(turned: Result, turning: Path) -> None:
    assert turning.stat().st_size <= 2.7e6 * len(turned.trace) / 1650


def test_the_aircraft_moves_as_flown(flown: Result, recording: Path) -> None:
    _, position = series(recording, "/world/cg", "Transform3D:translation")
    position = position.reshape(len(flown.trace), 3)
    climbed = (flown.trace["altitude_ft"] - flown.trace["altitude_ft"][0]) * FT
    expected = np.column_stack([flown.trace["north_m"], flown.trace["east_m"], -climbed]).astype(np.float32)
    np.testing.assert_array_equal(position, expected)
    assert np.hypot(*position[-1, :2]) == pytest.approx(250.0 * 16.5, rel=0.05)


def test_the_trail_is_the_flight_path(recording: Path) -> None:
    _, position = series(recording, "/world/cg", "Transform3D:translation")
    position = position.reshape(-1, 3)
    ends, pieces = [], []
    for chunk in RrdReader(recording).stream():
        batch = chunk.to_record_batch()
        if chunk.entity_path == "/world/trail" and "LineStrips3D:strips" in batch.schema.names:
            ends += list(batch.column("time").to_numpy(zero_copy_only=False).astype("int64") * 1e-9)
            pieces += [np.array(row[0]) for row in batch.column("LineStrips3D:strips").to_pylist()]
    for before, after in itertools.pairwise(pieces):
        np.testing.assert_array_equal(before[-1], after[0])  # no gaps
    np.testing.assert_array_equal(np.vstack([pieces[0], *(p[1:] for p in pieces[1:])]), position)
    assert ends[-1] == pytest.approx(16.49)


def test_the_failure_is_marked_in_every_plot_and_logged(recording: Path) -> None:
    entities = {c.entity_path for c in RrdReader(recording).stream()}
    for plot in [*LINES, "/innovation/scheduled", "/innovation/expanding"]:
        assert f"{plot}/failure" in entities, plot
        times, values = series(recording, f"{plot}/failure", "Scalars:scalars")
        np.testing.assert_allclose(times, [4.5, 4.5])
        assert values[0] < values[1], plot  # vertical and of finite length
    times, texts = series(recording, "/events", "TextLog:text")
    assert "FAILURE: the elevator effectiveness steps to 20%" in list(texts)
    assert times[list(texts).index("FAILURE: the elevator effectiveness steps to 20%")] == pytest.approx(4.5)


def test_time_starts_at_zero_and_nothing_has_a_wall_clock(recording: Path) -> None:
    first = np.inf
    for chunk in RrdReader(recording).stream():
        if not chunk.is_static:
            names = set(chunk.to_record_batch().schema.names)
            assert not {"log_time", "log_tick"} & names
            first = min(first, chunk.to_record_batch().column("time").to_numpy(zero_copy_only=False).astype("int64")[0])
    assert first == 0


def test_the_state_lanes_are_logged(flown: Result, recording: Path) -> None:
    times, states = series(recording, "/mode/elevator", "StateChange:state")
    assert list(zip(times, states, strict=True)) == [(0.0, "healthy"), (4.5, "failed")]
    times, states = series(recording, "/mode/detection_scheduled", "StateChange:state")
    detected = 4.5 + flown.summary.metrics.estimators["scheduled"].detected_at_s
    assert list(states) == ["no change found", "change detected"]
    np.testing.assert_allclose(times, [0.0, detected])
    times, states = series(recording, "/mode/saturation", "StateChange:state")
    assert {"free", "saturated: stop", "saturated: rate"} == set(states)
    inside = np.searchsorted(times, flown.trace["t_s"] + 1e-9) - 1
    stopped = np.abs(flown.trace["elevator_cmd_deg"]) >= 25.0 - 1e-6
    np.testing.assert_array_equal(np.array(states)[inside] == "saturated: stop", stopped)
    rate = np.abs(np.diff(flown.trace["elevator_deg"], prepend=flown.trace["elevator_deg"][0])) * 100
    np.testing.assert_array_equal(np.array(states)[inside] == "saturated: rate", ~stopped & (rate >= 0.99 * 60.0))


def test_the_mode_is_that_of_the_elevator(tmp_path: Path) -> None:
    """After a c.g. shift at 0.5 s the elevator stays healthy until its own failure; both are marked."""
    moved = ["failures.1.kind=cg-shift", "failures.1.at_s=0.5", "failures.1.shift_cbar=0.01", "failures.0.at_s=0.8"]
    result = run(load_scenario("elevator-loss", [*moved, "duration_s=1"]), tmp_path / "run")
    assert result.folder is not None
    path = result.folder / "flight.rrd"
    times, states = series(path, "/mode/elevator", "StateChange:state")
    assert list(zip(times, states, strict=True)) == [(0.0, "healthy"), (0.8, "failed")]
    times, states = series(path, "/mode/airframe", "StateChange:state")
    assert list(zip(times, states, strict=True)) == [(0.0, "as built"), (0.5, "c.g. moved")]
    times, values = series(path, "/alpha/failure", "Scalars:scalars")
    np.testing.assert_allclose(times, np.repeat([0.5, 0.8], 2))
    assert values[0] < values[1] == values[2] > values[3]  # up, along the edge, down


def test_the_stabilators_have_the_colour_of_k(recording: Path) -> None:
    times, colors = series(recording, "/world/cg/attitude/hinge/stabilators", "Mesh3D:albedo_factor")
    np.testing.assert_allclose(times, [0.0, 4.5])
    healthy, weak = (((int(c) >> 24) & 255, (int(c) >> 8) & 255) for c in colors)  # red, blue
    assert healthy[1] > healthy[0]
    assert weak[0] > weak[1]


def test_names_carry_units(recording: Path) -> None:
    for plot in LINES:
        for label in static_text(recording, plot, "SeriesLines:names"):
            assert ", " in label or plot in ("/effectiveness", "/sigma", "/mach") or "nis" in plot, label


def test_identical_flights_give_identical_recordings(recording: Path, tmp_path: Path) -> None:
    """The recordings contain no times of the computer's clock."""
    again = run(load_scenario("elevator-loss"), tmp_path / "again")
    assert again.folder is not None
    done = rerun("rrd", "compare", "--unordered", str(recording), str(again.folder / "flight.rrd"))
    assert done.returncode == 0, done.stdout + done.stderr
    other = run(load_scenario("elevator-loss", ["seed=1"]), tmp_path / "other")
    assert other.folder is not None
    different = rerun("rrd", "compare", "--unordered", str(recording), str(other.folder / "flight.rrd"))
    assert different.returncode != 0


class _Heard(Live):
    """Collects the data that a flight sends to the viewer."""

    def __init__(self) -> None:
        super().__init__()
        self.infos: list[str] = []
        self.rows: list[bytes] = []

    def start(self, info: FlightInfo) -> None:
        self.infos.append(info.to_json())

    def forward(self, samples: Iterable[Sample]) -> Iterator[Sample]:
        for sample in samples:
            self.rows.append(row_packer(len(sample.estimates), lateral=sample.lateral is not None)(sample))
            yield sample

    def finish(self, info: FlightInfo) -> None:
        self.infos.append(info.to_json())


@pytest.mark.parametrize("name", ["elevator-loss", "elevator-loss-fixed"])
def test_pieces_say_the_same_as_the_whole(name: str, tmp_path: Path) -> None:
    """The streaming process logs, part by part, the same values, states and events as the file."""
    lanes = ("elevator", "saturation", "detection_scheduled")
    _assert_pieces_are_the_whole(load_scenario(name), [*LINES, "/innovation/scheduled"], lanes, tmp_path)


def test_pieces_of_roll_and_yaw_say_the_same_as_the_whole(tmp_path: Path) -> None:
    lanes = ("elevator", "aileron", "rudder", "saturation_aileron", "saturation_rudder", "detection_surfaces.aileron")
    moving = [f"/world/cg/attitude/{part}" for part in ("hinge_left/aileron", "hinge_fin/rudder", "hinge/stabilators")]
    _assert_pieces_are_the_whole(rolling(), [*ROLL_YAW, "/innovation/surfaces"], lanes, tmp_path)
    for entity in moving:
        ours, theirs = (
            series(tmp_path / p, entity, "Transform3D:quaternion")[1] for p in ("pieces.rrd", "run/flight.rrd")
        )
        np.testing.assert_array_equal(ours, theirs)


def _assert_pieces_are_the_whole(
    scenario: Scenario, entities: Sequence[str], lanes: Sequence[str], tmp_path: Path
) -> None:
    import rerun as rr

    from flightbed.telemetry.streamer import LiveRecording

    heard = _Heard()
    result = run(scenario, tmp_path / "run", live=heard, report=False)
    before, after = map(FlightInfo.from_json, heard.infos)
    stream = rr.RecordingStream("flightbed", recording_id="pieces")
    stream.save(tmp_path / "pieces.rrd")
    with stream:
        live = LiveRecording(before, stream)
        sizes = [1, 2, 7, 40, 400, 405, 900, len(heard.rows)]
        for begin, end in zip([0, *sizes], sizes, strict=False):
            live.add(b"".join(heard.rows[begin:end]))
        live.finish(after)
        stream.flush()
    stream.disconnect()
    assert result.folder is not None
    pieces, whole = tmp_path / "pieces.rrd", result.folder / "flight.rrd"
    for entity in entities:
        times, values = series(pieces, entity, "Scalars:scalars")
        wanted, theirs = series(whole, entity, "Scalars:scalars")
        np.testing.assert_array_equal(times, wanted)
        if entity == "/sigma":
            theirs = theirs[:, 1:]  # the bound is computed after the flight
        elif entity == "/effectiveness":
            theirs = theirs[:, :-1]  # likewise the lower stability limit of K
        # The running sums of the excitation restart with every part.
        np.testing.assert_allclose(values, theirs, rtol=1e-9 if entity == "/excitation" else 0.0, atol=1e-9)
    ours, theirs = (set(series(p, "/events", "TextLog:text")[1]) for p in (pieces, whole))
    assert ours == theirs
    for lane in lanes:
        ours, theirs = (series(p, f"/mode/{lane}", "StateChange:state") for p in (pieces, whole))
        assert [list(o) for o in ours] == [list(t) for t in theirs]
    assert (
        static_text(pieces, "/run_card", "TextDocument:text")[-1]
        == static_text(whole, "/run_card", "TextDocument:text")[0]
    )


def test_a_ten_minute_flight_is_in_proportion(tmp_path: Path) -> None:
    """Writing takes one second; the limit is five for busy machines. benchmarks/viewer.py measures the time."""
    overrides = ["duration_s=600", "command.count=1000", "failures.0.at_s=300", "failures.0.to=0.9"]
    result = run(load_scenario("elevator-loss", overrides))
    assert len(result.trace) == 60_000
    began = time.perf_counter()
    write_recording(tmp_path / "long.rrd", result.trace, result_info(result))
    assert time.perf_counter() - began < 5.0
    assert (tmp_path / "long.rrd").stat().st_size < 60_000 / 1_650 * 1.5e6


def test_quaternions_turn_body_axes_into_north_east_down() -> None:
    from scipy.spatial.transform import Rotation

    rng = np.random.default_rng(1)
    phi, theta, psi = rng.uniform(-1.4, 1.4, (3, 50))
    theirs = Rotation.from_euler("ZYX", np.column_stack([psi, theta, phi])).as_quat()
    ours = quaternions(phi, theta, psi)
    np.testing.assert_allclose(ours * np.sign(ours[:, [3]]), theirs * np.sign(theirs[:, [3]]), atol=1e-12)
    nose = Rotation.from_quat(quaternions(np.zeros(1), np.array([10 * DEG]), np.zeros(1))).apply([1.0, 0.0, 0.0])[0]
    assert nose[2] < 0  # nose up; down is positive


def test_the_stabilators_turn_with_the_elevator(flown: Result, recording: Path) -> None:
    """Trailing edge down for a positive deflection: the rear edge, aft of the hinge, moves down (+z)."""
    from scipy.spatial.transform import Rotation

    _, turns = series(recording, "/world/cg/attitude/hinge/stabilators", "Transform3D:quaternion")
    turns = turns.reshape(-1, 4)
    rear = mesh.stabilators().vertices[mesh.stabilators().vertices[:, 0].argmin()]
    down = Rotation.from_quat(turns).apply(rear)[:, 2]
    np.testing.assert_allclose(down, -rear[0] * np.sin(flown.trace["elevator_deg"] * DEG), atol=1e-5)
    assert down.max() > 0.1 > -0.1 > down.min()


def test_the_mesh_is_symmetric_and_its_faces_are_in_range() -> None:
    both = mesh.aileron(-1.0).vertices, mesh.aileron(1.0).vertices
    np.testing.assert_allclose(both[0] * [1.0, -1.0, 1.0], both[1])
    assert len(mesh.airframe(rudder=False).vertices) < len(mesh.airframe().vertices)
    for shape in (mesh.airframe(), mesh.airframe(rudder=False), mesh.stabilators(), mesh.rudder()):
        assert shape.faces.max() < len(shape.vertices) == len(shape.colors)
        y = np.sort(shape.vertices[:, 1])
        np.testing.assert_allclose(y, -y[::-1], atol=1e-5)
    assert 14.0 < np.ptp(mesh.airframe().vertices[:, 0]) < 17.0  # an F-16 is 15 m long
    assert 9.0 < np.ptp(mesh.airframe().vertices[:, 1]) < 10.5  # and 9.5 m wide


def test_a_reconstructed_input_is_plotted_with_its_truth(tmp_path: Path) -> None:
    elevator = ["elevator_acting_deg", "elevator_mean_meas_deg"]
    for scenario, beside in (("elevator-bias", elevator), ("harmonic-gust", ["gust_alpha_deg"])):
        flown = run(load_scenario(scenario, ["duration_s=7"]), tmp_path / scenario, report=False)
        assert flown.folder is not None
        for name in ("retrospective", "random-walk"):
            lines: list[str | float] = [*beside, f"{name}.reconstructed_deg"]
            _assert_reads_back(flown, flown.folder / "flight.rrd", f"/reconstruction/{name}", lines)
        entities = {c.entity_path for c in RrdReader(flown.folder / "flight.rrd").stream()}
        assert "/reconstruction/scheduled" not in entities
