"""Folders of runs, studies and comparisons, written atomically; the folder of a campaign grows, see journal.py."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from flightbed.analysis.comparison import folder_of
from flightbed.analysis.events import events
from flightbed.analysis.summary_text import run_card
from flightbed.core.errors import OutputError
from flightbed.core.files import FolderKind, heap_set_aside, to_json, write_folder

if TYPE_CHECKING:
    from flightbed.analysis.result import Result
    from flightbed.telemetry.shown import FlightInfo


RUN = FolderKind("run", frozenset({"scenario.toml", "trace.parquet", "metrics.json", "flight.rrd", "report.html"}))
CAMPAIGN = FolderKind(
    "campaign",
    frozenset(
        {
            "scenario.toml",
            "campaign.toml",
            "table.parquet",
            "summary.json",
            "report.html",
            "histories.parquet",
            "traces",
        }
    ),
)


def write_run(result: Result, target: Path, *, rerun: bool, report: bool, replace: bool) -> Path:
    """Write the folder of a run, with recording and report on demand; returns its path."""

    def write(new: Path) -> None:
        (new / "scenario.toml").write_text(result.plan.scenario.to_toml(), encoding="utf-8")
        (new / "metrics.json").write_text(to_json(result.summary.to_dict()), encoding="utf-8")
        result.trace.write(new / "trace.parquet")
        if rerun:
            _record(result, new / "flight.rrd")
        if report:
            (new / "report.html").write_text(_page(result), encoding="utf-8")

    return write_folder(target, write, replace=replace)


def _page(result: Result) -> str:
    with heap_set_aside():  # drawing creates many objects: garbage collection would double its time
        from flightbed.document.html import render
        from flightbed.report.flight_report import run_report  # slow to import

        return render(run_report(result))


def _record(result: Result, path: Path) -> None:
    from flightbed.telemetry.recording import write_recording  # slow to import

    write_recording(path, result.trace, shown(result))


def shown(result: Result) -> FlightInfo:
    """Return the information on a finished flight that the viewer shows."""
    scenario, summary = result.plan.scenario, result.summary
    happened = events(scenario, result.trace, summary, result.plan.actuators)
    measured = result.metrics.estimators
    readings = {name: m.nis_expected for name, m in measured.items() if m.nis_expected is not None}
    return FlightInfo.of(result.plan, readings=readings).with_result(
        run_card(scenario, summary),
        happened,
        departed=result.metrics.departed,
        alarmed=[name for name in measured if result.trace[f"{name}.alarms"].max() > 0.0],
    )


def recording_of(folder: str | Path) -> Path:
    """Return the recording in the folder of a run or a comparison. Raises OutputError."""
    compared = Path(folder) / "comparison.rrd"
    if compared.is_file():
        return compared
    recording = folder_of(folder) / "flight.rrd"
    if not recording.is_file():
        raise OutputError(f"{recording}: there is no recording; fly the scenario again with --rerun save")
    return recording
