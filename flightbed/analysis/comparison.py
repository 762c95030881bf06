"""Folders of runs -> comparison: settings that differ, metrics, tracking over the same time."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from math import ceil, inf, isfinite
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from flightbed.analysis.metrics import SETTLING_S, EstimatorMetrics
from flightbed.analysis.summary import RunSummary
from flightbed.analysis.summary_text import outcome
from flightbed.analysis.trace import Trace, Vector, read_trace
from flightbed.core.errors import FlightbedError, OutputError
from flightbed.core.estimate_names import estimate_name
from flightbed.document import palette
from flightbed.document.document import Cell, Table
from flightbed.scenario.reading import load_scenario

# heading, with its unit -> value
_FLIGHT: Mapping[str, Callable[[RunSummary], float | None]] = {
    "at a stop, share": lambda summary: summary.elevator_at_stop_share,
    "flown, s": lambda summary: summary.flown_s,
}
_PULL_UP: Mapping[str, Callable[[RunSummary], float | None]] = {
    "pull-up: overshoot, share": lambda summary: summary.metrics.pull_up_overshoot,
    "- undershoot, share": lambda summary: summary.metrics.pull_up_undershoot,
    "- elevator above 5 Hz, deg": lambda summary: summary.metrics.pull_up_flutter_deg,
}
_ESTIMATOR: Mapping[str, Callable[[EstimatorMetrics], float | None]] = {
    "- median error, share": lambda measured: measured.median_abs_error_post,
    "- RMS smoothed, share": lambda measured: measured.rms_error_smoothed_post,
    "- within 20 %, s": lambda measured: measured.first_within_20pct_s,
    "- change found, s": lambda measured: measured.detected_at_s,
    "- mean NIS, 1": lambda measured: measured.nis_mean,
}
_NOTE = (
    "RMS of q - q_ref, likewise of nz, p and beta, over the same time for all runs, up to the end of each. Per estimator: errors of K from "
    "0.3 s after the run's failure, time from the failure to the first K within 20 % and to the first declared change, mean NIS. "
    "In brackets: difference from the first run."
)


@dataclass(frozen=True)
class Run:
    """A run, read from its folder.

    Attributes:
        folder: its path.
        label: its name among the compared runs.
        color: its colour.
        trace: of the flight.
        summary: of its metrics.json.
        settings: dotted key of the resolved scenario -> value.
        idle: keys without effect.
        estimator: name of the estimator in the figures: the one that corrects the law, else the first; None without estimators.

    """

    folder: Path
    label: str
    color: str
    trace: Trace
    summary: RunSummary
    settings: Mapping[str, Any]
    idle: Collection[str]
    estimator: str | None

    @property
    def failures_s(self) -> tuple[float, ...]:
        """Onsets of the failures that the flight reached, s."""
        hz, end = float(self.settings["rates.control_hz"]), float(self.trace["t_s"][-1])
        times = {ceil(v * hz - 1e-6) / hz for k, v in self.settings.items() if re.fullmatch(r"failures\.\d+\.at_s", k)}
        return tuple(sorted(t_s for t_s in times if t_s <= end + 1e-9))

    @property
    def lateral(self) -> bool:
        """Whether its aileron and rudder were commanded."""
        return "aileron_deg" in self.trace.columns

    def smoothed(self, surface: str) -> Vector | None:
        """Return the smoothed K of a surface from the run's ``estimator``; None if it does not estimate it."""
        name = "" if self.estimator is None else estimate_name(self.estimator, surface)
        return self.trace[f"{name}.effectiveness_smoothed"] if name in self.trace.estimators else None

    @property
    def outcome(self) -> str:
        """End of the flight, in a few words."""
        return outcome(self.summary).partition(",")[0]


def load_runs(folders: Sequence[str | Path]) -> tuple[Run, ...]:
    """Read runs from their folders; labels are the shortest names that differ. Raises OutputError."""
    if len(folders) < 2:
        raise OutputError(f"compare: needs at least two runs' folders (got {len(folders)})")
    places = [folder_of(folder) for folder in folders]
    for i, place in enumerate(places):
        if place.resolve() in [p.resolve() for p in places[:i]]:
            raise OutputError(f"compare: {place}: is named twice")
    read = [_read(place) for place in places]
    labels = _labels([(str(one.settings["name"]), one.place) for one in read])
    return tuple(
        Run(
            one.place, label, palette.run(i), _trace(one.place / "trace.parquet"), one.summary, one.settings, one.idle,
            one.estimator,
        )
        for i, (label, one) in enumerate(zip(labels, read, strict=True))
    )  # fmt: skip


def _trace(path: Path) -> Trace:
    """Read a trace and check that it has the columns of a comparison. Raises OutputError."""
    trace = read_trace(path)
    needed = ["q_deg_s", "alpha_deg", "nz_g", *(f"{name}.effectiveness_smoothed" for name in trace.estimators)]
    needed += [f"{name}_{unit}" for _, name, unit, _ in _FOLLOWED if f"{name}_ref_{unit}" in trace.columns]
    for column in needed:
        if column not in trace.columns:
            raise OutputError(f"{path}: not a trace: it has no column {column}; fly the scenario again")
    return trace


def short_name(runs: Sequence[Run]) -> str:
    """Return the name of the folder of a comparison: the labels, cut at 80 characters."""
    words = (re.sub(r"\W+", "-", run.label).strip("-") for run in runs)
    return "-".join(word for word in words if word)[:80].strip("-") or "comparison"


class _RunData(NamedTuple):
    settings: dict[str, Any]
    summary: RunSummary
    place: Path
    idle: Collection[str]
    estimator: str | None


def _read(place: Path) -> _RunData:
    """Return settings and summary of a run; own code that its scenario names is not loaded."""
    for file in ("scenario.toml", "trace.parquet"):
        if not (place / file).is_file():
            raise OutputError(f"{place}: not a run's folder (no {file})")
    try:
        scenario = tomllib.loads((place / "scenario.toml").read_text(encoding="utf-8"))
        stored = json.loads((place / "metrics.json").read_text(encoding="utf-8"))
        settings = _flat(scenario)
    except RecursionError:
        raise OutputError(f"{place}: cannot be read: values are nested too deeply") from None
    except (OSError, ValueError) as error:
        raise OutputError(f"{place}: cannot be read: {error}") from None
    try:
        summary = RunSummary.from_dict(stored)
    except ValueError:
        summary = None
    if summary is None or not _is_resolved(settings, scenario):
        raise OutputError(f"{place}: not a run of this version of flightbed; fly its scenario.toml again")
    names = [str(estimator.get("name", i)) for i, estimator in enumerate(scenario.get("estimators", ()))]

    def named(key: str) -> str:
        """Replace an estimator's number by its name: its number may differ between runs."""
        head, _, rest = key.removeprefix("estimators.").partition(".")
        return f"estimators.{names[int(head)]}.{rest}" if key.startswith("estimators.") else key

    acting, without_effect = _acting(scenario)
    settings = _flat(acting)
    idle = {named(key) for key in without_effect if not key.startswith("estimators.") or names}
    estimator = settings.get("adaptation.estimator") if _is_adaptive(settings) else next(iter(names), None)
    return _RunData({named(key): value for key, value in settings.items()}, summary, place, idle, estimator)


def _is_resolved(settings: Mapping[str, Any], scenario: Mapping[str, Any]) -> bool:
    """Return whether the values that a comparison reads from a scenario are there, and of their types."""
    numbers = [v for k, v in settings.items() if k == "rates.control_hz" or re.fullmatch(r"failures\.\d+\.at_s", k)]
    estimators = scenario.get("estimators", [])
    return (
        {"name", "rates.control_hz"} <= set(settings)
        and all(isinstance(v, int | float) and not isinstance(v, bool) and isfinite(v) for v in numbers)
        and settings["rates.control_hz"] > 0
        and isinstance(estimators, list)
        and all(isinstance(estimator, Mapping) for estimator in estimators)
    )


def _acting(raw: Mapping[str, Any]) -> tuple[Mapping[str, Any], Collection[str]]:
    """Return the keys of a scenario that act, and those without effect; a scenario with own code is not loaded, and returned as it is."""
    try:
        scenario = load_scenario(raw)
    except FlightbedError:
        return raw, ()
    return scenario.settings(), scenario.idle_keys()


def _flat(value: Any, prefix: str = "") -> dict[str, Any]:
    """Return nested tables as dotted keys."""
    if isinstance(value, Mapping):
        items = list(value.items())
    elif isinstance(value, list) and all(isinstance(v, Mapping) for v in value):
        items = list(enumerate(value))
    else:
        return {prefix: value}
    # An empty list has no keys, for example the failures of a scenario without any.
    return {k: v for key, inner in items for k, v in _flat(inner, f"{prefix}.{key}" if prefix else str(key)).items()}


def _labels(runs: Sequence[tuple[str, Path]]) -> list[str]:
    candidates = [
        [name for name, _ in runs],
        [place.resolve().name for _, place in runs],
        [str(place) for _, place in runs],
    ]
    return next(labels for labels in candidates if len(set(labels)) == len(labels))


def _is_adaptive(settings: Mapping[str, Any]) -> bool:
    return bool(settings.get("adaptation.enabled")) and not settings.get("adaptation.oracle")


def same_line(t_s: Vector, values: Vector, other_t_s: Vector, other: Vector) -> bool:
    """Return whether a line is the beginning of another, at the same times."""
    n = len(t_s)
    return n <= len(other_t_s) and np.array_equal(t_s, other_t_s[:n]) and np.array_equal(values, other[:n])


def differing(runs: Sequence[Run]) -> Table:
    """Return the settings that differ between runs."""
    keys = dict.fromkeys(key for run in runs for key in run.settings)
    rows: list[list[Cell]] = []
    for key in keys:
        values = [run.settings.get(key) for run in runs if key not in run.idle]
        if key not in ("name", "description") and any(value != values[0] for value in values):
            shown = ["no effect" if key in run.idle else _word(run.settings.get(key)) for run in runs]
            rows.append([key, *shown])
    return Table("settings", "Settings that differ", ["key", *(run.label for run in runs)], rows)


def _word(value: Any) -> str:
    return "-" if value is None else str(value).lower() if isinstance(value, bool) else str(value)


def different_sources(runs: Sequence[Run]) -> str | None:
    """Return a sentence on the sources that flew, if they differ between runs; None if all are the same, or none is known."""
    found = {run.label: run.summary.source_sha256 for run in runs}
    if len(set(found.values())) < 2:
        return None
    named = ", ".join(f"{label} {'not recorded' if sha256 is None else sha256[:12]}" for label, sha256 in found.items())
    return f"Flown by different sources of flightbed (SHA-256: {named})."


def metrics_table(runs: Sequence[Run]) -> Table:
    """Return the metrics of all runs, with differences from the first."""
    rows: list[list[Cell]] = [["outcome", *(run.outcome for run in runs)]]
    rows.append(["largest |alpha|, deg", *_against_first([_largest(run, "alpha_deg") for run in runs])])
    rows.append(["largest |nz|, g", *_against_first([_largest(run, "nz_g") for run in runs])])
    rows += [[text, *_against_first(values)] for text, values in tracking(runs).items()]
    if any("nz_ref_g" in run.trace.columns for run in runs):
        rows += [[text, *_against_first([value(run.summary) for run in runs])] for text, value in _PULL_UP.items()]
    rows += [[text, *_against_first([value(run.summary) for run in runs])] for text, value in _FLIGHT.items()]
    for name in dict.fromkeys(name for run in runs for name in run.summary.metrics.estimators):
        rows.append([name, *("" for _ in runs)])
        measured = [run.summary.metrics.estimators.get(name) for run in runs]
        for text, value in _ESTIMATOR.items():
            rows.append([text, *_against_first([None if one is None else value(one) for one in measured])])
    return Table("metrics", "Metrics", ["", *(run.label for run in runs)], rows, note=_NOTE)


def tracking(runs: Sequence[Run]) -> dict[str, list[float | None]]:
    """Return the tracking RMS of all runs over the same time: before the first failure of any run, and from 0.3 s after it.

    The metrics of a single run are measured from its own failure, which another run may not have.
    """
    reached = [t_s for run in runs for t_s in run.failures_s]
    spans = {"": (0.0, inf)}
    if reached:
        at_s = min(reached)
        late_s = at_s + SETTLING_S
        spans = {f" before {at_s:g} s": (0.0, at_s), f" from {late_s:g} s": (late_s, inf)}
    followed = [one for one in _FOLLOWED if any(_has_reference(run, f"{one[1]}_ref_{one[2]}") for run in runs)]
    return {
        f"RMS{of}{words}, {unit}": [_rms(run, f"{name}_{suffix}", f"{name}_ref_{suffix}", *span) for run in runs]
        for of, name, suffix, unit in followed
        for words, span in spans.items()
    }


# Quantities with a reference: words, name in the columns NAME_SUFFIX and NAME_ref_SUFFIX, suffix, unit.
_FOLLOWED = (
    ("", "q", "deg_s", "deg/s"),
    (" of nz", "nz", "g", "g"),
    (" of p", "p", "deg_s", "deg/s"),
    (" of beta", "beta", "deg", "deg"),
)


def _has_reference(run: Run, reference: str) -> bool:
    return reference in run.trace.columns and bool(np.any(np.isfinite(run.trace[reference])))


def _rms(run: Run, column: str, reference: str, begin_s: float, end_s: float) -> float | None:
    t = run.trace["t_s"]
    if reference not in run.trace.columns:
        return None
    error = (run.trace[column] - run.trace[reference])[(t >= begin_s - 1e-9) & (t < end_s - 1e-9)]
    value = float(np.sqrt(np.mean(error**2))) if error.size else None
    return value if value is not None and isfinite(value) else None


def _largest(run: Run, column: str) -> float | None:
    value = float(abs(run.trace[column]).max())
    return value if isfinite(value) else None


def _against_first(values: Sequence[float | None]) -> list[str]:
    first, shown = values[0], []
    for i, value in enumerate(values):
        if value is None:
            shown.append("-")
        elif i == 0 or first is None:
            shown.append(f"{value:.3g}")
        else:
            shown.append(f"{value:.3g} ({value - first:+.2g})" if value != first else f"{value:.3g} (same)")
    return shown


def to_dict(runs: Sequence[Run]) -> dict[str, Any]:
    """Return the comparison for JSON: metrics of every run, differences from the first, settings that differ."""
    table, labels = differing(runs), [run.label for run in runs]
    return {
        "runs": [{"label": run.label, "folder": str(run.folder.resolve()), **run.summary.to_dict()} for run in runs],
        "tracking": {text: dict(zip(labels, values, strict=True)) for text, values in tracking(runs).items()},
        "differences": {run.label: _differences(run.summary.to_dict(), runs[0].summary.to_dict()) for run in runs[1:]},
        "settings": {str(row[0]): dict(zip(table.columns[1:], row[1:], strict=True)) for row in table.rows},
    }


def _differences(these: Mapping[str, Any], those: Mapping[str, Any]) -> dict[str, Any]:
    """Return the differences of all measured numbers that both runs have."""
    found: dict[str, Any] = {}
    for key, value in these.items():
        if key == "seed" or key.startswith("tracking_rms_"):
            continue  # the seed is not a metric; tracking may cover different times, see ``tracking``
        other = those.get(key)
        if isinstance(value, Mapping) and isinstance(other, Mapping):
            if inner := _differences(value, other):
                found[key] = inner
        elif _number(value) and _number(other):
            found[key] = value - other
    return found


def _number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def folder_of(run_folder: str | Path) -> Path:
    """Return the folder of a run. Raises OutputError for a folder without metrics.json."""
    folder = Path(run_folder)
    try:
        found = (folder / "metrics.json").is_file()
    except OSError as error:
        raise OutputError(f"{str(folder)[:60]}: cannot be read: {error.strerror}") from None
    if not found:
        raise OutputError(f"{folder}: not a run's folder (no metrics.json)")
    return folder
