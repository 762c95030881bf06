"""Folders of runs, studies and comparisons, written atomically; the folder of a campaign grows, see journal.py."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from flightbed.card import run_card
from flightbed.comparison import folder_of
from flightbed.errors import OutputError
from flightbed.event_log import events
from flightbed.pacing import heap_set_aside

if TYPE_CHECKING:
    from flightbed.flight_result import Result
    from flightbed.telemetry.shown import FlightInfo


class FolderKind(NamedTuple):
    """A kind of folder that flightbed writes, and the names of the files in it."""

    name: str
    files: frozenset[str]


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


def check_target(target: Path, kind: FolderKind, *, replace: bool, scratch: frozenset[str] = frozenset()) -> Path:
    """Refuse, before flying, a target with other files in it, and one that cannot be written. Raises OutputError.

    Args:
        target: the folder.
        kind: the kind of folder to be written.
        replace: replace a folder of that name, if it holds only files of its kind.
        scratch: further names that a folder of this kind may hold while it is unfinished.

    """
    try:
        target = target.resolve() if target.is_symlink() else target
        if Path.cwd().is_relative_to(os.path.realpath(target)):
            raise OutputError(f"--out {target}: is the folder you are in; name a folder of its own")
        if replace and target.exists() and not target.is_dir():
            raise OutputError(f"--out {target}: is a file; name a folder")
        if replace and target.is_dir():
            strangers = sorted(p.name for p in target.iterdir() if p.name not in kind.files | scratch)
            if strangers:
                raise OutputError(
                    f"--out {target}: holds '{strangers[0]}', which is not from a {kind.name}; name a new folder"
                )
        parent = next(p for p in target.absolute().parents if p.exists())
        tempfile.TemporaryDirectory(dir=parent, prefix=".flightbed-").cleanup()
    except OSError as error:
        raise OutputError(f"--out {target}: cannot be written: {error.strerror}") from None
    return target


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


def to_json(values: dict[str, Any]) -> str:
    """Return plain values as the text of a JSON file."""
    return json.dumps(values, indent=2, allow_nan=False) + "\n"


def put_whole(path: Path, write: Callable[[Path], None]) -> None:
    """Write a file atomically: ``write`` fills a temporary file beside it, which is then renamed. Raises OSError."""
    scratch = path.with_name(f"{path.name}.tmp")
    write(scratch)
    scratch.replace(path)


def write_folder(target: Path, write: Callable[[Path], None], *, replace: bool) -> Path:
    """Write a folder atomically: ``write`` fills a temporary folder beside the target, which is then renamed."""
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
    """Rename ``new`` to the target; an exception in between restores the old folder.

    Only a kill -9 between the two renames leaves the target missing; both folders are then complete in the hidden folder beside it.
    """
    if target.exists():
        target.rename(old)
    try:
        new.rename(target)
    finally:
        if old.exists() and not target.exists():
            old.rename(target)


def _page(result: Result) -> str:
    with heap_set_aside():  # drawing creates many objects: garbage collection would double its time
        from flightbed.page import render
        from flightbed.report import run_report  # slow to import

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
