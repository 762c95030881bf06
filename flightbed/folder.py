"""A run's folder: written whole or not at all."""

from __future__ import annotations

import errno
import hashlib
import json
import tempfile
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING

from flightbed.card import events, run_card
from flightbed.errors import OutputError

if TYPE_CHECKING:
    from flightbed.mission import Result

_FILES = ("scenario.toml", "trace.parquet", "metrics.json", "flight.rrd", "report.html")


def check_target(target: Path, *, replace: bool) -> Path:
    """Refuse a target that would lose something, and one that cannot be written, before flying."""
    try:
        target = target.resolve() if target.is_symlink() else target
        if Path.cwd().is_relative_to(target.absolute()):
            raise OutputError(f"--out {target}: is the folder you are in; name a folder of its own")
        if replace and target.exists() and not target.is_dir():
            raise OutputError(f"--out {target}: is a file; name a folder")
        if replace and target.is_dir():
            strangers = sorted(p.name for p in target.iterdir() if p.name not in _FILES)
            if strangers:
                raise OutputError(f"--out {target}: holds '{strangers[0]}', which is not from a run; name a new folder")
        parent = next(p for p in target.absolute().parents if p.exists())
        tempfile.TemporaryDirectory(dir=parent, prefix=".flightbed-").cleanup()
    except OSError as error:
        raise OutputError(f"--out {target}: cannot be written: {error.strerror}") from None
    return target


def write_run(result: Result, target: Path, *, rerun: bool, replace: bool) -> Path:
    """Write beside the target and move into place: the folder appears whole or not at all. Returns where it went."""
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(
            dir=target.parent, prefix=f".{target.name}.", ignore_cleanup_errors=True
        ) as scratch:
            new = Path(scratch) / "new"
            new.mkdir()
            (new / "scenario.toml").write_text(result.plan.scenario.to_toml(), encoding="utf-8")
            (new / "metrics.json").write_text(
                json.dumps(result.summary, indent=2, allow_nan=False) + "\n", encoding="utf-8"
            )
            result.trace.write(new / "trace.parquet")
            if rerun:
                _record(result, new / "flight.rrd")
            if not replace:
                return _first_free(target, new)
            _replace(target, new, Path(scratch) / "old")
            return target
    except OSError as error:
        raise OutputError(f"--out {target}: cannot be written: {error.strerror or error}") from None


def _first_free(target: Path, new: Path) -> Path:
    """Move ``new`` to the first free one of TARGET, TARGET-2, ...; runs that end at once take one each."""
    for number in count(1):
        place = target if number == 1 else target.with_name(f"{target.name}-{number}")
        if place.exists():
            continue
        try:
            return new.rename(place)
        except OSError as error:
            if error.errno not in (errno.ENOTEMPTY, errno.EEXIST, errno.ENOTDIR):
                raise
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


def _record(result: Result, path: Path) -> None:
    from flightbed.telemetry import Event, write_recording  # slow to import

    scenario, summary = result.plan.scenario, result.summary
    happened = events(scenario, result.trace, summary, result.plan.aircraft.actuator)
    write_recording(
        path,
        result.trace,
        name=f"{scenario.name} seed {scenario.seed}",
        recording_id=hashlib.sha256(scenario.to_toml().encode()).hexdigest()[:16],
        card=run_card(scenario, summary),
        events=[Event(*event) for event in happened],
        failed_at_s=summary["failed_at_s"],
    )


def folder_of(run_folder: str | Path) -> Path:
    """Return a run's folder after checking that it is one. Raises OutputError."""
    folder = Path(run_folder)
    if not (folder / "metrics.json").is_file():
        raise OutputError(f"{folder}: not a run's folder (no metrics.json)")
    return folder
