"""Folders of runs, studies and comparisons, each written atomically. Folders of campaigns grow, see journal.py."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Callable, Iterator, Sequence
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flightbed.card import run_card
from flightbed.errors import OutputError
from flightbed.event_log import events
from flightbed.pacing import heap_set_aside

if TYPE_CHECKING:
    from flightbed.comparison import Run
    from flightbed.document import Document
    from flightbed.mission import Result
    from flightbed.telemetry.shown import Shown

RUN_FILES = frozenset({"scenario.toml", "trace.parquet", "metrics.json", "flight.rrd", "report.html"})
CAMPAIGN_FILES = frozenset(
    {"scenario.toml", "campaign.toml", "table.parquet", "summary.json", "report.html", "histories.parquet", "traces"}
)
STUDY_FILES = frozenset({"report.html", "results.json"})
COMPARISON_FILES = frozenset({"comparison.rrd", "comparison.json", "report.html"})
_KINDS = {RUN_FILES: "run", STUDY_FILES: "study", COMPARISON_FILES: "comparison"}  # others are campaigns'


def check_target(target: Path, *, replace: bool, files: frozenset[str] = RUN_FILES) -> Path:
    """Refuse a target that would lose something, and one that cannot be written, before flying.

    Args:
        target: the folder.
        replace: whether a folder of that name is to be replaced; only one that holds nothing but ``files`` is.
        files: what folders of this kind hold.

    """
    try:
        target = target.resolve() if target.is_symlink() else target
        if Path.cwd().is_relative_to(os.path.realpath(target)):
            raise OutputError(f"--out {target}: is the folder you are in; name a folder of its own")
        if replace and target.exists() and not target.is_dir():
            raise OutputError(f"--out {target}: is a file; name a folder")
        if replace and target.is_dir():
            strangers = sorted(p.name for p in target.iterdir() if p.name not in files)
            if strangers:
                raise OutputError(
                    f"--out {target}: holds '{strangers[0]}', which is not from a {_KINDS.get(files, 'campaign')}; name a new folder"
                )
        parent = next(p for p in target.absolute().parents if p.exists())
        tempfile.TemporaryDirectory(dir=parent, prefix=".flightbed-").cleanup()
    except OSError as error:
        raise OutputError(f"--out {target}: cannot be written: {error.strerror}") from None
    return target


def write_run(result: Result, target: Path, *, rerun: bool, report: bool, replace: bool) -> Path:
    """Write the folder of a run, with a recording and a report if asked for; returns where it went."""

    def write(new: Path) -> None:
        (new / "scenario.toml").write_text(result.plan.scenario.to_toml(), encoding="utf-8")
        (new / "metrics.json").write_text(to_json(result.summary), encoding="utf-8")
        result.trace.write(new / "trace.parquet")
        if rerun:
            _record(result, new / "flight.rrd")
        if report:
            (new / "report.html").write_text(_page(result), encoding="utf-8")

    return _write(target, write, replace=replace)


def write_study(document: Document, target: Path, *, replace: bool) -> Path:
    """Write the folder of a study, its page and its numbers; returns where it went."""
    from flightbed.page import render

    def write(new: Path) -> None:
        (new / "report.html").write_text(render(document), encoding="utf-8")
        (new / "results.json").write_text(to_json(document.to_dict()), encoding="utf-8")

    return _write(target, write, replace=replace)


def write_comparison(runs: Sequence[Run], document: Document, target: Path, *, replace: bool) -> Path:
    """Write the folder of a comparison, its recording, its page and its numbers; returns where it went."""
    from flightbed.comparison import to_dict
    from flightbed.page import render
    from flightbed.telemetry.comparing import write_comparison as record

    def write(new: Path) -> None:
        (new / "report.html").write_text(render(document), encoding="utf-8")
        (new / "comparison.json").write_text(to_json(to_dict(runs)), encoding="utf-8")
        record(new / "comparison.rrd", runs, tables=document.tables())

    return _write(target, write, replace=replace)


def to_json(values: dict[str, Any]) -> str:
    """Return a file of plain values."""
    return json.dumps(values, indent=2, allow_nan=False) + "\n"


def put_whole(path: Path, write: Callable[[Path], None]) -> None:
    """Have a file written beside its place and moved there: whole or not at all. Raises OSError."""
    scratch = path.with_name(f"{path.name}.tmp")
    write(scratch)
    scratch.replace(path)


def _write(target: Path, write: Callable[[Path], None], *, replace: bool) -> Path:
    """Write beside the target and move into place: the folder appears whole or not at all."""
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(
            dir=target.parent, prefix=f".{target.name}.", ignore_cleanup_errors=True
        ) as scratch:
            new = Path(scratch) / "new"
            new.mkdir()
            write(new)
            if not replace:
                return first_free(target, new.rename)
            _replace(target, new, Path(scratch) / "old")
            return target
    except OSError as error:
        raise OutputError(f"--out {target}: cannot be written: {error.strerror or error}") from None


def numbered(target: Path) -> Iterator[Path]:
    """Yield TARGET, TARGET-2, TARGET-3, ..."""
    yield target
    for number in count(2):
        yield target.with_name(f"{target.name}-{number}")


def first_free(target: Path, make: Callable[[Path], object]) -> Path:
    """Make the first of TARGET, TARGET-2, ... that does not exist; processes that do so at once make one each.

    Args:
        target: the first path.
        make: creates a folder at a path; raises OSError if the path exists.

    Raises:
        OSError: the folder cannot be made for another reason.

    """
    for place in numbered(target):
        if not os.path.lexists(place):
            try:
                make(place)
            except OSError:
                if not os.path.lexists(place):
                    raise
                continue
            return place
    raise AssertionError


def _replace(target: Path, new: Path, old: Path) -> None:
    """Put ``new`` in the target's place; an exception on the way puts the old run back.

    Only a kill -9 between the two renames leaves the target missing; both runs are then whole, in the hidden folder beside it.
    """
    if target.exists():
        target.rename(old)
    try:
        new.rename(target)
    finally:
        if old.exists() and not target.exists():
            old.rename(target)


def _page(result: Result) -> str:
    with heap_set_aside():  # drawing makes many objects: without this, looking for garbage takes as long as the drawing
        from flightbed.page import render
        from flightbed.report import run_report  # slow to import

        return render(run_report(result))


def _record(result: Result, path: Path) -> None:
    from flightbed.telemetry.recording import write_recording  # slow to import

    write_recording(path, result.trace, shown(result))


def shown(result: Result) -> Shown:
    """Return what the viewer is told of a flight that is over."""
    from flightbed.telemetry.shown import Shown

    scenario, summary = result.plan.scenario, result.summary
    happened = events(scenario, result.trace, summary, result.plan.actuators)
    measured = result.metrics.estimators
    readings = {name: m.nis_expected for name, m in measured.items() if m.nis_expected is not None}
    return Shown.of(result.plan, readings=readings).flown(
        run_card(scenario, summary),
        happened,
        departed=result.metrics.departed,
        alarmed=[name for name in measured if result.trace[f"{name}.alarms"].max() > 0.0],
    )


def folder_of(run_folder: str | Path) -> Path:
    """Return a run's folder after checking that it is one. Raises OutputError."""
    folder = Path(run_folder)
    if not (folder / "metrics.json").is_file():
        raise OutputError(f"{folder}: not a run's folder (no metrics.json)")
    return folder


def recording_of(folder: str | Path) -> Path:
    """Return the recording in the folder of a run or a comparison. Raises OutputError."""
    compared = Path(folder) / "comparison.rrd"
    if compared.is_file():
        return compared
    recording = folder_of(folder) / "flight.rrd"
    if not recording.is_file():
        raise OutputError(f"{recording}: there is no recording; fly the scenario again with --rerun save")
    return recording
