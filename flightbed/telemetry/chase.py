"""The aircraft in the chase view: position, attitude, surface deflections and trail."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import rerun as rr

from flightbed.analysis.trace import Trace, true_share
from flightbed.core.estimate_names import estimate_name
from flightbed.core.units import DEG, FT
from flightbed.document import palette
from flightbed.telemetry import mesh
from flightbed.telemetry.layout import TIMELINE

Vector = npt.NDArray[np.float64]
_TRAIL_TICKS = 10  # length of one piece of the trail


class _HingedPart(NamedTuple):
    """A part that rotates with a surface: entity path below the attitude, mesh, hinge, surface, axis, sense of rotation."""

    path: str
    shape: mesh.Mesh
    hinge: tuple[float, float, float]
    surface: str
    axis: int
    sense: float


# Trailing edge down is a positive rotation about the y axis: points aft of the hinge (-x) move down (+z).
_STABILATORS = _HingedPart("hinge/stabilators", mesh.stabilators(), mesh.HINGE, "elevator", 1, 1.0)
# Positive aileron rolls to the right: the left aileron moves down, the right one up. Positive rudder yaws the nose left: its trailing
# edge, aft of the hinge, moves left (-y), which is a positive rotation about the z axis.
_LATERAL_PARTS = (
    _HingedPart("hinge_left/aileron", mesh.aileron(-1.0), mesh.AILERON_HINGE, "aileron", 1, 1.0),
    _HingedPart("hinge_right/aileron", mesh.aileron(1.0), mesh.AILERON_HINGE, "aileron", 1, -1.0),
    _HingedPart("hinge_fin/rudder", mesh.rudder(), mesh.RUDDER_HINGE, "rudder", 2, 1.0),
)


class Aircraft:
    """Logs one aircraft in flight to a stream.

    Args:
        stream: recording stream.
        root: parent entity path; axes north-east-down, m, origin at the start of the flight.
        trail: colour of the trail.
        label: label at the aircraft; empty for none.
        east_m: offset of the drawn aircraft to the east, m.
        lateral: whether the trace contains aileron and rudder, which then move.

    """

    def __init__(
        self,
        stream: rr.RecordingStream,
        root: str,
        *,
        trail: str,
        label: str = "",
        east_m: float = 0.0,
        lateral: bool = False,
    ) -> None:
        self._stream, self._root, self._color, self._label = stream, root, trail, label
        self._east_m, self._altitude_ft = east_m, 0.0
        self._parts = (_STABILATORS, *(_LATERAL_PARTS if lateral else ()))
        self._last_position = np.zeros((0, 3), dtype=np.float32)
        self._effectiveness = dict.fromkeys((part.path for part in self._parts), np.nan)

    def begin(self) -> None:
        """Log the static data: meshes and colours."""
        stream, root = self._stream, self._root
        body = mesh.airframe(rudder=_LATERAL_PARTS[-1] not in self._parts)
        stream.log(f"{root}/cg/attitude/airframe", _mesh(body), static=True)
        for part in self._parts:
            hinge = self._entity(part).rpartition("/")[0]
            stream.log(hinge, rr.Transform3D(translation=part.hinge), static=True)
            stream.log(self._entity(part), _mesh(part.shape, painted=False), static=True)
        trail = rr.LineStrips3D.from_fields(colors=palette.rgb(self._color), radii=0.08)
        stream.log(f"{root}/trail", trail, static=True)
        if self._label:
            point = rr.Points3D([0.0, 0.0, -12.0], radii=0.15, colors=palette.rgb(self._color), labels=self._label)
            stream.log(f"{root}/cg/label", point, static=True)

    def add(self, part: Trace) -> None:
        """Log the next ticks."""
        t, stream, root = part["t_s"], self._stream, self._root
        if not self._last_position.size:
            self._altitude_ft = float(part["altitude_ft"][0])
        position = positions(part, east_m=self._east_m, from_ft=self._altitude_ft)
        stream.send_columns(f"{root}/cg", indexes=time_of(t), columns=rr.Transform3D.columns(translation=position))
        attitude = quaternions(part["phi_deg"] * DEG, part["theta_deg"] * DEG, part["psi_deg"] * DEG)
        stream.send_columns(
            f"{root}/cg/attitude", indexes=time_of(t), columns=rr.Transform3D.columns(quaternion=attitude)
        )
        for hinged in self._parts:
            half = 0.5 * hinged.sense * part[f"{hinged.surface}_deg"] * DEG
            turn = np.zeros((len(half), 4))
            turn[:, hinged.axis], turn[:, 3] = np.sin(half), np.cos(half)
            columns = rr.Transform3D.columns(quaternion=turn)
            stream.send_columns(self._entity(hinged), indexes=time_of(t), columns=columns)
            self._paint(hinged, part)
        self._trail(t, position)

    def _entity(self, part: _HingedPart) -> str:
        return f"{self._root}/cg/attitude/{part.path}"

    def _paint(self, hinged: _HingedPart, part: Trace) -> None:
        """Colour a part by the true K of its surface, at each change of K."""
        gain = part[true_share(estimate_name("", hinged.surface))]
        changed = np.flatnonzero(gain != np.concatenate([[self._effectiveness[hinged.path]], gain[:-1]]))
        self._effectiveness[hinged.path] = float(gain[-1])
        if changed.size:
            colors = [(*palette.blend(palette.FAILURE, palette.ACTUAL, k), 255) for k in gain[changed]]
            self._stream.send_columns(
                self._entity(hinged),
                indexes=time_of(part["t_s"][changed]),
                columns=rr.Mesh3D.columns(albedo_factor=np.array(colors, dtype=np.uint8)),
            )

    def _trail(self, t: Vector, position: npt.NDArray[np.float32]) -> None:
        offset = len(self._last_position)
        path = np.vstack([self._last_position, position])
        starts = np.arange(0, len(path) - 1, _TRAIL_TICKS)
        self._last_position = position[-1:]
        if starts.size:
            ends = np.minimum(starts + _TRAIL_TICKS, len(path) - 1)
            strips = [path[a : b + 1] for a, b in zip(starts, ends, strict=True)]
            self._stream.send_columns(
                f"{self._root}/trail", indexes=time_of(t[ends - offset]), columns=rr.LineStrips3D.columns(strips=strips)
            )


def positions(trace: Trace, *, east_m: float = 0.0, from_ft: float | None = None) -> npt.NDArray[np.float32]:
    """Return north, east, down (n, 3), m, relative to the start of the flight; ``from_ft`` is its altitude, ft."""
    start = float(trace["altitude_ft"][0]) if from_ft is None else from_ft
    down = (start - trace["altitude_ft"]) * FT
    return np.column_stack([trace["north_m"], trace["east_m"] + east_m, down]).astype(np.float32)


def time_of(t_s: Vector) -> list[Any]:
    """Return the time index of columns from flight time, s; Rerun stores whole nanoseconds."""
    return [rr.TimeColumn(TIMELINE, duration=np.rint(np.asarray(t_s) * 1e9).astype("timedelta64[ns]"))]


def set_time(stream: rr.RecordingStream, t_s: float) -> None:
    """Set the flight time, s, of the next log calls."""
    stream.set_time(TIMELINE, duration=np.timedelta64(round(t_s * 1e9), "ns"))


def _mesh(shape: mesh.Mesh, *, painted: bool = True) -> rr.Mesh3D:
    colors = shape.colors if painted else None
    return rr.Mesh3D(vertex_positions=shape.vertices, triangle_indices=shape.faces, vertex_colors=colors)


def quaternions(phi: Vector, theta: Vector, psi: Vector) -> Vector:
    """Return the quaternions xyzw (n, 4) of body to north-east-down axes from roll, pitch and yaw, rad."""
    cr, sr, cp, sp, cy, sy = (f(a / 2.0) for a in (phi, theta, psi) for f in (np.cos, np.sin))
    return np.column_stack(
        [
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
            cr * cp * cy + sr * sp * sy,
        ]
    )
