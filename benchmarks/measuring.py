"""What the benchmarks share: ways measured in turn, medians with ranges, tables of them.

Figures are one value a round, and what compares two of them, a ratio or a difference, is taken round by round: a change of the machine's
mood then meets both.
"""

from __future__ import annotations

import os
import statistics
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, TypeVar

K = TypeVar("K")
T = TypeVar("T")
Figures = list[float]  # one a round

THREADS = (
    "OPENBLAS_NUM_THREADS",
    "OMP_NUM_THREADS",
    "MKL_NUM_THREADS",
)  # of linear algebra; read when numpy is imported
_TOLD = (
    "FLIGHTBED_PLAIN",
    "NUMBA_CACHE_DIR",
    "XDG_CACHE_HOME",
    "MPLCONFIGDIR",
    "RERUN",
    *THREADS,
)  # by which figures change


def interleaved(ways: Mapping[K, Callable[[], T]], rounds: int, *, warm: int = 1) -> dict[K, list[T]]:
    """Take all ways once a round, every second round backwards; returns what each gave, round by round.

    Args:
        ways: what to call, by name.
        rounds: how often.
        warm: rounds before these, whose results are dropped: they load and compile.

    """
    given: dict[K, list[T]] = {name: [] for name in ways}
    for number in range(-warm, rounds):
        for name in list(ways)[:: -1 if number % 2 else 1]:
            value = ways[name]()
            if number >= 0:
                given[name].append(value)
    return given


def seconds(work: Callable[[], object], repeat: int = 1, *, clock: Callable[[], float] = time.perf_counter) -> float:
    """Return how long one of so many calls in a row takes, s.

    Args:
        work: what to call.
        repeat: how often.
        clock: the wall's; ``time.thread_time``, the time that this thread has the processor, for work that never waits and has no other
            threads: a turn of another process, 4 ms under Linux, is longer than some of what is timed, and would be all that is seen.

    """
    began = clock()
    for _ in range(repeat):
        work()
    return (clock() - began) / repeat


def ratios(over: Sequence[float], under: Sequence[float]) -> Figures:
    """Return one figure over another, round by round."""
    return [a / b for a, b in zip(over, under, strict=True)]


def differences(more: Sequence[float], less: Sequence[float]) -> Figures:
    """Return one figure less another, round by round."""
    return [a - b for a, b in zip(more, less, strict=True)]


def spread(values: Sequence[float], spec: str) -> str:
    """Return "median (lowest to highest)", or the median alone where they do not differ."""
    median, low, high = (format(f(values), spec) for f in (statistics.median, min, max))
    return median if low == high else f"{median} ({low} to {high})"


def likely(values: Iterable[float | None], spec: str) -> str:
    """Return "median (5 % - 95 %)" of the values that there are, or "-"."""
    import numpy as np  # not before THREADS can be set

    known = [v for v in values if v is not None]
    if not known:
        return "-"
    low, middle, high = np.percentile(known, [5, 50, 95])
    return f"{middle:{spec}} ({low:{spec}} - {high:{spec}})"


def machine() -> dict[str, Any]:
    """Return what figures depend on: number of cores, and the load average, which should be near 0 before they are taken."""
    return {"cores": os.cpu_count() or 1, "load_average": os.getloadavg()[0]}


def plain_shell(added: Mapping[str, str]) -> dict[str, str]:
    """Return the environment of a shell in which nothing that changes the figures is set but what is added."""
    return {**{name: value for name, value in os.environ.items() if name not in _TOLD}, **added}


@dataclass(frozen=True)
class Effort:
    """How much a section does.

    Attributes:
        rounds: of each measurement.
        overrides: of all scenarios.
        chunks, chunk: flights are handed out in so many chunks a worker, of so many flights.
        flights: of one process that is watched for growth.
        held: flights held in memory at once.
        environment: added to that of a fresh shell.
        report: what ``flightbed run --report`` is told in a fresh shell.

    """

    rounds: int
    overrides: tuple[str, ...] = ()
    chunks: int = 4
    chunk: int = 25
    flights: int = 1000
    held: int = 20
    environment: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    report: str = "save"


@dataclass(frozen=True)
class Column:
    """A column of a table: its head, the unit of its figures ("1" for a ratio), and how they are written."""

    name: str
    unit: str
    spec: str


@dataclass(frozen=True)
class Table:
    """What a section found: figures by row and column; None where a row has no such figure.

    Attributes:
        title: what was measured.
        columns: what of it.
        rows: name -> figures of each column, one a round.
        note: what else there is to say, a sentence; may be empty.

    """

    title: str
    columns: tuple[Column, ...]
    rows: Mapping[str, Sequence[Sequence[float] | None]]
    note: str = ""

    def text(self) -> str:
        """Return the table in Markdown, its columns aligned."""
        lines = [["", *(f"{c.name}" if c.unit == "1" else f"{c.name}, {c.unit}" for c in self.columns)]]
        for name, figures in self.rows.items():
            cells = zip(figures, self.columns, strict=True)
            lines.append([name, *("" if values is None else spread(values, c.spec) for values, c in cells)])
        widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
        lines.insert(1, ["-" * width for width in widths])
        rows = ("| " + " | ".join(map(str.ljust, line, widths)) + " |" for line in lines)
        return "\n".join([self.title, "", *rows, *(["", self.note] if self.note else [])])

    def to_dict(self) -> dict[str, Any]:
        """Return plain values: of each figure median, range, the value of each round, and the unit."""
        return {
            "title": self.title,
            "note": self.note,
            "rows": {
                name: {
                    column.name: {
                        "unit": column.unit,
                        "median": statistics.median(values),
                        "low": min(values),
                        "high": max(values),
                        "values": list(values),
                    }
                    for values, column in zip(figures, self.columns, strict=True)
                    if values is not None
                }
                for name, figures in self.rows.items()
            },
        }
