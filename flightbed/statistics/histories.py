"""Histories of the flights of a point: mean and standard deviation of all flights, percentiles of the first ``SAMPLE`` flights.

The results are equal to the last bit for any distribution of the flights over workers.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from flightbed.statistics.moments import Moments, Vector, within

Single = npt.NDArray[np.float32]
Arrays = Mapping[str, npt.NDArray[Any]]

PERCENTILES = (5, 25, 50, 75, 95)
SAMPLE = 500  # first flights of a point, stored for the percentiles; fixed by index, so that the workers do not matter


@dataclass(frozen=True)
class Part:
    """Contribution of some flights to the histories of a point.

    Attributes:
        moments: moments of these flights.
        sample: histories of those among the first ``SAMPLE`` of the point, in order: column -> (n,), single precision.

    """

    moments: Moments
    sample: tuple[Mapping[str, Single], ...] = ()

    @classmethod
    def of(cls, columns: Mapping[str, Vector], *, sampled: bool) -> Part:
        """Return the part of one flight: column -> values (n,)."""
        with np.errstate(over="ignore"):  # a value beyond single precision becomes infinite
            single = ({name: values.astype(np.float32) for name, values in columns.items()},) if sampled else ()
        return cls(Moments.of(columns), single)

    def __add__(self, other: Part) -> Part:
        """Return the part of both sets, the sample of ``other`` after this one."""
        return Part(self.moments + other.moments, self.sample + other.sample)

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """Return all fields as arrays by name, for a file."""
        lengths = np.array([len(next(iter(flight.values()))) for flight in self.sample], dtype=np.int64)
        names = self.sample[0] if self.sample else ()
        sample = {f"sample/{name}": np.concatenate([flight[name] for flight in self.sample]) for name in names}
        return {**self.moments.arrays(), **sample, "lengths": lengths}

    @classmethod
    def of_arrays(cls, arrays: Arrays) -> Part:
        """Return the part stored by ``arrays``."""
        ends = np.cumsum(arrays["lengths"])[:-1]
        columns = {name: np.split(values, ends) for name, values in within(arrays, "sample/").items()}
        sample = tuple({name: flights[i] for name, flights in columns.items()} for i in range(len(arrays["lengths"])))
        return cls(Moments.of_arrays(arrays), sample)


def add_all(whole: dict[int, Part], parts: Mapping[int, Part]) -> None:
    """Add parts to the totals by point, in place."""
    for point, part in parts.items():
        whole[point] = whole[point] + part if point in whole else part


@dataclass(frozen=True)
class Ensemble:
    """Histories of the flights of a point, at every tick at which at least one still flies.

    Attributes:
        moments: number, mean and deviation of all flights.
        sampled: number of flights in the percentiles.
        percentiles: column -> (5, n), ``PERCENTILES`` over the sampled flights that still fly; nan where none does.

    """

    moments: Moments
    sampled: int
    percentiles: Mapping[str, Single]

    @classmethod
    def of(cls, part: Part) -> Ensemble:
        """Return the histories of all flights of a point."""
        length = len(part.moments.flying)
        found = {name: percentiles([flight[name] for flight in part.sample], length) for name in part.moments.mean}
        return cls(part.moments, len(part.sample), found)

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """Return all fields as arrays by name, for a file."""
        found = {f"percentiles/{name}": values for name, values in self.percentiles.items()}
        return {**self.moments.arrays(), **found, "sampled": np.array(self.sampled)}

    @classmethod
    def of_arrays(cls, arrays: Arrays) -> Ensemble:
        """Return the histories stored by ``arrays``."""
        return cls(Moments.of_arrays(arrays), int(arrays["sampled"]), within(arrays, "percentiles/"))


def percentiles(flights: Sequence[npt.NDArray[np.floating[Any]]], length: int) -> Single:
    """Return the percentiles over the flights that still fly at every tick, interpolated like ``numpy.percentile``.

    Unlike ``numpy.percentile``, a percentile that equals one of the values is that value even if the next one is infinite.

    Args:
        flights: one history per flight, up to its end.
        length: number of ticks of the result.

    Returns:
        (5, length), ``PERCENTILES`` per tick; nan where no flight flies.

    """
    found = np.full((len(PERCENTILES), length), np.nan, dtype=np.float32)
    ordered = sorted(flights, key=len)  # the percentiles of a tick do not depend on the order of the flights
    begin = 0
    for i, flight in enumerate(ordered):
        if len(flight) > begin:  # the same flights fly from begin to here
            table = np.array([other[begin : len(flight)] for other in ordered[i:]])
            found[:, begin : len(flight)] = _interpolated(np.sort(table.astype(np.float64), axis=0))
            begin = len(flight)
    return found


def _interpolated(ordered: Vector) -> Vector:
    """Return the percentiles (5, n) of the columns of a table (m, n) whose columns are sorted."""
    ranks = np.array(PERCENTILES)[:, None] / 100.0 * (len(ordered) - 1)
    below = np.floor(ranks).astype(np.int64)[:, 0]
    low, high = ordered[below], ordered[np.ceil(ranks).astype(np.int64)[:, 0]]
    with np.errstate(invalid="ignore", over="ignore"):  # interpolation between infinite values gives nan
        between = low + (high - low) * (ranks - below[:, None])
        return np.where(low == high, low, between)
