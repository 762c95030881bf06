"""The folder of a campaign that is being flown: what is done is on disk, and nothing that a kill or a full disk leaves is taken for done.

``unfinished/`` in the campaign's folder says that it is unfinished, and holds ``campaign.json`` (which campaign), ``rows.jsonl`` (a line a
flight, in the order in which they came), and what ``campaign_histories.py`` keeps. A chunk is done if all its rows are there, and its
histories.
"""

from __future__ import annotations

import json
import os
import shutil
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from itertools import count
from pathlib import Path
from typing import IO, Any

from flightbed.campaign_flights import CHUNK, Flown
from flightbed.campaign_histories import Histories
from flightbed.campaign_table import Row
from flightbed.errors import InputError, OutputError
from flightbed.folder import CAMPAIGN, check_target, put_whole
from flightbed.programme import Programme

UNFINISHED = "unfinished"
_DONE = ".finished"  # what was unfinished, on its way to be deleted


class Journal:
    """What is done of a programme, in the folder ``target``.

    Attributes:
        target: the campaign's folder.
        done: flights that need not be flown again.

    """

    def __init__(self, target: Path, programme: Programme) -> None:
        self.target = target
        self._programme = programme
        self._folder = target / UNFINISHED
        self._rows: IO[bytes] = _locked(self._folder / "rows.jsonl")
        indices = {row["index"] for row in self._stored()}
        self._rows.truncate(self._whole_bytes)
        self._rows.seek(0, os.SEEK_END)
        self.histories = Histories(programme, self._folder)
        chunks = range(-(-len(programme) // CHUNK))
        self.missing = [n for n in chunks if not self._is_done(n, indices)]
        self.done = len(programme) - sum(len(self._range(n)) for n in self.missing)

    def _range(self, number: int) -> range:
        return range(number * CHUNK, min((number + 1) * CHUNK, len(self._programme)))

    def _is_done(self, number: int, indices: set[Any]) -> bool:
        return all(i in indices for i in self._range(number)) and self.histories.has(number)

    def _stored(self) -> Iterator[Row]:
        """Yield the rows on disk, up to a line that is not whole."""
        self._rows.seek(0)
        self._whole_bytes = 0
        for line in self._rows:
            try:
                found = json.loads(line) if line.endswith(b"\n") else None
            except ValueError:
                found = None
            if not isinstance(found, dict):
                return
            self._whole_bytes += len(line)
            yield {sys.intern(name): value for name, value in found.items()}  # one text for all rows

    def add(self, number: int, flown: Flown) -> None:
        """Keep a chunk: on disk when it returns. Raises OutputError; what was kept before stays as it was."""
        try:
            if self.done == 0:
                self._clear()
            self.histories.add(number, flown.parts)
            self._rows.write("".join(json.dumps(row) + "\n" for row in flown.rows).encode())
            self._rows.flush()
            os.fsync(self._rows.fileno())
        except OSError as error:
            raise OutputError(f"--out {self.target}: cannot be written: {error.strerror or error}") from None
        self.done += len(flown.rows)

    def _clear(self) -> None:
        """Take away what an earlier campaign has left in the folder."""
        for name in CAMPAIGN.files:
            if (self.target / name).is_dir():
                shutil.rmtree(self.target / name)
            else:
                (self.target / name).unlink(missing_ok=True)

    def discard(self) -> None:
        """Leave no trace of a campaign of which nothing was kept."""
        self._rows.close()
        shutil.rmtree(self._folder, ignore_errors=True)
        with suppress(OSError):  # it holds an earlier one
            self.target.rmdir()

    def rows(self) -> list[Row]:
        """Return the rows of all flights that are done, in the order of their indices."""
        found = {int(row["index"] or 0): row for row in self._stored()}
        return [found[index] for index in sorted(found)]

    def put(self, name: str, write: Callable[[Path], None]) -> None:
        """Put a file into the campaign's folder, whole or not at all. Raises OutputError."""
        scratch = self._folder / f"{Path(name).name}.tmp"
        try:
            write(scratch)
            (self.target / name).parent.mkdir(exist_ok=True)
            scratch.replace(self.target / name)
        except OSError as error:
            scratch.unlink(missing_ok=True)
            raise OutputError(f"--out {self.target}: cannot be written: {error.strerror or error}") from None

    def finish(self) -> None:
        """Say that all is there: nothing in the folder tells of an unfinished campaign any more."""
        self._rows.close()
        away = self.target / _DONE
        shutil.rmtree(away, ignore_errors=True)
        self._folder.rename(away)
        shutil.rmtree(away, ignore_errors=True)

    def close(self) -> None:
        """Let others go on with the folder."""
        self._rows.close()


@contextmanager
def journal(out: Path, programme: Programme, *, replace: bool, resume: bool) -> Iterator[Journal | Path]:
    """Open the folder of a campaign, new or to be gone on with; gives the folder alone if that very campaign is finished there.

    Args:
        out: the folder.
        programme: what is to be flown.
        replace: whether a finished campaign of that name is replaced; if false, the first free one of OUT, OUT-2, ... is taken.
        resume: go on with what is there of this campaign; begins if there is nothing. Without ``replace`` the first of OUT, OUT-2, ...
            that holds this campaign unfinished, or else finished.

    Raises:
        OutputError: the folder cannot be written, or would lose something; InputError: it is another campaign's.

    """
    if resume:
        target = out if replace else _mine(out, programme)
        state = _state(target)
        if state is not None and state.get("campaign") != programme.fingerprint:
            raise InputError(f"--resume: {target} {_differs(state, programme)}; name its own folder with --out")
        if (target / "summary.json").is_file() and state is not None and not (target / UNFINISHED).is_dir():
            yield target
            return
    else:
        target, state = out, None
        if replace and (target / UNFINISHED).is_dir():
            raise InputError(
                f"--out {target}: holds an unfinished campaign; go on with it, --resume, or delete it, or name another folder"
            )
    target = check_target(target, CAMPAIGN, replace=replace, scratch=frozenset({UNFINISHED, _DONE}))
    try:
        if state is None:
            target = _begin(target, programme, replace=replace)
        book = Journal(target, programme)
    except OSError as error:
        raise OutputError(f"--out {target}: cannot be written: {error.strerror or error}") from None
    try:
        yield book
    finally:
        book.close()


def _begin(target: Path, programme: Programme, *, replace: bool) -> Path:
    """Make the folder of a campaign that begins; what an earlier one left in it stays until flights are kept. Raises OSError."""
    if replace:
        target.mkdir(parents=True, exist_ok=True)
    else:
        target.parent.mkdir(parents=True, exist_ok=True)
        target = _first_free(target)
    known = {"campaign": programme.fingerprint, "name": programme.name, "flights": len(programme)}
    (target / UNFINISHED).mkdir(exist_ok=True)
    put_whole(target / UNFINISHED / "campaign.json", lambda path: _write(path, json.dumps(known, indent=2) + "\n"))
    return target


def _first_free(target: Path) -> Path:
    for number in count(1):
        place = target if number == 1 else target.with_name(f"{target.name}-{number}")
        with suppress(FileExistsError):
            place.mkdir()
            return place
    raise AssertionError


def _mine(out: Path, programme: Programme) -> Path:
    """Return the folder of this campaign among OUT, OUT-2, ...: one that is unfinished, else a finished one, else OUT or the next free."""
    finished = None
    for number in count(1):
        place = out if number == 1 else out.with_name(f"{out.name}-{number}")
        if not place.exists():
            return finished or place
        state = _state(place)
        if state is not None and state.get("campaign") == programme.fingerprint:
            if (place / UNFINISHED).is_dir():
                return place
            finished = finished or place
    raise AssertionError


def _state(target: Path) -> dict[str, Any] | None:
    """Return which campaign a folder holds, finished or not; None if there is none."""
    for name in (f"{UNFINISHED}/campaign.json", "summary.json"):
        try:
            found = json.loads((target / name).read_text(encoding="utf-8"))
        except (OSError, ValueError):
            continue
        if isinstance(found, dict):
            return found
    return None


def _differs(state: dict[str, Any], programme: Programme) -> str:
    name, flights = state.get("name", state.get("scenario", "?")), state.get("flights", "?")
    what = f"is that of '{name}' with {flights} flights"
    if (name, flights) == (programme.name, len(programme)):
        what += ", of another file, aircraft or version"
    return f"{what}, not of this campaign ('{programme.name}', {len(programme)} flights)"


def _locked(path: Path) -> IO[bytes]:
    """Open the rows for reading and writing, and keep other processes from it as long as this one lives. Raises OutputError."""
    file = path.open("a+b")
    try:
        import fcntl

        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        file.close()
        raise OutputError(f"--out {path.parent.parent}: another process is flying this campaign") from None
    except (ImportError, OSError):  # a system, or a disk, that has no locks
        pass
    return file


def _write(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8")
