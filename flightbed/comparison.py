"""Runs' folders -> what is the same and what differs between them: settings, metrics, a table."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Any

from flightbed import palette
from flightbed.card import outcome
from flightbed.document import Cell, Table
from flightbed.errors import OutputError
from flightbed.folder import folder_of
from flightbed.trace import Trace, read_trace

# heading, unit -> key in metrics.json
_FLIGHT = {
    ("tracking RMS before the failure", "deg/s"): "tracking_rms_pre_deg_s",
    ("tracking RMS from 0.3 s after the failure", "deg/s"): "tracking_rms_post_deg_s",
    ("elevator command at a stop", "share"): "elevator_at_stop_share",
    ("flown", "s"): "flown_s",
}
_ESTIMATOR = {
    ("median error of K", "share"): "median_abs_error_post",
    ("RMS error of smoothed K", "share"): "rms_error_smoothed_post",
    ("K first within 20 %, after", "s"): "first_within_20pct_s",
    ("change declared, after", "s"): "detected_at_s",
    ("mean NIS", "1"): "nis_mean",
}


@dataclass(frozen=True)
class Run:
    """A run that was flown before, from its folder.

    Attributes:
        folder: where it is.
        label: what it is called beside the others.
        color: its colour.
        trace: the flight.
        summary: what metrics.json holds.
        settings: every key of the resolved scenario, dotted, and its value.
        watched: the estimator to look at: the one that adapts, else the first; None without any.

    """

    folder: Path
    label: str
    color: str
    trace: Trace
    summary: Mapping[str, Any]
    settings: Mapping[str, Any]
    watched: str | None

    @property
    def failures_s(self) -> tuple[float, ...]:
        """When failures begin."""
        times = {float(v) for k, v in self.settings.items() if k.startswith("failures.") and k.endswith(".at_s")}
        return tuple(sorted(times))

    @property
    def outcome(self) -> str:
        """How it ended, in words."""
        return outcome(dict(self.summary))


def load_runs(folders: Sequence[str | Path]) -> tuple[Run, ...]:
    """Read the runs of some folders; each label is the shortest that tells it from the others. Raises OutputError."""
    if len(folders) < 2:
        raise OutputError(f"compare: needs at least two runs' folders (got {len(folders)})")
    places = [folder_of(folder) for folder in folders]
    for i, place in enumerate(places):
        if place.resolve() in [p.resolve() for p in places[:i]]:
            raise OutputError(f"compare: {place}: is named twice")
    read = [_read(place) for place in places]
    labels = _labels([(str(settings["name"]), place) for settings, _, place in read])
    return tuple(
        Run(place, label, palette.run(i), read_trace(place / "trace.parquet"), summary, settings, _watched(settings))
        for i, (label, (settings, summary, place)) in enumerate(zip(labels, read, strict=True))
    )


def short_name(runs: Sequence[Run]) -> str:
    """Return a folder's name for a comparison: the labels, as far as they fit."""
    return "-".join(re.sub("[^A-Za-z0-9]+", "-", run.label).strip("-") for run in runs)[:80].strip("-")


def _read(place: Path) -> tuple[dict[str, Any], dict[str, Any], Path]:
    """Return the settings and the metrics of a run; the scenario's names of algorithms are not looked up."""
    for file in ("scenario.toml", "trace.parquet"):
        if not (place / file).is_file():
            raise OutputError(f"{place}: not a run's folder (no {file})")
    try:
        scenario = tomllib.loads((place / "scenario.toml").read_text(encoding="utf-8"))
        summary = json.loads((place / "metrics.json").read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise OutputError(f"{place}: cannot be read: {error}") from None
    settings = _flat(scenario)
    if "name" not in settings or "estimators" not in summary or "flown_s" not in summary:
        raise OutputError(f"{place}: not a run of this version of flightbed; fly its scenario.toml again")
    return settings, summary, place


def _flat(value: Any, prefix: str = "") -> dict[str, Any]:
    """Return nested tables as dotted keys."""
    if isinstance(value, Mapping):
        items = list(value.items())
    elif isinstance(value, list) and all(isinstance(v, Mapping) for v in value):
        items = list(enumerate(value))
    else:
        return {prefix: value}
    # An empty list is one without tables, such as that of a scenario without failures.
    return {k: v for key, inner in items for k, v in _flat(inner, f"{prefix}.{key}" if prefix else str(key)).items()}


def _labels(runs: Sequence[tuple[str, Path]]) -> list[str]:
    candidates = [
        [name for name, _ in runs],
        [place.resolve().name for _, place in runs],
        [str(place) for _, place in runs],
    ]
    return next(labels for labels in candidates if len(set(labels)) == len(labels))


def _watched(settings: Mapping[str, Any]) -> str | None:
    if settings.get("adaptation.enabled") and not settings.get("adaptation.oracle"):
        return str(settings["adaptation.estimator"])
    name = settings.get("estimators.0.name")
    return None if name is None else str(name)


def differing(runs: Sequence[Run]) -> Table:
    """Return the settings that are not the same in all runs."""
    keys = dict.fromkeys(key for run in runs for key in run.settings)
    rows: list[list[Cell]] = []
    for key in keys:
        values = [run.settings.get(key) for run in runs]
        if key not in ("name", "description") and any(value != values[0] for value in values):
            rows.append([key, *("-" if value is None else _word(value) for value in values)])
    return Table("settings", "Settings that differ", ["key", *(run.label for run in runs)], rows)


def _word(value: Any) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


def metrics_table(runs: Sequence[Run]) -> Table:
    """Return the metrics of all runs, and how far the later ones are from the first."""
    rows: list[list[Cell]] = [["outcome", "", *(run.outcome for run in runs)]]
    rows.append(["largest |alpha|", "deg", *_against_first([_largest(run, "alpha_deg") for run in runs])])
    rows.append(["largest |nz|", "g", *_against_first([_largest(run, "nz_g") for run in runs])])
    rows += [
        [text, unit, *_against_first([run.summary.get(key) for run in runs])] for (text, unit), key in _FLIGHT.items()
    ]
    for name in dict.fromkeys(name for run in runs for name in run.summary["estimators"]):
        for (text, unit), key in _ESTIMATOR.items():
            values = [run.summary["estimators"].get(name, {}).get(key) for run in runs]
            rows.append([f"{name}: {text}", unit, *_against_first(values)])
    return Table(
        "metrics",
        f"Metrics; in brackets the difference from {runs[0].label}",
        ["", "unit", *(run.label for run in runs)],
        rows,
    )


def _largest(run: Run, column: str) -> float | None:
    value = float(abs(run.trace[column]).max())
    return value if isfinite(value) else None


def _against_first(values: Sequence[float | None]) -> list[str]:
    first, shown = values[0], []
    for i, value in enumerate(values):
        if value is None:
            shown.append("-")
        elif i == 0 or first is None:
            shown.append(f"{value:.4g}")
        else:
            shown.append(f"{value:.4g} ({value - first:+.2g})")
    return shown


def to_dict(runs: Sequence[Run]) -> dict[str, Any]:
    """Return the comparison for JSON: metrics of every run, differences from the first, settings that differ."""
    table = differing(runs)
    return {
        "runs": [{"label": run.label, "folder": str(run.folder.resolve()), **run.summary} for run in runs],
        "differences": {run.label: _minus(run.summary, runs[0].summary) for run in runs[1:]},
        "settings": {str(row[0]): dict(zip(table.columns[1:], row[1:], strict=True)) for row in table.rows},
    }


def _minus(these: Mapping[str, Any], those: Mapping[str, Any]) -> dict[str, Any]:
    """Return the differences of all numbers that both have."""
    found: dict[str, Any] = {}
    for key, value in these.items():
        other = those.get(key)
        if isinstance(value, Mapping) and isinstance(other, Mapping):
            if inner := _minus(value, other):
                found[key] = inner
        elif _number(value) and _number(other):
            found[key] = value - other
    return found


def _number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
