"""Sweep -> picture: pitch stability, trim alpha and elevator over speed and altitude; crosses mark conditions without a trim."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from flightbed.core.errors import InputError
from flightbed.models.survey.condition import Query

_SUFFIXES = (".png", ".svg", ".pdf")
_SPEED = {"mach": "Mach number", "tas_fps": "true airspeed, ft/s", "cas_kt": "calibrated airspeed, kt"}
_PANELS = (
    ("fastest_unstable_rad_s", "fastest root of the short period, rad/s", "RdBu_r", True),
    ("alpha_deg", "trim angle of attack, deg", "viridis", False),
    ("elevator_deg", "trim elevator, deg", "viridis", False),
)


def check(path: Path, queries: Sequence[Query]) -> None:
    """Reject a picture of a single speed or with an unknown suffix. Raises InputError."""
    if path.suffix not in _SUFFIXES:
        raise InputError(f"--picture {path}: must end in {', '.join(_SUFFIXES)}")
    if len({q.speed for q in queries}) < 2:
        raise InputError("--picture: needs a sweep with at least two speeds")


def draw(aircraft: str, queries: Sequence[Query], rows: Sequence[Mapping[str, Any]], suffix: str) -> bytes:
    """Return the picture: maps over speed and altitude, or lines over speed for a single altitude.

    Args:
        aircraft: name for the title.
        queries: conditions, a full grid.
        rows: one row per condition (``rows.row``), ``no_trim`` empty for a trimmed condition.
        suffix: ``".png"``, ``".svg"`` or ``".pdf"``.

    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    name = queries[0].speed[0]
    speeds = np.array(sorted({q.speed[1] for q in queries}))
    heights = np.array(sorted({q.altitude_ft for q in queries}))
    place = {(q.speed[1], q.altitude_ft): i for i, q in enumerate(queries)}
    order = [[place[v, h] for v in speeds] for h in heights]
    trimmed = np.array([[not rows[i]["no_trim"] for i in line] for line in order])

    figure = Figure(figsize=(13.0, 4.2), layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(f"{aircraft}: bare airframe at trim; x: no trim")
    for axes, (key, title, colors, signed) in zip(figure.subplots(1, 3), _PANELS, strict=True):
        values = np.array([[_value(rows[i], key) for i in line] for line in order])
        axes.set_title(title, fontsize=10)
        axes.set_xlabel(_SPEED[name])
        if len(heights) == 1:
            axes.plot(speeds, values[0], marker=".")
            axes.plot(speeds[~trimmed[0]], np.zeros((~trimmed[0]).sum()), "kx")
            axes.axhline(0.0, color="0.6", linewidth=0.8)
            axes.grid(alpha=0.3)
            continue
        limit = float(np.nanmax(np.abs(values))) if np.isfinite(values).any() else 1.0
        span: dict[str, float] = {"vmin": -limit, "vmax": limit} if signed else {}
        mesh = axes.pcolormesh(_edges(speeds), _edges(heights), np.ma.masked_invalid(values), cmap=colors, **span)
        figure.colorbar(mesh, ax=axes)
        if signed and np.isfinite(values).all(axis=None) and values.min() < 0.0 < values.max():
            axes.contour(speeds, heights, values, levels=[0.0], colors="k", linewidths=1.0)
        x, y = np.meshgrid(speeds, heights)
        axes.plot(x[~trimmed], y[~trimmed], "kx")
        axes.set_ylabel("altitude, ft")
    buffer = io.BytesIO()
    kind = suffix.removeprefix(".")
    dates: dict[str, dict[str, None]] = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}
    figure.savefig(buffer, format=kind, dpi=150, metadata=dates.get(kind))
    return buffer.getvalue()


def _value(row: Mapping[str, Any], key: str) -> float:
    value = row.get(key)
    return float("nan") if value is None else float(value)


def _edges(centres: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    middle = (centres[1:] + centres[:-1]) / 2.0
    return np.concatenate([[2 * centres[0] - middle[0]], middle, [2 * centres[-1] - middle[-1]]])
