"""What the benchmarks share: environment and effort, tables of figures (``flightbed.core.timing`` takes these)."""

from __future__ import annotations

import os
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

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


def machine() -> dict[str, Any]:
    """Return the conditions of the figures: number of cores, and the load average, which should be near 0 before a measurement."""
    return {"cores": os.cpu_count() or 1, "load_average": os.getloadavg()[0]}


def plain_shell(added: Mapping[str, str]) -> dict[str, str]:
    """Return the environment of a shell without variables that change the figures, except those given."""
    return {**{name: value for name, value in os.environ.items() if name not in _TOLD}, **added}


@dataclass(frozen=True)
class Effort:
    """Effort of a section: rounds, scenarios, flights.

    Attributes:
        rounds: of each measurement.
        overrides: of all scenarios.
        chunks, chunk: number of chunks per worker, and flights per chunk.
        parallel: aircraft that more than one worker flies.
        flights: of one process whose memory growth is measured.
        held: flights held in memory at once.
        environment: variables added to those of a fresh shell.
        report: value of ``flightbed run --report`` in a fresh shell.

    """

    rounds: int
    overrides: tuple[str, ...] = ()
    chunks: int = 4
    chunk: int = 25
    parallel: tuple[str, ...] = ("linear aircraft", "F-16")
    flights: int = 1000
    held: int = 20
    environment: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    report: str = "save"


@dataclass(frozen=True)
class Column:
    """A column of a table: its head, the unit of its figures ("1" for a ratio), and their format."""

    name: str
    unit: str
    spec: str


@dataclass(frozen=True)
class Table:
    """Result of a section: figures by row and column; None where a row has no such figure.

    Attributes:
        title: the measured quantity.
        columns: the columns, in order.
        rows: name -> figures of each column, one per round.
        note: a further sentence; may be empty.

    """

    title: str
    columns: tuple[Column, ...]
    rows: Mapping[str, Sequence[Sequence[float] | None]]
    note: str = ""

    def text(self) -> str:
        """Return the table in Markdown, its columns aligned."""
        from flightbed.core.timing import spread  # imports numpy, which reads THREADS

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
