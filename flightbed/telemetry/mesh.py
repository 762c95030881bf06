"""Mesh of a simple fighter, for display only: vertices in body axes (forward, right, down), m, origin at the c.g."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

_GREY, _LIGHT, _DARK, _CANOPY, _WHITE = (150, 158, 168), (176, 184, 194), (96, 103, 112), (52, 84, 120), (255, 255, 255)


class Mesh(NamedTuple):
    """Triangle mesh: vertices (n, 3), m; faces (m, 3), vertex indices; colours (n, 3), 0 to 255."""

    vertices: npt.NDArray[np.float32]
    faces: npt.NDArray[np.uint32]
    colors: npt.NDArray[np.uint8]


HINGE = (-6.0, 0.0, 0.0)  # the stabilators rotate about the y axis through this point
AILERON_HINGE = (-1.9, 0.0, -0.03)  # the ailerons rotate about the y axis through this point
RUDDER_HINGE = (-6.3, 0.0, 0.0)  # the rudder rotates about the z axis through this point


def airframe(*, rudder: bool = True) -> Mesh:
    """Return fuselage, nozzle, canopy, intake, strakes, cropped delta wing with tip rails, fin, ventral fins, optionally rudder."""
    # station x, half width, half height, centre z
    body = [
        (8.2, 0.02, 0.02, 0.0),
        (6.6, 0.42, 0.42, 0.0),
        (4.2, 0.62, 0.72, 0.05),
        (1.0, 0.85, 0.85, 0.1),
        (-3.0, 0.85, 0.75, 0.05),
        (-6.6, 0.55, 0.55, 0.0),
        (-7.2, 0.45, 0.45, 0.0),
    ]
    canopy = [(4.6, 0.05, 0.05, -0.6), (3.6, 0.4, 0.4, -0.75), (2.4, 0.42, 0.45, -0.75), (0.8, 0.1, 0.1, -0.7)]
    intake = [(3.4, 0.5, 0.35, 0.85), (0.0, 0.5, 0.3, 0.75), (-3.0, 0.2, 0.1, 0.6)]
    nozzle = [(-6.6, 0.55, 0.55, 0.0), (-7.6, 0.42, 0.42, 0.0)]
    parts = [_loft(body, _GREY), _loft(canopy, _CANOPY), _loft(intake, _DARK), _loft(nozzle, _DARK)]
    for s in (-1.0, 1.0):
        parts += [
            _plate([(4.4, s * 0.55, -0.1), (1.6, s * 1.3, -0.1), (0.4, s * 0.8, -0.1)], _GREY),  # strake
            _plate([(1.8, s * 0.8, 0.0), (-1.2, s * 4.6, 0.0), (-2.3, s * 4.6, 0.0), (-2.6, s * 0.7, 0.0)], _LIGHT),
            _loft([(0.3, 0.02, 0.02, 0.0), (-0.3, 0.1, 0.1, 0.0), (-2.6, 0.1, 0.1, 0.0)], _DARK, at_y=s * 4.7),
            _plate([(-4.3, s * 0.5, 0.5), (-5.2, s * 0.85, 1.2), (-6.0, s * 0.85, 1.2), (-6.0, s * 0.45, 0.5)], _DARK),
        ]
    parts.append(_plate([(-2.2, 0.0, -0.6), (-5.9, 0.0, -3.5), (-7.2, 0.0, -3.5), (-6.7, 0.0, -0.5)], _LIGHT))
    parts += [
        _plate([(-6.1, y, -0.9), (-6.5, y, -3.2), (-7.2, y, -3.2), (-7.0, y, -0.9)], _DARK)
        for y in ((0.02, -0.02) if rudder else ())
    ]
    return _join(parts)


def stabilators() -> Mesh:
    """Return both halves of the horizontal tail about the hinge; white, because the viewer multiplies by a colour."""
    return _join(
        [
            _plate([(1.0, s * 0.5, 0.0), (-0.6, s * 2.8, 0.0), (-1.3, s * 2.8, 0.0), (-1.2, s * 0.5, 0.0)], _WHITE)
            for s in (-1, 1)
        ]
    )


def aileron(side: float) -> Mesh:
    """Return one aileron about its hinge, white like the stabilators; ``side`` is 1 for the right, -1 for the left aileron."""
    return _plate(
        [(0.0, side * 1.3, 0.0), (0.0, side * 3.6, 0.0), (-0.75, side * 3.6, 0.0), (-0.75, side * 1.3, 0.0)], _WHITE
    )


def rudder() -> Mesh:
    """Return a flat rudder about its hinge, white like the stabilators."""
    return _plate([(0.1, 0.0, -0.9), (-0.1, 0.0, -3.2), (-1.0, 0.0, -3.2), (-0.85, 0.0, -0.9)], _WHITE)


def _loft(stations: list[tuple[float, float, float, float]], color: tuple[int, int, int], *, at_y: float = 0.0) -> Mesh:
    around = 12
    angle = np.linspace(0.0, 2.0 * np.pi, around, endpoint=False)
    rings = [
        np.column_stack([np.full(around, x), at_y + w * np.cos(angle), z + h * np.sin(angle)])
        for x, w, h, z in stations
    ]
    faces = []
    for ring in range(len(stations) - 1):
        for i in range(around):
            a, b = ring * around + i, ring * around + (i + 1) % around
            faces += [(a, b, a + around), (b, b + around, a + around)]
    vertices = np.vstack(rings).astype(np.float32)
    # Lighter above than below, because the viewer does not shade a mesh without normals.
    light = 1.0 - 0.22 * np.clip(2.0 * vertices[:, 2], -1.0, 1.0)
    colors = np.clip(np.outer(light, color), 0, 255).astype(np.uint8)
    return Mesh(vertices, np.array(faces, dtype=np.uint32), colors)


def _plate(corners: list[tuple[float, float, float]], color: tuple[int, int, int]) -> Mesh:
    n = len(corners)
    faces = [(0, i, i + 1) for i in range(1, n - 1)] + [(0, i + 1, i) for i in range(1, n - 1)]
    return Mesh(
        np.array(corners, dtype=np.float32),
        np.array(faces, dtype=np.uint32),
        np.tile(np.array(color, dtype=np.uint8), (n, 1)),
    )


def _join(parts: list[Mesh]) -> Mesh:
    offsets = np.cumsum([0, *(len(p.vertices) for p in parts[:-1])])
    return Mesh(
        np.vstack([p.vertices for p in parts]),
        np.vstack([p.faces + np.uint32(o) for p, o in zip(parts, offsets, strict=True)]).astype(np.uint32),
        np.vstack([p.colors for p in parts]),
    )
