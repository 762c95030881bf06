"""Folder of a run, written atomically; ``campaigns/journal.py`` writes the folder of a campaign in steps."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from flightbed.analysis.comparison import folder_of
from flightbed.core.errors import OutputError
from flightbed.core.files import FolderKind, frozen_heap, to_json, write_folder
from flightbed.telemetry.flight_info import result_info

if TYPE_CHECKING:
    from flightbed.analysis.result import Result


RUN = FolderKind("run", frozenset({"scenario.toml", "trace.parquet", "metrics.json", "flight.rrd", "report.html"}))


def write_run(result: Result, target: Path, *, rerun: bool, report: bool, replace: bool) -> Path:
    """Write the folder of a run, with recording and report if requested; returns its path."""

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
    with frozen_heap():  # drawing creates many objects: garbage collection would double its time
        from flightbed.document.html import render
        from flightbed.report.flight_report import run_report  # slow to import

        return render(run_report(result))


def _record(result: Result, path: Path) -> None:
    from flightbed.telemetry.recording import write_recording  # slow to import

    write_recording(path, result.trace, result_info(result))


def _is_file(path: Path) -> bool:
    """Return whether a path is a file; false for a name that the system does not accept."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def recording_of(folder: str | Path) -> Path:
    """Return the recording in the folder of a run or a comparison. Raises OutputError."""
    compared = Path(folder) / "comparison.rrd"
    if _is_file(compared):
        return compared
    recording = folder_of(folder) / "flight.rrd"
    if not recording.is_file():
        raise OutputError(f"{recording}: there is no recording; fly the scenario again with --rerun save")
    return recording
