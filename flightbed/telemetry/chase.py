"""The aircraft in space: where it is, how it lies, what its stabilators do, and the way that it came."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import rerun as rr

from flightbed import palette
from flightbed.telemetry import mesh
from flightbed.telemetry.layout import TIMELINE
from flightbed.trace import Trace
from flightbed.units import DEG, FT

Vector = npt.NDArray[np.float64]
_TRAIL_TICKS = 10  # one piece of the trail


class Aircraft:
    """Tells a stream of one aircraft in flight.

    Args:
        stream: where to.
        root: entity that it hangs under, in axes north-east-down, m, from where the first flight begins.
        trail: colour of the trail.
        label: written at the aircraft, if there is one.
        east_m: how far to the right it is drawn of where it flies.

    """

    def __init__(
        self, stream: rr.RecordingStream, root: str, *, trail: str, label: str = "", east_m: float = 0.0
    ) -> None:
        self._stream, self._root, self._color, self._label = stream, root, trail, label
        self._east_m, self._altitude_ft = east_m, 0.0
        self._stabilators = f"{root}/cg/attitude/hinge/stabilators"
        self._last_position = np.zeros((0, 3), dtype=np.float32)
        self._effectiveness = np.nan

    def begin(self) -> None:
        """Tell what does not change: shapes and colours."""
        stream, root = self._stream, self._root
        stream.log(f"{root}/cg/attitude/airframe", _mesh(mesh.airframe()), static=True)
        stream.log(f"{root}/cg/attitude/hinge", rr.Transform3D(translation=mesh.HINGE), static=True)
        stream.log(self._stabilators, _mesh(mesh.stabilators(), painted=False), static=True)
        trail = rr.LineStrips3D.from_fields(colors=palette.rgb(self._color), radii=0.08)
        stream.log(f"{root}/trail", trail, static=True)
        if self._label:
            point = rr.Points3D([0.0, 0.0, -12.0], radii=0.15, colors=palette.rgb(self._color), labels=self._label)
            stream.log(f"{root}/cg/label", point, static=True)

    def add(self, part: Trace) -> None:
        """Tell the next ticks."""
        t, stream, root = part["t_s"], self._stream, self._root
        if not self._last_position.size:
            self._altitude_ft = float(part["altitude_ft"][0])
        position = positions(part, east_m=self._east_m, from_ft=self._altitude_ft)
        stream.send_columns(f"{root}/cg", indexes=time_of(t), columns=rr.Transform3D.columns(translation=position))
        attitude = quaternions(part["phi_deg"] * DEG, part["theta_deg"] * DEG, part["psi_deg"] * DEG)
        stream.send_columns(
            f"{root}/cg/attitude", indexes=time_of(t), columns=rr.Transform3D.columns(quaternion=attitude)
        )
        # Trailing edge down is a positive rotation about the y axis: what lies aft (-x) moves down (+z).
        half = 0.5 * part["elevator_deg"] * DEG
        turn = np.column_stack([np.zeros_like(half), np.sin(half), np.zeros_like(half), np.cos(half)])
        stream.send_columns(self._stabilators, indexes=time_of(t), columns=rr.Transform3D.columns(quaternion=turn))
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
                self._stabilators,
                indexes=time_of(part["t_s"][changed]),
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
                f"{self._root}/trail", indexes=time_of(t[ends - led]), columns=rr.LineStrips3D.columns(strips=strips)
            )


def positions(trace: Trace, *, east_m: float = 0.0, from_ft: float | None = None) -> npt.NDArray[np.float32]:
    """Return (n, 3) north, east, down, m, from where the flight begins; ``from_ft`` is the altitude there."""
    start = float(trace["altitude_ft"][0]) if from_ft is None else from_ft
    down = (start - trace["altitude_ft"]) * FT
    return np.column_stack([trace["north_m"], trace["east_m"] + east_m, down]).astype(np.float32)


def time_of(t_s: Vector) -> list[Any]:
    """Return the index of columns: flight time, s, as whole nanoseconds."""
    return [rr.TimeColumn(TIMELINE, duration=np.rint(np.asarray(t_s) * 1e9).astype("timedelta64[ns]"))]


def set_time(stream: rr.RecordingStream, t_s: float) -> None:
    """Set the flight time, s, of what is logged next."""
    stream.set_time(TIMELINE, duration=np.timedelta64(round(t_s * 1e9), "ns"))


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
