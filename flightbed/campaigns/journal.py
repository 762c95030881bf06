"""Folder of a campaign in progress: finished chunks are on disk, and a partly written chunk after a kill or a full disk is flown again.

The folder ``unfinished/`` marks an unfinished campaign. It holds ``campaign.json`` (name and fingerprint of the campaign), ``rows.jsonl``
(one line per flight with its checksum, in the order of arrival), and the files of ``campaigns/histories.py``. A chunk is done if all its
rows and its histories are there. Chunks have ``executor.CHUNK`` flights: a folder can be continued only with the same chunk size.
"""

from __future__ import annotations

import json
import os
import shutil
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any, TypeGuard
from zlib import crc32

from flightbed.campaigns.histories import Histories
from flightbed.campaigns.plan import Programme
from flightbed.campaigns.table import Row
from flightbed.campaigns.worker import ChunkResult
from flightbed.core.errors import InputError, OutputError
from flightbed.core.files import FolderKind, check_target, first_free, numbered_paths, replace_file
from flightbed.parallel.executor import CHUNK

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


UNFINISHED = "unfinished"
_DONE = ".finished"  # new name of UNFINISHED while it is deleted


class Journal:
    """Finished flights of a programme on disk.

    Attributes:
        target: the campaign's folder.
        done: number of finished flights.
        missing: numbers of the unfinished chunks.
        histories: histories of the finished chunks.

    """

    def __init__(self, target: Path, programme: Programme) -> None:
        self.target = target
        self._programme = programme
        self._folder = target / UNFINISHED
        self._rows: IO[bytes] = _open_locked(self._folder / "rows.jsonl")
        try:
            indices = {row["index"] for row in self._stored()}
            self._rows.truncate(self._whole_bytes)
            self._rows.seek(0, os.SEEK_END)
            self.histories = Histories(programme, self._folder)
        except BaseException:
            self._rows.close()
            raise
        chunks = range(-(-len(programme) // CHUNK))
        self.missing = [n for n in chunks if not self._is_done(n, indices)]
        self.done = len(programme) - sum(len(self._range(n)) for n in self.missing)

    def _range(self, number: int) -> range:
        return range(number * CHUNK, min((number + 1) * CHUNK, len(self._programme)))

    def _is_done(self, number: int, indices: set[Any]) -> bool:
        return all(i in indices for i in self._range(number)) and self.histories.has(number)

    def _stored(self) -> Iterator[Row]:
        """Yield the rows on disk, up to the first incomplete line."""
        self._rows.seek(0)
        self._whole_bytes = 0
        for line in self._rows:
            found = _row_of(line)
            if not self._is_row(found):
                return
            self._whole_bytes += len(line)
            yield {sys.intern(name): value for name, value in found.items()}  # all rows share the strings of their keys

    def _is_row(self, found: Any) -> TypeGuard[dict[str, Any]]:
        """Return whether a stored value can be the row of a flight of this programme."""
        return (
            isinstance(found, dict) and type(found.get("index")) is int and 0 <= found["index"] < len(self._programme)
        )

    def add(self, number: int, result: ChunkResult) -> None:
        """Write a chunk to disk. Raises OutputError; earlier chunks stay unchanged."""
        try:
            if self.done == 0:
                self._clear()
            self.histories.add(number, result.parts)
            self._rows.write(b"".join(map(_line_of, result.rows)))
            self._rows.flush()
            os.fsync(self._rows.fileno())
        except OSError as error:
            raise OutputError(f"--out {self.target}: cannot be written: {error.strerror or error}") from None
        self.done += len(result.rows)

    def _clear(self) -> None:
        """Delete the files of an earlier campaign."""
        for name in CAMPAIGN.files:
            if (self.target / name).is_dir():
                shutil.rmtree(self.target / name)
            else:
                (self.target / name).unlink(missing_ok=True)

    def discard(self) -> None:
        """Delete the files of a campaign without a finished flight."""
        self._rows.close()
        shutil.rmtree(self._folder, ignore_errors=True)
        with suppress(OSError):  # the folder holds an earlier campaign
            self.target.rmdir()

    def rows(self) -> list[Row]:
        """Return the rows of all finished flights, in the order of their indices."""
        found = {int(row["index"] or 0): row for row in self._stored()}
        return [found[index] for index in sorted(found)]

    def put(self, name: str, write: Callable[[Path], None]) -> None:
        """Write a file into the campaign's folder atomically. Raises OutputError."""
        scratch = self._folder / f"{Path(name).name}.tmp"
        try:
            write(scratch)
            (self.target / name).parent.mkdir(exist_ok=True)
            scratch.replace(self.target / name)
        except OSError as error:
            scratch.unlink(missing_ok=True)
            raise OutputError(f"--out {self.target}: cannot be written: {error.strerror or error}") from None

    def finish(self) -> None:
        """Mark the campaign as finished: delete ``unfinished/``."""
        self._rows.close()
        away = self.target / _DONE
        shutil.rmtree(away, ignore_errors=True)
        self._folder.rename(away)
        shutil.rmtree(away, ignore_errors=True)

    def close(self) -> None:
        """Release the folder for other processes."""
        self._rows.close()


@contextmanager
def journal(out: Path, programme: Programme, *, replace: bool, resume: bool) -> Iterator[Journal | Path]:
    """Open the folder of a campaign; yields its journal, or only its path if the same campaign is finished there.

    Args:
        out: the folder.
        programme: the flights.
        replace: replace a finished campaign in OUT; if false, use the first of OUT, OUT-2, ... that does not exist.
        resume: continue this campaign; start it if the folder has none. Without ``replace``, continue in the first of OUT, OUT-2, ...
            that holds this campaign unfinished, otherwise finished.

    Raises:
        OutputError: the folder cannot be written, or holds other files; InputError: it holds another campaign.

    """
    if resume:
        target = out if replace else _own_folder(out, programme)
        state = _state(target)
        if state is not None and state.get("campaign") != programme.fingerprint:
            raise InputError(f"--resume: {target} holds {_difference(state, programme)}")
        if (target / "summary.json").is_file() and state is not None and not (target / UNFINISHED).is_dir():
            yield target
            return
    else:
        target, state = out, None
        if replace and (target / UNFINISHED).is_dir():
            raise InputError(
                f"--out {target}: holds an unfinished campaign; continue it with --resume, delete it, or name another folder"
            )
    target = check_target(target, CAMPAIGN, replace=replace, scratch=frozenset({UNFINISHED, _DONE}))
    try:
        if state is None:
            target = _start(target, programme, replace=replace)
        book = Journal(target, programme)
    except OSError as error:
        raise OutputError(f"--out {target}: cannot be written: {error.strerror or error}") from None
    try:
        yield book
    finally:
        book.close()


def _start(target: Path, programme: Programme, *, replace: bool) -> Path:
    """Make the folder of a new campaign; files of an earlier one stay until the first chunk is finished. Raises OSError."""
    if replace:
        target.mkdir(parents=True, exist_ok=True)
    else:
        target.parent.mkdir(parents=True, exist_ok=True)
        target = first_free(target, Path.mkdir)
    known = {"campaign": programme.fingerprint, "name": programme.name, "flights": len(programme), **programme.sources}
    (target / UNFINISHED).mkdir(exist_ok=True)
    replace_file(target / UNFINISHED / "campaign.json", lambda path: _write(path, json.dumps(known, indent=2) + "\n"))
    return target


def _own_folder(out: Path, programme: Programme) -> Path:
    """Return the one of OUT, OUT-2, ... with this campaign, preferably unfinished.

    Otherwise the first unfinished one of the same name and length that other sources started, which cannot be continued; otherwise the
    first that does not exist.
    """
    finished = other = None
    for place in numbered_paths(out):
        if not place.exists():
            return finished or other or place
        state = _state(place)
        if state is not None and (place / UNFINISHED).is_dir() and _other_sources(state, programme):
            other = other or place
        if state is not None and state.get("campaign") == programme.fingerprint:
            if (place / UNFINISHED).is_dir():
                return place
            finished = finished or place
    raise AssertionError


def _line_of(row: Row) -> bytes:
    """Return the line of a row: CRC-32 of its JSON in eight hexadecimal digits, a space, and the JSON."""
    text = json.dumps(row).encode()
    return b"%08x %s\n" % (crc32(text), text)


def _row_of(line: bytes) -> Any:
    """Return the row of a line; None for a line that is incomplete, damaged, or without checksum (version 0.1): it is flown again."""
    checksum, _, text = line.removesuffix(b"\n").partition(b" ")
    if not line.endswith(b"\n") or checksum != b"%08x" % crc32(text):
        return None
    return json.loads(text)


def _state(target: Path) -> dict[str, Any] | None:
    """Return the stored facts of the campaign in a folder, finished or not; None without a campaign."""
    for name in (f"{UNFINISHED}/campaign.json", "summary.json"):
        try:
            found = json.loads((target / name).read_text(encoding="utf-8"))
        except (OSError, ValueError, RecursionError):
            continue
        if isinstance(found, dict):
            return found
    return None


def _difference(state: dict[str, Any], programme: Programme) -> str:
    name, flights = state.get("name", state.get("scenario", "?")), state.get("flights", "?")
    campaign, cure = f"campaign '{name}' ({flights} flights)", "name another folder with --out"
    if (name, flights) != (programme.name, len(programme)):
        return f"{campaign}, not this campaign '{programme.name}' ({len(programme)} flights); {cure}"
    if other := _other_sources(state, programme):
        return (
            f"{campaign}, which was started by other sources: {other}; fly it anew ({cure}), or restore those sources"
        )
    return f"{campaign} with other settings, aircraft or versions; {cure}"


def _other_sources(state: dict[str, Any], programme: Programme) -> str:
    """Return which sources differ from those of a stored campaign of the same name and length; empty if none do."""
    if (state.get("name"), state.get("flights")) != (programme.name, len(programme)) or "source_sha256" not in state:
        return ""
    found, now = [], programme.sources
    if state["source_sha256"] != now["source_sha256"]:
        found.append(f"flightbed (got {now['source_sha256'][:12]}, there {str(state['source_sha256'])[:12]})")
    for key in ("extensions", "plug_ins"):
        stored = state.get(key)
        for name, ours in now[key].items():
            theirs = stored.get(name) if isinstance(stored, dict) else None
            if theirs is not None and theirs != ours:
                found.append(f"{name}{_changed_file(theirs, ours)}")
    return ", ".join(found)


def _changed_file(theirs: Any, ours: Any) -> str:
    """Return the first imported file that differs between two identities of own code, in brackets; empty if the code itself differs."""
    if not isinstance(theirs, dict) or not isinstance(ours, dict) or theirs.get("sha256") != ours.get("sha256"):
        return ""
    before, now = theirs.get("imports"), ours.get("imports")
    if not isinstance(before, dict) or not isinstance(now, dict):
        return ""
    return next((f" ({file})" for file in sorted({*before, *now}) if before.get(file) != now.get(file)), "")


def _open_locked(path: Path) -> IO[bytes]:
    """Open the rows for reading and writing, and lock them for this process. Raises OutputError."""
    file = path.open("a+b")
    try:
        import fcntl

        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        file.close()
        raise OutputError(
            f"--out {path.parent.parent}: another process is flying this campaign; wait for its end, or name "
            "another folder"
        ) from None
    except (ImportError, OSError):  # a system or a disk without locks
        pass
    return file


def _write(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8")
