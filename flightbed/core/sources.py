"""Digests of source files: of all of flightbed, and of one module with everything it imports, found without importing anything."""

from __future__ import annotations

import ast
import hashlib
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cache
from pathlib import Path
from time import time
from typing import NamedTuple

PACKAGE = Path(__file__).resolve().parents[1]
_IMPORTED_S = time()  # of this module, which a module with kernels imports before its own functions exist

# An import statement of flightbed's own sources: absolute, at the start of a line (tests/core/test_sources.py compares with ast).
_STATEMENT = re.compile(
    r"^[ \t]*(?:from[ \t]+(?P<module>[\w.]+)[ \t]+import[ \t]+(?P<names>\([^)]*\)|[^\n#]+)|import[ \t]+(?P<modules>[^\n#]+))", re.MULTILINE
)  # fmt: skip


class Imported(NamedTuple):
    """A module that a file imports: dotted name, and 0 for an absolute import, else the number of leading dots."""

    name: str
    level: int = 0


def normalized(source: bytes) -> bytes:
    """Return a source with the line ends of a checkout on Linux."""
    return source.replace(b"\r\n", b"\n")


def digest(files: Mapping[str, bytes]) -> str:
    """Return the SHA-256 of files by name: of the sorted names, each with the length of its content, and of the contents."""
    total = hashlib.sha256()
    for name, content in sorted(files.items()):
        total.update(f"{name}\0{len(content)}\0".encode())
        total.update(content)
    return total.hexdigest()


@cache
def source_sha256() -> str:
    """Return the digest of flightbed's sources, ``is_source``, equal in a source tree and in an installed wheel; read once per process."""
    files = {path.relative_to(PACKAGE).as_posix(): path for path in PACKAGE.rglob("*.*")}
    return digest({name: _read(path) for name, path in files.items() if is_source(name)})


def is_source(name: str) -> bool:
    """Return whether a file of the package is code or a table that code reads; shipped aircraft and scenarios are data of a flight."""
    return name.endswith((".py", ".toml")) and name.partition("/")[0] not in ("aircraft_data", "scenario_data")


@cache
def closure_sha256(*modules: str) -> str:
    """Return the digest of modules of flightbed and of all of flightbed that they import, directly or through others.

    Imports in functions and under ``TYPE_CHECKING`` count. ``flightbed/__init__.py`` does not: it imports every package, when asked.

    Raises:
        OSError: the sources are not files of a folder.
        SourcesChangedError: a file was edited after this process imported it, perhaps: its code is not that of the file.

    """
    starts = [_file(PACKAGE.parent, module) for module in modules]
    files = _reached((path for path in starts if path is not None), _of_flightbed)
    if None in starts:
        raise FileNotFoundError(f"no sources of {', '.join(modules)} below {PACKAGE.parent}")
    if any(_IMPORTED_S < path.stat().st_mtime <= time() for path in files):
        raise SourcesChangedError("sources of flightbed were edited while this process runs")
    return digest({path.relative_to(PACKAGE).as_posix(): _read(path) for path in files})


class SourcesChangedError(Exception):
    """Sources of flightbed were edited while this process runs."""


@cache
def _of_flightbed(path: Path) -> tuple[Path, ...]:
    if path == PACKAGE / "__init__.py":
        return ()
    names = (imported.name.split(".") for imported in quick_imports(_read(path).decode()))
    ours = {".".join(parts[:n]) for parts in names if parts[0] == "flightbed" for n in range(1, len(parts) + 1)}
    return tuple(file for name in sorted(ours) if (file := _module_of_flightbed(name)) is not None)


@cache
def _module_of_flightbed(name: str) -> Path | None:
    return _file(PACKAGE.parent, name)


def imports_sha256(start: Path, source: bytes, roots: Iterable[Path], *, only: str | None = None) -> Mapping[str, str]:
    """Return the files of ``own_closure`` without the first, by their paths below its folders -> SHA-256 of their sources.

    A file counts as it was when this process first read it: an imported module stays as it is, too.
    """
    folders = [root.resolve() for root in roots]
    found = {}
    for path in sorted(own_closure(start, source, folders, only=only) - {start.resolve()}):
        below = next(
            (folder for folder in (*folders, *start.resolve().parents) if path.is_relative_to(folder)), path.parent
        )
        found[path.relative_to(below).as_posix()] = hashlib.sha256(_read(path)).hexdigest()
    return found


def own_closure(start: Path, source: bytes, roots: Iterable[Path], *, only: str | None = None) -> frozenset[Path]:
    """Return a file from outside flightbed and the files that it imports from its own folders, directly or through others.

    Args:
        start: the file.
        source: its content.
        roots: folders in which absolute imports are looked up, the first that has the module.
        only: name of the only top-level module or package that counts, for a folder with many others; None: all.

    """
    folders, first = [root.resolve() for root in roots], start.resolve()

    def below(path: Path) -> Iterator[Path]:
        try:
            found = list(imports((source if path == first else _read(path)).decode()))
        except (SyntaxError, ValueError):  # of another Python version, or no text: its imports are not known
            return
        for name, level in found:
            top = name.partition(".")[0]
            if level:
                yield from _files(path.parents[level - 1], name)
            elif top != PACKAGE.name and only in (None, top):
                yield from next(filter(None, (list(_files(folder, name)) for folder in folders)), [])

    return _reached([first], below)


def _reached(starts: Iterable[Path], below: Callable[[Path], Iterable[Path]]) -> frozenset[Path]:
    reached, queue = set[Path](), list(starts)
    while queue:
        path = queue.pop()
        if path not in reached:
            reached.add(path)
            queue.extend(below(path))
    return frozenset(reached)


def quick_imports(source: str) -> Iterator[Imported]:
    """Yield the imports of a source in the style of flightbed; 20 times as fast as ``imports``."""
    for found in _STATEMENT.finditer(source):
        if found["module"]:
            names = re.sub(r"#[^\n]*", "", found["names"]).strip("() \n\t")
            yield from _with_names(found["module"], (name.split()[0] for name in names.split(",") if name.strip()))
        else:
            yield from (Imported(name.split()[0]) for name in found["modules"].split(",") if name.strip())


def imports(source: str) -> Iterator[Imported]:
    """Yield the imports of a source, relative ones too. Raises SyntaxError, ValueError."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (Imported(alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield from _with_names(node.module or "", (alias.name for alias in node.names), node.level)


def _with_names(module: str, names: Iterable[str], level: int = 0) -> Iterator[Imported]:
    """Yield a module, and each of its names, which may be modules in it."""
    yield Imported(module, level)
    yield from (Imported(f"{module}.{name}".lstrip("."), level) for name in names)


def _files(root: Path, name: str) -> Iterator[Path]:
    """Yield the files that the import of a module in a folder executes: of its packages, then its own, as far as they exist."""
    parts = name.split(".") if name else []
    for count in range(len(parts) + 1):
        found = _file(root, ".".join(parts[:count])) if count or not parts else None
        if found is not None:
            yield found


def _file(root: Path, name: str) -> Path | None:
    """Return the file of a module in a folder; None where there is none."""
    place = root.joinpath(*name.split(".")) if name else root
    for path in (place / "__init__.py", place.with_suffix(".py")):
        if path.is_file():
            return path
    return None


@cache
def _read(path: Path) -> bytes:
    """Return a source as it was when this process first read it, which is also what the process imported."""
    return normalized(path.read_bytes())
