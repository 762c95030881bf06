"""Histories of the flights of a point: mean and deviation of all, percentiles of the first of them; no bit depends on who flew."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from flightbed.moments import Moments, Vector, within

Single = npt.NDArray[np.float32]
Arrays = Mapping[str, npt.NDArray[Any]]

PERCENTILES = (5, 25, 50, 75, 95)
SAMPLE = 500  # flights of a point whose histories are held for the percentiles: its first, so that they are the same whoever flies


@dataclass(frozen=True)
class Part:
    """What some flights add to the histories of a point.

    Attributes:
        moments: of all of them.
        sample: of those that are among the first ``SAMPLE`` of their point, in order: column -> (n,), in single precision.

    """

    moments: Moments
    sample: tuple[Mapping[str, Single], ...] = ()

    @classmethod
    def of(cls, columns: Mapping[str, Vector], *, sampled: bool) -> Part:
        """Return that of one flight: column -> values, of one length."""
        with np.errstate(over="ignore"):  # what single precision cannot hold is infinite there
            single = ({name: values.astype(np.float32) for name, values in columns.items()},) if sampled else ()
        return cls(Moments.of(columns), single)

    def __add__(self, other: Part) -> Part:
        """Return that of both, those of ``other`` after these."""
        return Part(self.moments + other.moments, self.sample + other.sample)

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """Return all of it as arrays by name, for a file."""
        lengths = np.array([len(next(iter(flight.values()))) for flight in self.sample], dtype=np.int64)
        names = self.sample[0] if self.sample else ()
        sample = {f"sample/{name}": np.concatenate([flight[name] for flight in self.sample]) for name in names}
        return {**self.moments.arrays(), **sample, "lengths": lengths}

    @classmethod
    def of_arrays(cls, arrays: Arrays) -> Part:
        """Return what ``arrays`` gave."""
        ends = np.cumsum(arrays["lengths"])[:-1]
        columns = {name: np.split(values, ends) for name, values in within(arrays, "sample/").items()}
        sample = tuple({name: flights[i] for name, flights in columns.items()} for i in range(len(arrays["lengths"])))
        return cls(Moments.of_arrays(arrays), sample)


def add_all(whole: dict[int, Part], parts: Mapping[int, Part]) -> None:
    """Add to what there is of each point."""
    for point, part in parts.items():
        whole[point] = whole[point] + part if point in whole else part


@dataclass(frozen=True)
class Ensemble:
    """Histories of the flights of a point, at every tick at which one still flies.

    Attributes:
        moments: number, mean and deviation of all flights.
        sampled: number of flights that the percentiles are of.
        percentiles: column -> (5, n), those of ``PERCENTILES`` over the sampled flights that still fly; nan where none does.

    """

    moments: Moments
    sampled: int
    percentiles: Mapping[str, Single]

    @classmethod
    def of(cls, part: Part) -> Ensemble:
        """Return that of all flights of a point."""
        length = len(part.moments.flying)
        found = {name: percentiles([flight[name] for flight in part.sample], length) for name in part.moments.mean}
        return cls(part.moments, len(part.sample), found)

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """Return all of it as arrays by name, for a file."""
        found = {f"percentiles/{name}": values for name, values in self.percentiles.items()}
        return {**self.moments.arrays(), **found, "sampled": np.array(self.sampled)}

    @classmethod
    def of_arrays(cls, arrays: Arrays) -> Ensemble:
        """Return what ``arrays`` gave."""
        return cls(Moments.of_arrays(arrays), int(arrays["sampled"]), within(arrays, "percentiles/"))


def percentiles(flights: Sequence[npt.NDArray[np.floating[Any]]], length: int) -> Single:
    """Return, at every tick, percentiles over the flights that still fly, interpolated as ``numpy.percentile`` does.

    But where a percentile is one of the values it is that, also if the next one is infinite.

    Args:
        flights: a history each, as long as it flew.
        length: ticks of the result; nan where nobody flies.

    Returns:
        (5, length), those of ``PERCENTILES``.

    """
    found = np.full((len(PERCENTILES), length), np.nan, dtype=np.float32)
    ordered = sorted(flights, key=len)  # the percentiles of a tick do not depend on the order of the flights
    begin = 0
    for i, flight in enumerate(ordered):
        if len(flight) > begin:  # no flight ends in between
            table = np.array([other[begin : len(flight)] for other in ordered[i:]])
            found[:, begin : len(flight)] = _interpolated(np.sort(table.astype(np.float64), axis=0))
            begin = len(flight)
    return found


def _interpolated(ordered: Vector) -> Vector:
    """Return the percentiles of every column; each has its values in order."""
    ranks = np.array(PERCENTILES)[:, None] / 100.0 * (len(ordered) - 1)
    below = np.floor(ranks).astype(np.int64)[:, 0]
    low, high = ordered[below], ordered[np.ceil(ranks).astype(np.int64)[:, 0]]
    with np.errstate(invalid="ignore", over="ignore"):  # between infinite values lies no number
        between = low + (high - low) * (ranks - below[:, None])
        return np.where(low == high, low, between)
