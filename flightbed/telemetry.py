"""Trace -> Rerun recording with its layout. The only module that imports rerun."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import rerun as rr
import rerun.blueprint as rrb

from flightbed import mesh
from flightbed.errors import OutputError
from flightbed.trace import Trace
from flightbed.units import DEG, FT

APPLICATION = "flightbed"
TIMELINE = "time"
_TRAIL_TICKS = 10  # one piece of the trail

# The same colour for the same thing everywhere; from Okabe and Ito's palette, readable on light and dark.
_REFERENCE, _ACTUAL, _COMMAND, _TRUTH, _FAILURE = (
    [0, 158, 115],
    [86, 150, 220],
    [230, 159, 0],
    [204, 121, 167],
    [213, 94, 0],
)
_ESTIMATES = ([86, 150, 220], [230, 159, 0], [0, 158, 115], [150, 150, 150])

# view -> lines: (entity, label with unit, column, colour)
_PLOTS: dict[str, list[tuple[str, str, str, list[int]]]] = {
    "Pitch rate, deg/s": [
        ("pitch_rate/reference", "q reference, deg/s", "q_ref_deg_s", _REFERENCE),
        ("pitch_rate/actual", "q, deg/s", "q_deg_s", _ACTUAL),
    ],
    "Angle of attack, deg": [("alpha/actual", "alpha, deg", "alpha_deg", _ACTUAL)],
    "Elevator, deg": [
        ("elevator/command", "elevator command, deg", "elevator_cmd_deg", _COMMAND),
        ("elevator/position", "elevator, deg", "elevator_deg", _ACTUAL),
    ],
    "Mach": [("mach/actual", "Mach", "mach", _ACTUAL)],
    "Altitude, ft": [("altitude/actual", "altitude, ft", "altitude_ft", _ACTUAL)],
}


@dataclass(frozen=True)
class Event:
    """Something that happened at a time."""

    t_s: float
    text: str
    severe: bool = False


def write_recording(
    path: Path,
    trace: Trace,
    *,
    name: str,
    recording_id: str,
    card: str,
    events: Sequence[Event],
    failed_at_s: float | None,
) -> None:
    """Write a flight's recording, whole columns at a time, with its layout.

    Args:
        path: the .rrd file.
        trace: the flight.
        name: shown as the recording's name.
        recording_id: recordings with the same one merge in a viewer.
        card: the run card, Markdown.
        events: for the event log.
        failed_at_s: time of the first failure, marked in every plot.

    Raises:
        OutputError: the file cannot be written.

    """
    recording = rr.RecordingStream(APPLICATION, recording_id=recording_id)
    recording.set_log_time_enabled(False)
    try:
        recording.save(path, default_blueprint=_blueprint(trace))
    except Exception as error:
        raise OutputError(f"{path}: cannot be written: {error}") from None
    with recording:
        recording.send_recording_name(name)
        recording.log("run_card", rr.TextDocument(card, media_type=rr.MediaType.MARKDOWN), static=True)
        _lines(recording, trace, failed_at_s)
        _effectiveness(recording, trace, failed_at_s)
        _aircraft(recording, trace)
        _events(recording, trace, events)
        recording.flush()
    recording.disconnect()


def view(path: Path) -> int:
    """Open a recording in the viewer that comes with the SDK; returns the viewer's exit code."""
    return subprocess.run([sys.executable, "-m", "rerun", str(path)], check=False).returncode


def _time(t_s: npt.NDArray[np.float64]) -> list[Any]:
    return [rr.TimeColumn(TIMELINE, duration=t_s)]


def _line(recording: rr.RecordingStream, entity: str, label: str, color: list[int], trace: Trace, column: str) -> None:
    recording.log(entity, rr.SeriesLines(names=label, colors=color, widths=1.6), static=True)
    recording.send_columns(entity, indexes=_time(trace["t_s"]), columns=rr.Scalars.columns(scalars=trace[column]))


def _mark(recording: rr.RecordingStream, entity: str, trace: Trace, column: str, at_s: float | None) -> None:
    """Put a diamond on a line where the failure happens."""
    if at_s is None or at_s > trace["t_s"][-1]:
        return
    recording.log(
        entity, rr.SeriesPoints(names="failure", colors=_FAILURE, markers="Diamond", marker_sizes=7), static=True
    )
    at = np.searchsorted(trace["t_s"], at_s - 1e-9)
    recording.send_columns(
        entity, indexes=_time(trace["t_s"][[at]]), columns=rr.Scalars.columns(scalars=trace[column][[at]])
    )


def _lines(recording: rr.RecordingStream, trace: Trace, failed_at_s: float | None) -> None:
    for lines in _PLOTS.values():
        for entity, label, column, color in lines:
            _line(recording, entity, label, color, trace, column)
        entity, _, column, _ = lines[-1]
        _mark(recording, f"{entity.partition('/')[0]}/failure", trace, column, failed_at_s)


def _effectiveness(recording: rr.RecordingStream, trace: Trace, failed_at_s: float | None) -> None:
    for i, name in enumerate(trace.estimators):
        color, entity = _ESTIMATES[min(i, len(_ESTIMATES) - 1)], f"effectiveness/{name}"
        recording.log(
            entity, rr.Measurements.from_fields(names=f"K {name} +-2 sigma", colors=color, units="-"), static=True
        )
        # The band is drawn at one standard deviation of the given variance: four times the variance makes it two.
        variances = 4.0 * trace[f"{name}.effectiveness_std"] ** 2
        recording.send_columns(
            entity,
            indexes=_time(trace["t_s"]),
            columns=rr.Measurements.columns(values=trace[f"{name}.effectiveness"], variances=variances),
        )
        _line(recording, f"{entity}_smoothed", f"K {name}, smoothed", color, trace, f"{name}.effectiveness_smoothed")
        _line(recording, f"sigma/{name}", f"sigma of K {name}", color, trace, f"{name}.effectiveness_std")
    if "effectiveness_bound" in trace.columns:
        _line(recording, "sigma/bound", "Cramer-Rao bound of sigma", _TRUTH, trace, "effectiveness_bound")
    _line(recording, "effectiveness/true", "K true", _TRUTH, trace, "effectiveness_true")
    _mark(recording, "effectiveness/failure", trace, "effectiveness_true", failed_at_s)


def _aircraft(recording: rr.RecordingStream, trace: Trace) -> None:
    t = trace["t_s"]
    down = (trace["altitude_ft"][0] - trace["altitude_ft"]) * FT
    position = np.column_stack([trace["north_m"], trace["east_m"], down]).astype(np.float32)
    recording.log("world", rr.ViewCoordinates.FRD, static=True)
    recording.log("world/cg/attitude/airframe", _mesh(mesh.airframe()), static=True)
    recording.log("world/cg/attitude/stabilators", _mesh(mesh.stabilators()), static=True)
    recording.send_columns("world/cg", indexes=_time(t), columns=rr.Transform3D.columns(translation=position))
    recording.send_columns(
        "world/cg/attitude",
        indexes=_time(t),
        columns=rr.Transform3D.columns(
            quaternion=_quaternions(trace["phi_deg"] * DEG, trace["theta_deg"] * DEG, trace["psi_deg"] * DEG)
        ),
    )
    # Trailing edge down is a positive rotation about the y axis: what lies aft (-x) moves down (+z).
    half = 0.5 * trace["elevator_deg"] * DEG
    turn = np.column_stack([np.zeros_like(half), np.sin(half), np.zeros_like(half), np.cos(half)])
    recording.send_columns(
        "world/cg/attitude/stabilators",
        indexes=_time(t),
        columns=rr.Transform3D.columns(
            translation=np.tile(np.array(mesh.HINGE, dtype=np.float32), (len(t), 1)), quaternion=turn
        ),
    )
    starts = np.arange(0, len(t) - _TRAIL_TICKS, _TRAIL_TICKS)
    if starts.size:
        recording.log("world/trail", rr.LineStrips3D.from_fields(colors=_ACTUAL, radii=0.25), static=True)
        recording.send_columns(
            "world/trail",
            indexes=_time(t[starts + _TRAIL_TICKS]),
            columns=rr.LineStrips3D.columns(strips=[position[i : i + _TRAIL_TICKS + 1] for i in starts]),
        )


def _events(recording: rr.RecordingStream, trace: Trace, events: Sequence[Event]) -> None:
    recording.log(
        "mode/elevator",
        rr.StateConfiguration(values=["healthy", "failed"], colors=[0x009E73FF, 0xD55E00FF]),
        static=True,
    )
    recording.set_time(TIMELINE, duration=0.0)
    recording.log("mode/elevator", rr.StateChange(state="healthy"))
    hurt = np.flatnonzero((trace["effectiveness_true"] != 1.0) | (trace["elevator_force_true"] != 1.0))
    if hurt.size:
        recording.set_time(TIMELINE, duration=float(trace["t_s"][hurt[0]]))
        recording.log("mode/elevator", rr.StateChange(state="failed"))
    for event in events:
        recording.set_time(TIMELINE, duration=event.t_s)
        level = rr.TextLogLevel.ERROR if event.severe else rr.TextLogLevel.INFO
        recording.log("events", rr.TextLog(event.text, level=level))


def _mesh(shape: mesh.Mesh) -> rr.Mesh3D:
    return rr.Mesh3D(vertex_positions=shape.vertices, triangle_indices=shape.faces, vertex_colors=shape.colors)


def _quaternions(
    phi: npt.NDArray[np.float64], theta: npt.NDArray[np.float64], psi: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """Return (n, 4) quaternions xyzw of body to NED from yaw, pitch, roll; rad."""
    cr, sr, cp, sp, cy, sy = (f(a / 2.0) for a in (phi, theta, psi) for f in (np.cos, np.sin))
    return np.column_stack(
        [
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
            cr * cp * cy + sr * sp * sy,
        ]
    )


def _blueprint(trace: Trace) -> rrb.Blueprint:
    def plot(name: str, origin: str, axis: rrb.ScalarAxis | None = None) -> rrb.TimeSeriesView:
        return rrb.TimeSeriesView(
            name=name,
            origin=f"/{origin}",
            axis_x=rrb.TimeAxis(link="LinkToGlobal"),
            axis_y=axis,
            plot_legend=rrb.PlotLegend(rrb.Corner2D.RightTop),
            time_ranges=_all_time(rrb.TimeRangeBoundary.infinite()),
        )

    top = max([1.2, *(float(np.nanmax(trace[f"{n}.effectiveness_smoothed"])) + 0.1 for n in trace.estimators)])
    plots = {name: plot(name, lines[0][0].partition("/")[0]) for name, lines in _PLOTS.items()}
    gain = plot(
        "Elevator effectiveness K", "effectiveness", rrb.ScalarAxis(range=(-0.1, min(top, 2.0)), zoom_lock=True)
    )
    sigma = plot("Sigma of K", "sigma", rrb.ScalarAxis(range=(0.0, 0.3), zoom_lock=True))
    chase = rrb.Spatial3DView(
        name="Chase view",
        origin="/world/cg",
        contents="/world/**",
        background=[18, 22, 30],
        eye_controls=rrb.EyeControls3D(
            kind="Orbital", position=[-24, 16, -10], look_target=[0, 0, 0], eye_up=[0, 0, -1]
        ),
        line_grid=rrb.LineGrid3D(visible=False),
        time_ranges=_all_time(rrb.TimeRangeBoundary.cursor_relative()),
    )
    words = rrb.Tabs(
        rrb.TextDocumentView(name="Run card", origin="/run_card"), rrb.TextLogView(name="Events", origin="/events")
    )
    mode = rrb.StateTimelineView(name="Mode", origin="/mode", time_view=rrb.TimeAxis(link="LinkToGlobal"))
    air = rrb.Horizontal(plots["Mach"], plots["Altitude, ft"])
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(chase, mode, words, row_shares=[5, 1.2, 4]),
            rrb.Vertical(
                plots["Pitch rate, deg/s"],
                rrb.Tabs(gain, sigma),
                plots["Elevator, deg"],
                plots["Angle of attack, deg"],
                air,
            ),
            column_shares=[2, 3],
        ),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="paused"),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        auto_views=False,
        auto_layout=False,
    )


def _all_time(end: Any) -> rrb.VisibleTimeRange:
    return rrb.VisibleTimeRange(TIMELINE, start=rrb.TimeRangeBoundary.infinite(), end=end)
