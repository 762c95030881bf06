"""Compare the flights of two source trees bit for bit.

    python tests/bits.py OLD NEW [SCENARIO ...] [--python-old PYTHON] [--python-new PYTHON]

OLD and NEW are source trees: each holds the folders flightbed, aircraft and scenarios. Every scenario of OLD (the files
directly in OLD/scenarios), or only those named, is flown by both trees from OLD's file. Where NEW's file of that name has another text,
NEW flies its own file too; an OLD file that NEW refuses as invalid is reported, and no difference if NEW's own flight is equal. Each tree flies in its own process, both at the same time, with empty caches. A column is equal
if all its bytes are, so that nan equals nan.

Exit code 0: every column of OLD is equal in NEW, columns that only NEW has are listed; 1: a flight or a column differs or is missing;
2: bad arguments, or the two trees cannot be compared.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import numpy.typing as npt

Columns = Mapping[str, npt.NDArray[Any]]
FLY = Path(__file__).resolve().with_name("fly_tree.py")


class CannotCompareError(Exception):
    """Bad arguments, or a tree that cannot fly."""


@dataclass(frozen=True)
class Comparison:
    """One flight of two trees.

    Attributes:
        name: scenario.
        equal: number of columns that are equal to the last bit.
        differing: column -> by how much and from which tick on.
        only_old, only_new: columns that the other tree does not have.
        errors: tree -> its error, where it could not fly the scenario.
        refused: why NEW refuses the file of OLD, where its own file flies equal.

    """

    name: str
    equal: int
    differing: Mapping[str, str]
    only_old: Sequence[str]
    only_new: Sequence[str]
    errors: Mapping[str, str]
    refused: str = ""

    @property
    def same(self) -> bool:
        """Whether NEW has every column of OLD, equal to the last bit."""
        return not (self.differing or self.only_old or self.errors)

    def lines(self) -> list[str]:
        """Return the text of the comparison, one line if nothing differs."""
        if self.refused:
            return [f"{self.name}: NEW refuses the file of OLD ({self.refused}) and flies its own"]
        found = [f"  {tree}: {error}" for tree, error in self.errors.items()]
        found += [f"  {column}: {how}" for column, how in self.differing.items()]
        found += [f"  only in OLD: {', '.join(self.only_old)}"] if self.only_old else []
        found += [f"  only in NEW: {', '.join(self.only_new)}"] if self.only_new else []
        verdict = "equal" if self.same else "not flown" if self.errors else f"{len(self.differing)} columns differ"
        return [f"{self.name}: {verdict} ({self.equal} columns equal)", *found]


def difference(old: npt.NDArray[Any], new: npt.NDArray[Any]) -> str | None:
    """Return by how much two columns differ and from which tick on; None if they are equal to the last bit."""
    if old.dtype != new.dtype or old.ndim != 1 or new.ndim != 1:
        return f"{old.dtype} of shape {old.shape} in OLD, {new.dtype} of shape {new.shape} in NEW"
    shared = min(len(old), len(new))
    size = old.dtype.itemsize
    bytes_old, bytes_new = (np.ascontiguousarray(v[:shared]).view(np.uint8).reshape(-1, size) for v in (old, new))
    unequal = np.flatnonzero((bytes_old != bytes_new).any(axis=1))
    text = []
    if len(old) != len(new):
        text.append(f"{len(old)} ticks in OLD, {len(new)} in NEW")
    if len(unequal):
        x, y = old[unequal], new[unequal]
        finite = np.isfinite(x) & np.isfinite(y)
        if finite.any():
            text.append(f"up to {np.abs(x[finite] - y[finite]).max():.3g}")
        if not finite.all():
            text.append(f"{np.count_nonzero(~finite)} ticks with a value that is not finite")
        text.append(f"{len(unequal)} of {shared} ticks, from tick {unequal[0]} on")
    return "; ".join(text) or None


def compare(name: str, old: Columns | str, new: Columns | str) -> Comparison:
    """Compare the columns of two flights; text instead of columns is the error of a tree that could not fly."""
    errors = {tree: flown for tree, flown in (("OLD", old), ("NEW", new)) if isinstance(flown, str)}
    if isinstance(old, str) or isinstance(new, str):
        return Comparison(name, 0, {}, (), (), errors)
    found = {column: difference(old[column], new[column]) for column in old if column in new}
    differing = {column: how for column, how in found.items() if how is not None}
    only_old, only_new = ([c for c in one if c not in other] for one, other in ((old, new), (new, old)))
    return Comparison(name, len(found) - len(differing), differing, only_old, only_new, {})


class Flying:
    """A process in which one tree flies scenario files."""

    def __init__(self, tree: Path, files: Sequence[Path], folder: Path, *, python: str = sys.executable) -> None:
        """Start it; ``folder`` is empty and takes the columns, and all caches."""
        self.tree, self.files, self.folder = tree, files, folder
        caches = folder / "caches"
        caches.mkdir(parents=True)
        dropped = ("FLIGHTBED_PLAIN", "PYTHONHOME", "PYTHONSTARTUP")
        environment = {name: value for name, value in os.environ.items() if name not in dropped} | {
            "PYTHONPATH": str(tree),
            "PYTHONDONTWRITEBYTECODE": "1",
            "PYTHONPYCACHEPREFIX": str(caches / "bytecode"),  # compiled modules beside the sources may be stale
            "NUMBA_CACHE_DIR": str(caches / "numba"),
            "XDG_CACHE_HOME": str(caches),
            "OPENBLAS_NUM_THREADS": "1",
        }
        command = [python, "-P", str(FLY), str(tree), str(folder), *map(str, files)]
        try:
            self.process = subprocess.Popen(
                command, env=environment, cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
            )
        except OSError as error:
            raise CannotCompareError(f"{python}: cannot be started: {error.strerror}") from None

    def done(self) -> tuple[list[Columns | str], dict[str, str]]:
        """Wait for the flights; return columns, or the error, of each file, and the versions of what computed them.

        Raises CannotCompareError when the process failed as a whole.
        """
        _, stderr = self.process.communicate()
        if self.process.returncode != 0:
            last = stderr.strip().splitlines()[-1:] or [f"exit code {self.process.returncode}"]
            raise CannotCompareError(f"{self.tree}: cannot fly: {last[0]}")
        versions = json.loads((self.folder / "versions.json").read_text())
        return [self._flown(number) for number in range(len(self.files))], versions

    def _flown(self, number: int) -> Columns | str:
        error = self.folder / f"{number}.txt"
        if error.is_file():
            return error.read_text()
        with np.load(self.folder / f"{number}.npz") as columns:
            return dict(columns)

    def stop(self) -> None:
        """End the process if it still runs."""
        if self.process.poll() is None:
            self.process.kill()
            self.process.communicate()


def scenario_files(tree: Path, names: Sequence[str] = ()) -> dict[str, Path]:
    """Return name -> file of the scenarios of a tree, all of them if none is named. Raises CannotCompareError."""
    if not tree.is_dir():
        raise CannotCompareError(f"{tree}: no such folder; give a source tree")
    files = {path.stem: path for path in sorted((tree / "scenarios").glob("*.toml"))}
    if not (tree / "flightbed").is_dir() or not files:
        raise CannotCompareError(f"{tree}: not a source tree of flightbed (needs flightbed/ and scenarios/*.toml)")
    unknown = [name for name in names if name not in files]
    if unknown:
        raise CannotCompareError(f"{tree}: no scenario {', '.join(unknown)}; give one of {', '.join(files)}")
    return {name: files[name] for name in names or files}


def compare_trees(
    old: Path,
    new: Path,
    names: Sequence[str] = (),
    *,
    python_old: str = sys.executable,
    python_new: str = sys.executable,
) -> list[Comparison]:
    """Fly the scenarios of OLD with both trees, and those of NEW that have another text. Raises CannotCompareError."""
    old, new = old.resolve(), new.resolve()
    files = scenario_files(old, names)
    others = scenario_files(new)
    edited = {
        name: others[name] for name in files if name in others and others[name].read_bytes() != files[name].read_bytes()
    }
    with tempfile.TemporaryDirectory() as folder:
        one = two = None
        try:
            one = Flying(old, list(files.values()), Path(folder, "old"), python=python_old)
            two = Flying(new, [*files.values(), *edited.values()], Path(folder, "new"), python=python_new)
            (flown_old, versions_old), (flown_new, versions_new) = one.done(), two.done()
        finally:
            for flying in (one, two):
                if flying is not None:
                    flying.stop()
    for name, found in versions_old.items():
        if versions_new[name] != found:
            raise CannotCompareError(
                f"{name}: OLD flies with {found}, NEW with {versions_new[name]}; use the same versions"
            )
    by_name = dict(zip(files, flown_old, strict=True))
    shared = [compare(name, by_name[name], flown) for name, flown in zip(files, flown_new, strict=False)]
    own = {
        name: compare(f"{name} (NEW's own file, its text differs)", by_name[name], flown)
        for name, flown in zip(edited, flown_new[len(files) :], strict=True)
    }
    return [*(_or_refused(one, own.get(one.name)) for one in shared), *own.values()]


def _or_refused(one: Comparison, own: Comparison | None) -> Comparison:
    """Return a comparison; if NEW refuses the file of OLD as invalid and its own file flies equal, one without a difference."""
    error = one.errors.get("NEW", "")
    if own is None or not own.same or set(one.errors) != {"NEW"} or not error.startswith("ScenarioError: "):
        return one
    return replace(one, errors={}, refused=error.removeprefix("ScenarioError: ").replace("\n", "; "))


def closing_line(found: Sequence[Comparison]) -> str:
    """Return the result of all comparisons in one line."""
    columns = sum(c.equal + len(c.differing) + len(c.only_old) for c in found)
    bad = [c for c in found if not c.same]
    refused = sum(bool(c.refused) for c in found)
    text = f"{len(found) - refused} scenarios, {columns} columns: "
    if bad:
        differing, missing = sum(len(c.differing) for c in bad), sum(len(c.only_old) for c in bad)
        unflown = sum(bool(c.errors) for c in bad)
        text += f"{differing} differ, {missing} are missing in NEW, {unflown} scenarios not flown"
    else:
        text += "equal to the last bit"
    added = sum(len(c.only_new) for c in found)
    text += f"; {refused} files of OLD refused by NEW, which flies its own" if refused else ""
    return text + (f"; {added} columns only in NEW" if added else "")


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        self.exit(2, f"bits.py: {message}\n")


def main(arguments: Sequence[str] | None = None) -> int:
    """Compare as the arguments say; print the result and return the exit code."""
    parser = _Parser("bits.py", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("old", type=Path)
    parser.add_argument("new", type=Path)
    parser.add_argument("scenario", nargs="*")
    parser.add_argument("--python-old", default=sys.executable)
    parser.add_argument("--python-new", default=sys.executable)
    given = parser.parse_args(arguments)
    try:
        found = compare_trees(
            given.old, given.new, given.scenario, python_old=given.python_old, python_new=given.python_new
        )
    except CannotCompareError as error:
        print(f"bits.py: {error}", file=sys.stderr)
        return 2
    for comparison in found:
        print(*comparison.lines(), sep="\n")
    print(closing_line(found))
    return 0 if all(comparison.same for comparison in found) else 1


if __name__ == "__main__":
    sys.exit(main())
