"""Histories of a campaign in progress: chunks are added in the order of their numbers, and the state is on disk.

The folder ``unfinished/`` holds ``histories.npz`` (the number of added chunks, and the sums of the incomplete points), ``histories-N.npz``
(contribution of chunk N, if the chunk came before its turn or has sampled flights of an incomplete point) and ``ensemble-P.npz``
(histories of the complete point P).
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any
from zipfile import BadZipFile
from zlib import error as ZlibError  # noqa: N812

import numpy as np
import numpy.typing as npt

from flightbed.campaigns.plan import Programme
from flightbed.core.errors import OutputError, printable
from flightbed.core.files import replace_file
from flightbed.parallel.executor import CHUNK
from flightbed.statistics.histories import Arrays, Ensemble, Part, add_all
from flightbed.statistics.moments import Moments, within

Parts = Mapping[int, Part]


class Histories:
    """Sums of the histories of chunks, added in the order of their numbers for any order of arrival.

    Memory holds the complete points, the sampled flights of one point, and chunks that came before their turn.

    Attributes:
        ensembles: point -> its histories, of the complete points with at least one flight without error.
        number: number of added chunks.

    """

    def __init__(self, programme: Programme, folder: Path | None = None) -> None:
        """Start empty, or with the state in a folder. Raises OSError; OutputError for damaged files."""
        self.ensembles: dict[int, Ensemble] = {}
        self.number = 0
        self._programme, self._folder = programme, folder
        self._begun: dict[int, Part] = {}
        self._early: dict[int, Parts] = {}
        self._kept: dict[int, set[int]] = {}  # chunk on disk -> points of its sampled flights
        if folder is not None:
            try:
                self._restore(folder)
            except (
                ValueError,
                KeyError,
                IndexError,
                TypeError,
                AttributeError,
                EOFError,
                BadZipFile,
                ZlibError,
            ) as problem:
                raise OutputError(
                    f"{folder}: a file of histories is damaged ({printable(str(problem))}); delete {folder.parent} and fly "
                    "the campaign again"
                ) from None

    def has(self, number: int) -> bool:
        """Return whether a chunk has been added, or has no histories to add."""
        return (
            number < self.number or number in self._early or not self._points(number) & self._programme.history_points
        )

    def add(self, number: int, parts: Parts) -> None:
        """Add the contributions of a chunk to its points. Raises OSError."""
        if self.has(number):
            return
        self._early[number] = parts
        sampled = {point for point, part in parts.items() if part.sample}
        if self._folder is not None and (number != self.number or sampled):
            self._kept[number] = sampled
            _save(self._folder / f"histories-{number}.npz", _arrays(parts))
        self._add_in_order()

    def _add_in_order(self) -> None:
        """Add all chunks whose turn it is, and save the state."""
        before, last = self.number, -(-len(self._programme) // CHUNK)
        while self.number < last and self.has(self.number):
            add_all(self._begun, self._early.pop(self.number, {}))
            self.number += 1
            flown = min(self.number * CHUNK, len(self._programme))
            for point in [p for p in self._begun if (p + 1) * self._programme.runs <= flown]:
                ensemble = self.ensembles[point] = Ensemble.of(self._begun.pop(point))
                if self._folder is not None:
                    _save(self._folder / f"ensemble-{point}.npz", ensemble.arrays())
        if self._folder is None or self.number == before:
            return
        begun = {f"{point}/{name}": v for point, p in self._begun.items() for name, v in p.moments.arrays().items()}
        _save(self._folder / "histories.npz", {"number": np.array(self.number), **begun})
        for number in [n for n, points in self._kept.items() if n < self.number and not points & self._begun.keys()]:
            (self._folder / f"histories-{number}.npz").unlink(missing_ok=True)
            del self._kept[number]

    def _points(self, number: int) -> set[int]:
        """Return the points of a chunk's flights."""
        last = min((number + 1) * CHUNK, len(self._programme)) - 1
        return set(range(number * CHUNK // self._programme.runs, last // self._programme.runs + 1))

    def _restore(self, folder: Path) -> None:
        for path in folder.glob("ensemble-*.npz"):
            self.ensembles[_number(path)] = Ensemble.of_arrays(_load(path))
        with suppress(FileNotFoundError):
            found = _load(folder / "histories.npz")
            self.number = int(found["number"])
            self._begun = {p: Part(Moments.of_arrays(arrays)) for p, arrays in _by_point(found).items()}
        for number in sorted(map(_number, folder.glob("histories-*.npz"))):
            parts = {
                p: Part.of_arrays(arrays) for p, arrays in _by_point(_load(folder / f"histories-{number}.npz")).items()
            }
            self._kept[number] = {point for point, part in parts.items() if part.sample}
            if number >= self.number:
                self._early[number] = parts
                continue
            for point in self._kept[number] & self._begun.keys():
                begun = self._begun[point]
                self._begun[point] = Part(begun.moments, begun.sample + parts[point].sample)
        self._add_in_order()


def _number(path: Path) -> int:
    return int(path.stem.rpartition("-")[2])


def _arrays(parts: Parts) -> dict[str, npt.NDArray[Any]]:
    return {f"{point}/{name}": array for point, part in parts.items() for name, array in part.arrays().items()}


def _by_point(arrays: Arrays) -> dict[int, Arrays]:
    points = {int(name.partition("/")[0]) for name in arrays if "/" in name}
    return {point: within(arrays, f"{point}/") for point in sorted(points)}


def _save(path: Path, arrays: Arrays) -> None:
    def write(scratch: Path) -> None:
        with scratch.open("wb") as file:
            np.savez(file, **dict(arrays))  # type: ignore[arg-type]  # its stub takes a name for its own option

    replace_file(path, write)


def _load(path: Path) -> dict[str, npt.NDArray[Any]]:
    with path.open("rb") as file, np.load(file) as found:  # np.load leaves a damaged file open
        return {name: found[name] for name in found.files}
