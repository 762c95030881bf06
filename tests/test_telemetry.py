"""The recording: verified by Rerun's own tool, and read back equal to the trace."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from rerun.chunk import RrdReader

from flightbed import mesh
from flightbed.mission import Result, run
from flightbed.scenario import load_scenario
from flightbed.telemetry import _quaternions
from flightbed.units import DEG, FT

SCALARS = {
    "/pitch_rate/reference": "q_ref_deg_s",
    "/pitch_rate/actual": "q_deg_s",
    "/alpha/actual": "alpha_deg",
    "/elevator/command": "elevator_cmd_deg",
    "/elevator/position": "elevator_deg",
    "/mach/actual": "mach",
    "/altitude/actual": "altitude_ft",
    "/effectiveness/true": "effectiveness_true",
    "/effectiveness/scheduled_smoothed": "scheduled.effectiveness_smoothed",
    "/effectiveness/expanding_smoothed": "expanding.effectiveness_smoothed",
}


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Result:
    return run(load_scenario("elevator-loss"), tmp_path_factory.mktemp("runs") / "run")


def _recording(result: Result) -> Path:
    assert result.folder is not None
    return result.folder / "flight.rrd"


def _series(path: Path, entity: str, component: str) -> tuple[np.ndarray, np.ndarray]:
    times, values = [], []
    for chunk in RrdReader(path).stream():
        if chunk.entity_path == entity and not chunk.is_static:
            batch = chunk.to_record_batch()
            if component in batch.schema.names:
                times.append(batch.column("time").to_numpy(zero_copy_only=False).astype("int64") * 1e-9)
                values.append(batch.column(component).flatten().to_numpy(zero_copy_only=False))
    return np.concatenate(times), np.concatenate(values)


def _rerun(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-m", "rerun", *arguments], capture_output=True, text=True, check=False)


def test_the_recording_passes_reruns_own_verification(flown: Result) -> None:
    done = _rerun("rrd", "verify", str(_recording(flown)))
    assert done.returncode == 0, done.stdout + done.stderr
    assert _recording(flown).stat().st_size < 1.5e6


@pytest.mark.parametrize(("entity", "column"), SCALARS.items())
def test_every_line_reads_back_equal_to_the_trace(flown: Result, entity: str, column: str) -> None:
    times, values = _series(_recording(flown), entity, "Scalars:scalars")
    np.testing.assert_allclose(times, flown.trace["t_s"], atol=1e-9)
    np.testing.assert_array_equal(values, flown.trace[column])


@pytest.mark.parametrize("name", ["scheduled", "expanding"])
def test_the_band_is_two_sigma(flown: Result, name: str) -> None:
    _, values = _series(_recording(flown), f"/effectiveness/{name}", "Measurements:values")
    _, variances = _series(_recording(flown), f"/effectiveness/{name}", "Measurements:variances")
    np.testing.assert_array_equal(values, flown.trace[f"{name}.effectiveness"])
    np.testing.assert_allclose(np.sqrt(variances), 2.0 * flown.trace[f"{name}.effectiveness_std"], rtol=1e-12)


def test_the_aircraft_moves_as_flown(flown: Result) -> None:
    _, flat = _series(_recording(flown), "/world/cg", "Transform3D:translation")
    position = np.vstack(flat) if flat.dtype == object else flat.reshape(-1, 3)
    climbed = (flown.trace["altitude_ft"][-1] - flown.trace["altitude_ft"][0]) * FT
    assert -position[-1, 2] == pytest.approx(climbed, abs=0.01)
    assert np.hypot(*position[-1, :2]) == pytest.approx(250.0 * 16.5, rel=0.05)


def test_the_failure_is_marked_in_every_plot_and_told_in_the_log(flown: Result) -> None:
    for plot in ("pitch_rate", "alpha", "elevator", "mach", "altitude", "effectiveness"):
        times, _ = _series(_recording(flown), f"/{plot}/failure", "Scalars:scalars")
        assert times == pytest.approx([4.5])
    times, texts = _series(_recording(flown), "/events", "TextLog:text")
    assert "FAILURE: the elevator keeps 20% of its effect" in list(texts)
    assert times[list(texts).index("FAILURE: the elevator keeps 20% of its effect")] == pytest.approx(4.5)
    times, states = _series(_recording(flown), "/mode/elevator", "StateChange:state")
    assert list(zip(times, states, strict=True)) == [(0.0, "healthy"), (4.5, "failed")]


def test_the_mode_is_that_of_the_elevator(tmp_path: Path) -> None:
    """A c.g. that moves at 0.5 s leaves it healthy until a failure of its own."""
    moved = ["failures.1.kind=cg-shift", "failures.1.at_s=0.5", "failures.1.shift_cbar=0.01", "failures.0.at_s=0.8"]
    result = run(load_scenario("elevator-loss", [*moved, "duration_s=1"]), tmp_path / "run")
    times, states = _series(_recording(result), "/mode/elevator", "StateChange:state")
    assert list(zip(times, states, strict=True)) == [(0.0, "healthy"), (0.8, "failed")]
    times, _ = _series(_recording(result), "/alpha/failure", "Scalars:scalars")
    assert times == pytest.approx([0.5])


def test_identical_flights_give_identical_recordings(flown: Result, tmp_path: Path) -> None:
    """But for the times, seconds and speed of the computer's own clock, which no recording holds."""
    again = run(load_scenario("elevator-loss"), tmp_path / "again")
    done = _rerun("rrd", "compare", "--unordered", str(_recording(flown)), str(_recording(again)))
    assert done.returncode == 0, done.stdout + done.stderr
    other = run(load_scenario("elevator-loss", ["seed=1"]), tmp_path / "other")
    assert _rerun("rrd", "compare", "--unordered", str(_recording(flown)), str(_recording(other))).returncode != 0


def test_quaternions_turn_body_axes_into_north_east_down() -> None:
    from scipy.spatial.transform import Rotation

    rng = np.random.default_rng(1)
    phi, theta, psi = rng.uniform(-1.4, 1.4, (3, 50))
    theirs = Rotation.from_euler("ZYX", np.column_stack([psi, theta, phi])).as_quat()
    ours = _quaternions(phi, theta, psi)
    np.testing.assert_allclose(ours * np.sign(ours[:, [3]]), theirs * np.sign(theirs[:, [3]]), atol=1e-12)
    nose = Rotation.from_quat(_quaternions(np.zeros(1), np.array([10 * DEG]), np.zeros(1))).apply([1.0, 0.0, 0.0])[0]
    assert nose[2] < 0  # nose up points up: down is positive


def test_the_stabilators_turn_with_the_elevator(flown: Result) -> None:
    """Trailing edge down for a positive deflection: the rear edge, aft of the hinge, moves down (+z)."""
    from scipy.spatial.transform import Rotation

    _, flat = _series(_recording(flown), "/world/cg/attitude/stabilators", "Transform3D:quaternion")
    turns = np.vstack(flat) if flat.dtype == object else flat.reshape(-1, 4)
    rear = mesh.stabilators().vertices[mesh.stabilators().vertices[:, 0].argmin()]
    down = Rotation.from_quat(turns).apply(rear)[:, 2]
    np.testing.assert_allclose(down, -rear[0] * np.sin(flown.trace["elevator_deg"] * DEG), atol=1e-5)
    assert down.max() > 0.1 > -0.1 > down.min()


def test_the_mesh_is_symmetric_and_its_faces_are_in_range() -> None:
    for shape in (mesh.airframe(), mesh.stabilators()):
        assert shape.faces.max() < len(shape.vertices) == len(shape.colors)
        y = np.sort(shape.vertices[:, 1])
        np.testing.assert_allclose(y, -y[::-1], atol=1e-5)
    assert 13.0 < np.ptp(mesh.airframe().vertices[:, 0]) < 17.0  # an F-16 is 15 m long
