"""Several runs -> one recording with a common time axis and one colour per run."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Literal

import numpy as np
import rerun as rr

from flightbed.analysis.comparison import Run, same_line
from flightbed.analysis.trace import Vector
from flightbed.core.errors import OutputError
from flightbed.document import palette
from flightbed.document.document import Table
from flightbed.telemetry import layout
from flightbed.telemetry.channels import AIRFRAME, OVERVIEW, ROLL_YAW, Plot
from flightbed.telemetry.chase import Aircraft, positions, set_time, time_of
from flightbed.telemetry.recorder import vertical_lines
from flightbed.telemetry.recording import APPLICATION

SPACING_M = 20.0  # lateral distance between the drawn aircraft
_STATES = {"healthy": palette.REFERENCE, "failed": palette.FAILURE, "departed": palette.DEPARTED, "over": palette.OTHER}

_PLOTS = (
    Plot("pitch_rate", "Pitch rate, deg/s", OVERVIEW, ()),
    Plot("effectiveness", "Elevator effectiveness K, smoothed estimate, share", OVERVIEW, (), (-0.1, 1.3)),
    Plot("elevator", "Elevator position, deg", OVERVIEW, ()),
    Plot("alpha", "Angle of attack, deg", OVERVIEW, ()),
    Plot("mach", "Mach number, 1", AIRFRAME, ()),
    Plot("altitude", "Altitude, ft", AIRFRAME, ()),
    Plot("load_factor", "Load factor nz, g", AIRFRAME, ()),
    Plot("attitude", "Attitude theta, deg", AIRFRAME, ()),
)
_ROLL_YAW = (
    Plot("roll_rate", "Roll rate, deg/s", ROLL_YAW, ()),
    Plot("bank", "Angle of bank, deg", ROLL_YAW, ()),
    Plot("aileron", "Aileron position, deg", ROLL_YAW, ()),
    Plot("effectiveness_aileron", "Aileron effectiveness K, smoothed estimate, share", ROLL_YAW, (), (-0.1, 1.3)),
    Plot("sideslip", "Sideslip, deg", ROLL_YAW, ()),
    Plot("rudder", "Rudder position, deg", ROLL_YAW, ()),
    Plot("effectiveness_rudder", "Rudder effectiveness K, smoothed estimate, share", ROLL_YAW, (), (-0.1, 1.3)),
)  # if any run has aileron and rudder commands
_COLUMNS: Mapping[str, str] = {
    "pitch_rate": "q_deg_s", "elevator": "elevator_deg", "alpha": "alpha_deg", "mach": "mach", "altitude": "altitude_ft",
    "load_factor": "nz_g", "attitude": "theta_deg", "roll_rate": "p_deg_s", "bank": "phi_deg", "aileron": "aileron_deg",
    "sideslip": "beta_deg", "rudder": "rudder_deg",
}  # fmt: skip
# Additional lines, plotted once where several runs agree: column, label, colour.
_SHARED = {
    "pitch_rate": ("q_ref_deg_s", "q reference", palette.REFERENCE),
    "effectiveness": ("effectiveness_true", "K true", palette.TRUTH),
    "load_factor": ("nz_ref_g", "nz reference", palette.REFERENCE),
    "roll_rate": ("p_ref_deg_s", "p reference", palette.REFERENCE),
    "sideslip": ("beta_ref_deg", "beta reference", palette.REFERENCE),
    "effectiveness_aileron": ("effectiveness_aileron_true", "K true", palette.TRUTH),
    "effectiveness_rudder": ("effectiveness_rudder_true", "K true", palette.TRUTH),
}


def write_comparison(path: Path, runs: Sequence[Run], *, tables: Sequence[Table]) -> None:
    """Write the recording of several runs with its layout. Raises OutputError."""
    slugs = [f"{i + 1}_{re.sub('[^A-Za-z0-9]+', '_', run.label)}" for i, run in enumerate(runs)]
    stream = rr.RecordingStream(APPLICATION, recording_id="-".join(slugs)[:100])
    stream.set_log_time_enabled(False)
    trails = [f"/world/{slug}/trail" for slug in slugs]
    plots = (*_PLOTS, *(_ROLL_YAW if any(run.lateral for run in runs) else ()))
    try:
        stream.save(path, default_blueprint=layout.comparison(plots, follow="/world/middle", trails=trails))
    except Exception as error:
        raise OutputError(f"{path}: cannot be written: {error}") from None
    with stream:
        stream.send_recording_name(" / ".join(run.label for run in runs))
        text = "\n\n".join(_markdown(table) for table in tables)
        stream.log("run_card", rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN), static=True)
        stream.log("world", rr.ViewCoordinates.FRD, static=True)
        for plot in plots:
            _lines(stream, plot, runs, slugs)
        for i, (run, slug) in enumerate(zip(runs, slugs, strict=True)):
            aircraft = Aircraft(
                stream, f"world/{slug}", trail=run.color, label=run.label, east_m=i * SPACING_M, lateral=run.lateral
            )
            aircraft.begin()
            aircraft.add(run.trace)
            _states(stream, run, f"mode/{slug}")
        _middle(stream, runs)
        stream.flush()
    stream.disconnect()


def _middle(stream: rr.RecordingStream, runs: Sequence[Run]) -> None:
    """Log the mean position of the aircraft still in flight, the target of the chase view."""
    longest = max(runs, key=lambda run: float(run.trace["t_s"][-1]))
    t = longest.trace["t_s"]
    paths = []
    for i, run in enumerate(runs):
        path = positions(run.trace, east_m=i * SPACING_M)
        flying = t <= run.trace["t_s"][-1] + 1e-9
        paths.append([np.where(flying, np.interp(t, run.trace["t_s"], axis), np.nan) for axis in path.T])
    middle = np.nanmean(np.array(paths), axis=0).T.astype(np.float32)
    stream.send_columns("world/middle", indexes=time_of(t), columns=rr.Transform3D.columns(translation=middle))


def _column(run: Run, plot: Plot) -> Vector | None:
    column, surface = _COLUMNS.get(plot.key), plot.key.partition("_")[2] or "elevator"
    values = run.smoothed(surface) if column is None else run.trace.columns.get(column)
    return values if values is not None and np.any(np.isfinite(values)) else None


def _lines(stream: rr.RecordingStream, plot: Plot, runs: Sequence[Run], slugs: Sequence[str]) -> None:
    low, high = plot.range or (np.inf, -np.inf)
    if plot.key in _SHARED:
        column, label, color = _SHARED[plot.key]
        plotted: list[tuple[Vector, Vector]] = []
        for run, slug in zip(runs, slugs, strict=True):
            reference = run.trace.columns.get(column)
            if reference is None or not np.any(np.isfinite(reference)):  # the run has no such command
                continue
            if any(same_line(run.trace["t_s"], reference, *other) for other in plotted):
                continue
            plotted.append((run.trace["t_s"], reference))
            entity = f"{plot.key}/{label.replace(' ', '_')}/{slug}"
            _line(stream, entity, f"{label}, {run.label}", color, run.trace["t_s"], reference)
    for run, slug in zip(runs, slugs, strict=True):
        own = _column(run, plot)
        if own is not None:
            name = f"{run.label}: {run.estimator}" if plot.key.startswith("effectiveness") else run.label
            _line(stream, f"{plot.key}/{slug}", name, run.color, run.trace["t_s"], own)
            if plot.range is None:
                low, high = min(low, float(np.nanmin(own))), max(high, float(np.nanmax(own)))
    if not low < high:
        return
    failures = sorted({t_s for run in runs for t_s in run.failures_s})
    if failures:
        entity = f"{plot.key}/failure"
        _style(stream, entity, "failure", palette.FAILURE, "Off")
        times, values = vertical_lines(failures, low, high)
        stream.send_columns(entity, indexes=time_of(times), columns=rr.Scalars.columns(scalars=values))


def _line(stream: rr.RecordingStream, entity: str, label: str, color: str, t_s: Vector, values: Vector) -> None:
    _style(stream, entity, label, color, "MinMax")
    stream.send_columns(entity, indexes=time_of(t_s), columns=rr.Scalars.columns(scalars=values))


def _style(stream: rr.RecordingStream, entity: str, label: str, color: str, policy: Literal["MinMax", "Off"]) -> None:
    style = rr.SeriesLines(names=label, colors=palette.rgb(color), widths=1.6, aggregation_policy=policy)
    stream.log(entity, style, static=True)


def _states(stream: rr.RecordingStream, run: Run, entity: str) -> None:
    colors = np.array([0xFF + (int(color[1:], 16) << 8) for color in _STATES.values()], dtype=np.uint32)
    stream.log(entity, rr.StateConfiguration(values=list(_STATES), colors=colors), static=True)
    changes = [(0.0, "healthy")]
    changes += [(t_s, "failed") for t_s in run.failures_s[:1] if t_s <= run.trace["t_s"][-1]]
    changes.append((float(run.trace["t_s"][-1]), "departed" if run.summary.metrics.departed else "over"))
    for t_s, state in changes:
        set_time(stream, t_s)
        stream.log(entity, rr.StateChange(state=state))


def _markdown(table: Table) -> str:
    def row(cells: Sequence[str]) -> str:
        return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |\n"

    rows = "".join(row(table.cell_texts(cells)) for cells in table.rows)
    return f"## {table.title}\n\n{row(table.columns)}|{'---|' * len(table.columns)}\n{rows}\n{table.note}\n"
