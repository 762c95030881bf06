"""A flight, whole or piece by piece -> what Rerun is told of it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import rerun as rr

from flightbed import palette
from flightbed.telemetry import mesh
from flightbed.telemetry.channels import Plot
from flightbed.telemetry.layout import TIMELINE
from flightbed.telemetry.modes import lanes, states
from flightbed.telemetry.shown import Event, Shown
from flightbed.trace import Trace
from flightbed.units import DEG, FT

Vector = npt.NDArray[np.float64]
_TRAIL_TICKS = 10  # one piece of the trail
_STABILATORS = "world/cg/attitude/hinge/stabilators"


class Recorder:
    """Tells a stream of one flight, as columns.

    Args:
        stream: where to.
        shown: the flight.
        plots: what is plotted.
        root: put before every name; for several flights in one recording.

    """

    def __init__(self, stream: rr.RecordingStream, shown: Shown, plots: Sequence[Plot]) -> None:
        self._stream, self._shown, self._plots = stream, shown, plots
        self._lanes = [lane for lane in lanes(shown.detectors) if lane.key != "airframe" or shown.moves_cg]
        self._state = dict.fromkeys((lane.key for lane in self._lanes), -1)
        self._extent: dict[str, tuple[float, float]] = {}
        self._marked: dict[str, tuple[float, float]] = {}
        self._altitude_ft, self._last_position = 0.0, np.zeros((0, 3), dtype=np.float32)
        self._effectiveness = np.nan

    def begin(self) -> None:
        """Tell what does not change: names, colours, the aircraft's shape, the run card."""
        stream = self._stream
        stream.send_recording_name(self._shown.name)
        self.card(self._shown.card)
        for plot in self._plots:
            style = rr.SeriesLines(
                names=[line.label for line in plot.lines],
                colors=[palette.rgb(line.color) for line in plot.lines],
                widths=[line.width for line in plot.lines],
                aggregation_policy="MinMax",  # the mean of what falls on a pixel would hide how far noise goes
            )
            stream.log(plot.key, style, static=True)
            for i, name in enumerate(plot.bands):
                color = palette.rgb(palette.estimate(i))
                style = rr.Measurements.from_fields(names=f"K {name} +-2 sigma", colors=color, units="share")
                stream.log(f"{plot.key}/{name}", style, static=True)
            for t_s in self._shown.failures_s:
                style = rr.SeriesLines(
                    names=f"failure at {t_s:g} s",
                    colors=palette.rgb(palette.FAILURE),
                    widths=1.2,
                    aggregation_policy="Off",
                )
                stream.log(_failure(plot, t_s), style, static=True)
        for lane in self._lanes:
            colors = np.array([0xFF + (int(color[1:], 16) << 8) for color in lane.colors], dtype=np.uint32)
            stream.log(f"mode/{lane.key}", rr.StateConfiguration(values=list(lane.states), colors=colors), static=True)
        stream.log("world", rr.ViewCoordinates.FRD, static=True)
        stream.log("world/cg/attitude/airframe", _mesh(mesh.airframe()), static=True)
        stream.log("world/cg/attitude/hinge", rr.Transform3D(translation=mesh.HINGE), static=True)
        stream.log(_STABILATORS, _mesh(mesh.stabilators(), painted=False), static=True)
        style = rr.LineStrips3D.from_fields(colors=palette.rgb(palette.OTHER), radii=0.08)
        stream.log("world/trail", style, static=True)

    def card(self, text: str) -> None:
        """Tell the run card, in place of an earlier one."""
        self._stream.log("run_card", rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN), static=True)

    def events(self, events: Iterable[Event]) -> None:
        """Tell what happened."""
        for event in events:
            self._stream.set_time(TIMELINE, duration=event.t_s)
            level = rr.TextLogLevel.ERROR if event.severe else rr.TextLogLevel.INFO
            self._stream.log("events", rr.TextLog(event.text, level=level))

    def add(self, trace: Trace, new: int = 0) -> None:
        """Tell the ticks of a trace from index ``new`` on; those before have been told."""
        part = trace if new == 0 else trace.since(new)
        for plot in self._plots:
            self._lines(plot, part)
            self._mark(plot, part)
        self._modes(trace, new)
        self._aircraft(part)

    def _lines(self, plot: Plot, part: Trace) -> None:
        values = np.column_stack([line.values(part) for line in plot.lines])
        columns = rr.Scalars.columns(scalars=values.ravel()).partition([len(plot.lines)] * len(values))
        self._stream.send_columns(plot.key, indexes=_time(part["t_s"]), columns=columns)
        for name in plot.bands:
            # The band is drawn at one standard deviation of the given variance: four times the variance makes it two.
            variances = 4.0 * part[f"{name}.effectiveness_std"] ** 2
            self._stream.send_columns(
                f"{plot.key}/{name}",
                indexes=_time(part["t_s"]),
                columns=rr.Measurements.columns(values=part[f"{name}.effectiveness"], variances=variances),
            )
        low, high = self._extent.get(plot.key, (np.inf, -np.inf))
        finite = values[np.isfinite(values)]
        if finite.size:
            self._extent[plot.key] = min(low, float(finite.min())), max(high, float(finite.max()))

    def _mark(self, plot: Plot, part: Trace) -> None:
        """Draw a line from bottom to top where a failure begins, a longer one as soon as what is plotted has grown."""
        low, high = plot.range or self._extent.get(plot.key, (0.0, 0.0))
        for t_s in self._shown.failures_s:
            entity = _failure(plot, t_s)
            if part["t_s"][-1] < t_s - 1e-9 or self._marked.get(entity) == (low, high):
                continue
            self._marked[entity] = (low, high)
            self._stream.set_time(TIMELINE, duration=t_s)
            self._stream.log(entity, rr.Scalars([low]))
            self._stream.log(entity, rr.Scalars([high]))

    def _modes(self, trace: Trace, new: int) -> None:
        for lane in self._lanes:
            found = states(trace, lane, self._shown.actuator, control_hz=self._shown.control_hz)
            before = np.concatenate([[self._state[lane.key]], found[new:-1]])
            for i in np.flatnonzero(found[new:] != before):
                self._stream.set_time(TIMELINE, duration=float(trace["t_s"][new + i]))
                self._stream.log(f"mode/{lane.key}", rr.StateChange(state=lane.states[found[new + i]]))
            self._state[lane.key] = int(found[-1])

    def _aircraft(self, part: Trace) -> None:
        t, stream = part["t_s"], self._stream
        if not self._last_position.size:
            self._altitude_ft = float(part["altitude_ft"][0])
        down = (self._altitude_ft - part["altitude_ft"]) * FT
        position = np.column_stack([part["north_m"], part["east_m"], down]).astype(np.float32)
        stream.send_columns("world/cg", indexes=_time(t), columns=rr.Transform3D.columns(translation=position))
        attitude = quaternions(part["phi_deg"] * DEG, part["theta_deg"] * DEG, part["psi_deg"] * DEG)
        stream.send_columns(
            "world/cg/attitude", indexes=_time(t), columns=rr.Transform3D.columns(quaternion=attitude)
        )
        # Trailing edge down is a positive rotation about the y axis: what lies aft (-x) moves down (+z).
        half = 0.5 * part["elevator_deg"] * DEG
        turn = np.column_stack([np.zeros_like(half), np.sin(half), np.zeros_like(half), np.cos(half)])
        stream.send_columns(_STABILATORS, indexes=_time(t), columns=rr.Transform3D.columns(quaternion=turn))
        self._paint(part)
        self._trail(t, position)

    def _paint(self, part: Trace) -> None:
        """Give the stabilators the colour of the true K, wherever it changes."""
        gain = part["effectiveness_true"]
        changed = np.flatnonzero(gain != np.concatenate([[self._effectiveness], gain[:-1]]))
        self._effectiveness = float(gain[-1])
        if changed.size:
            colors = [(*palette.between(palette.FAILURE, palette.ACTUAL, k), 255) for k in gain[changed]]
            self._stream.send_columns(
                _STABILATORS,
                indexes=_time(part["t_s"][changed]),
                columns=rr.Mesh3D.columns(albedo_factor=np.array(colors, dtype=np.uint8)),
            )

    def _trail(self, t: Vector, position: npt.NDArray[np.float32]) -> None:
        led = len(self._last_position)
        path = np.vstack([self._last_position, position])
        starts = np.arange(0, len(path) - 1, _TRAIL_TICKS)
        self._last_position = position[-1:]
        if starts.size:
            ends = np.minimum(starts + _TRAIL_TICKS, len(path) - 1)
            strips = [path[a : b + 1] for a, b in zip(starts, ends, strict=True)]
            self._stream.send_columns(
                "world/trail", indexes=_time(t[ends - led]), columns=rr.LineStrips3D.columns(strips=strips)
            )


def _failure(plot: Plot, t_s: float) -> str:
    return f"{plot.key}/failure_{t_s:g}"


def _time(t_s: Vector) -> list[Any]:
    return [rr.TimeColumn(TIMELINE, duration=t_s)]


def _mesh(shape: mesh.Mesh, *, painted: bool = True) -> rr.Mesh3D:
    colors = shape.colors if painted else None
    return rr.Mesh3D(vertex_positions=shape.vertices, triangle_indices=shape.faces, vertex_colors=colors)


def quaternions(phi: Vector, theta: Vector, psi: Vector) -> Vector:
    """Return (n, 4) quaternions xyzw of body to north-east-down from roll, pitch, yaw; rad."""
    cr, sr, cp, sp, cy, sy = (f(a / 2.0) for a in (phi, theta, psi) for f in (np.cos, np.sin))
    return np.column_stack(
        [
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
            cr * cp * cy + sr * sp * sy,
        ]
    )
