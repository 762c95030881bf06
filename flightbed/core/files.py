"""Files and folders written atomically, and the check of a target folder before a flight."""

from __future__ import annotations

import gc
import json
import os
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from itertools import count
from pathlib import Path
from typing import Any, NamedTuple

from flightbed.core.errors import OutputError


class FolderKind(NamedTuple):
    """A kind of folder that flightbed writes, and the names of the files in it."""

    name: str
    files: frozenset[str]


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
            others = sorted(p.name for p in target.iterdir() if p.name not in kind.files | scratch)
            if others:
                raise OutputError(
                    f"--out {target}: holds '{others[0]}', which is not from a {kind.name}; name a new folder"
                )
        parent = next(p for p in target.absolute().parents if p.exists())
        tempfile.TemporaryDirectory(dir=parent, prefix=".flightbed-").cleanup()
    except OSError as error:
        raise OutputError(f"--out {target}: cannot be written: {error.strerror}") from None
    return target


def to_json(values: dict[str, Any]) -> str:
    """Return plain values as the text of a JSON file."""
    return json.dumps(values, indent=2, allow_nan=False) + "\n"


def replace_file(path: Path, write: Callable[[Path], None]) -> None:
    """Write a file inside a folder of flightbed atomically: ``write`` fills NAME.tmp beside it, which is then renamed. Raises OSError."""
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


def numbered_paths(target: Path) -> Iterator[Path]:
    """Yield TARGET, TARGET-2, TARGET-3, ..."""
    yield target
    for number in count(2):
        yield target.with_name(f"{target.name}-{number}")


def first_free(target: Path, make: Callable[[Path], object]) -> Path:
    """Make the first of TARGET, TARGET-2, ... that does not exist; concurrent processes make one each.

    Args:
        target: the first path.
        make: creates a folder at a path; raises OSError if the path exists.

    Raises:
        OSError: the folder cannot be made for another reason.

    """
    for place in numbered_paths(target):
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


def cache_folder() -> Path:
    """Return the folder of files that flightbed makes again if they are gone: ``$XDG_CACHE_HOME/flightbed``, ``~/.cache/flightbed``.

    Raises OSError if the user has no home folder.
    """
    root = os.environ.get("XDG_CACHE_HOME", "")
    try:
        return (Path(root) if root else Path.home() / ".cache") / "flightbed"
    except RuntimeError as error:
        raise FileNotFoundError(str(error)) from None


def write_cached(path: Path, content: bytes, *, pattern: str, most_bytes: int) -> None:
    """Write a file of a cache atomically, its folder too, then remove the least recently used files of a size too large.

    Args:
        path: the file.
        content: its content.
        pattern: of the names of all files of this cache in its folder.
        most_bytes: size of these files that remains.

    Raises:
        OSError: the file cannot be written.

    """
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, scratch = tempfile.mkstemp(dir=path.parent, prefix=f"{path.stem}.", suffix=path.suffix)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content)
        Path(scratch).replace(path)
    except BaseException:
        Path(scratch).unlink(missing_ok=True)
        raise
    _remove_least_used(path.parent, pattern, most_bytes)


def _remove_least_used(folder: Path, pattern: str, most_bytes: int) -> None:
    """Remove files, the oldest first, until those that remain have at most ``most_bytes``; other processes may do the same."""
    found = []
    for path in folder.glob(pattern):
        with suppress(OSError):  # another process has removed it
            stat = path.stat()
            found.append((stat.st_mtime, stat.st_size, path))
    excess = sum(size for _, size, _ in found) - most_bytes
    for _, size, path in sorted(found):
        if excess <= 0:
            return
        with suppress(OSError):
            path.unlink()
        excess -= size


def touch_used(path: Path) -> None:
    """Mark a file of a cache as used now."""
    with suppress(OSError):
        os.utime(path)


@contextmanager
def frozen_heap() -> Iterator[None]:
    """Exclude all existing objects from garbage collections inside the ``with`` block: scanning the imported libraries takes 0.1 s."""
    if gc.get_freeze_count():  # the caller has frozen the heap already and unfreezes it
        yield
        return
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()


def write_atomic(path: Path, content: bytes, *, option: str = "-o") -> None:
    """Write a file that the user names atomically, with the user's permissions; ``option`` names it in errors. Raises OutputError."""
    try:
        handle, scratch = tempfile.mkstemp(dir=path.absolute().parent, prefix=f".{path.name}.")
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(content)
            Path(scratch).chmod(0o666 & ~_umask())
            Path(scratch).replace(path)
        except BaseException:
            Path(scratch).unlink(missing_ok=True)
            raise
    except OSError as error:
        raise OutputError(f"{option} {path}: cannot be written: {error.strerror}") from None


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
