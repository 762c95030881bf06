"""Content of a report: sections of text, tables, claims, pictures and listings, as plain values for HTML, JSON and terminal."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import isfinite
from typing import Any

from flightbed.statistics.intervals import Interval, Outcome, Spread

Cell = str | float | int | None | Spread | Interval | Outcome


@dataclass(frozen=True)
class Table:
    """A table.

    Attributes:
        key: name in machine-readable results.
        title: caption.
        columns: headings, with units.
        rows: rows of cells, one cell per column.
        formats: column -> format of its numbers; default .4g.
        note: remark below the table.

    """

    key: str
    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    formats: Mapping[str, str] = field(default_factory=dict)
    note: str = ""

    def cell_texts(self, row: Sequence[Cell]) -> list[str]:
        """Return the cells of a row as text."""
        return [show(cell, self.formats.get(column, ".4g")) for column, cell in zip(self.columns, row, strict=True)]


@dataclass(frozen=True)
class Claim:
    """A claim of a publication and the result of the computation.

    Attributes:
        key: name in machine-readable results.
        text: the claim.
        measured: description of the computed quantity that decides the claim.
        interval: estimate and 95 % interval of this quantity.
        holds: whether the computation agrees, with 95 % confidence; None if these runs do not decide.

    """

    key: str
    text: str
    measured: str
    interval: Interval
    holds: bool | None


@dataclass(frozen=True)
class Picture:
    """A figure.

    Attributes:
        key: name, or the number of a published figure.
        title: title of the figure.
        svg: the drawing.
        parameters: description of the flights and lines.
        facts: numbers computed from the plotted data, in words.

    """

    key: str
    title: str
    svg: str
    parameters: str
    facts: str = ""


@dataclass(frozen=True)
class Listing:
    """Preformatted text: a file, commands."""

    title: str
    text: str


Item = Table | Claim | Picture | Listing


@dataclass(frozen=True)
class Section:
    """A heading with paragraphs and items."""

    heading: str
    text: Sequence[str] = ()
    items: Sequence[Item] = ()


@dataclass(frozen=True)
class Document:
    """A complete report.

    Attributes:
        title: title of the report.
        sections: sections, in order.
        facts: values that apply to the report as a whole: versions, settings, time.
        lead: summary before the table of contents; its heading is not printed.

    """

    title: str
    sections: Sequence[Section]
    facts: Mapping[str, Any]
    lead: Section = Section("")

    def tables(self) -> list[Table]:
        """Return all tables, in order."""
        return [item for item in self._items() if isinstance(item, Table)]

    def claims(self) -> list[Claim]:
        """Return all claims, in order."""
        return [item for item in self._items() if isinstance(item, Claim)]

    def pictures(self) -> list[Picture]:
        """Return all figures, in order."""
        return [item for item in self._items() if isinstance(item, Picture)]

    def _items(self) -> Iterator[Item]:
        for section in (self.lead, *self.sections):
            yield from section.items

    def to_dict(self) -> dict[str, Any]:
        """Return nested plain values for JSON: all numbers, without drawings and listings."""
        return {
            **self.facts,
            "tables": {
                t.key: [{c: _plain(v) for c, v in zip(t.columns, row, strict=True)} for row in t.rows]
                for t in self.tables()
            },
            "claims": {
                c.key: {"claim": c.text, "measured": c.measured, "interval": _plain(c.interval), "holds": c.holds}
                for c in self.claims()
            },
            "figures": {
                p.key: {"title": p.title, "parameters": p.parameters, "facts": p.facts} for p in self.pictures()
            },
        }


def show(cell: Cell, spec: str = ".4g") -> str:
    """Return a cell as text: median [5 %, 95 %] of a spread, estimate (95 % interval) of an interval, "-" for None or nan.

    For an outcome: the spread over the flights without a departure, and the number and times of departures.
    """
    if cell is None or (isinstance(cell, float) and cell != cell):
        return "-"
    if isinstance(cell, Outcome):
        runs, gone, missing = cell.gone_s.runs, cell.gone_s.runs - cell.gone_s.missing, cell.stayed.missing
        parts = [] if gone == runs else [show(replace(cell.stayed, runs=runs - gone, missing=missing - gone), spec)]
        if gone:
            gone_s = f"{cell.gone_s.median:.2f} s [{cell.gone_s.low:.2f}, {cell.gone_s.high:.2f}]"
            parts.append(f"{gone} of {runs} gone at {gone_s}")
        return "; ".join(parts)
    if isinstance(cell, Spread):
        if cell.missing == cell.runs:
            return "never"
        never = f", never in {cell.missing} of {cell.runs}" if cell.missing else ""
        return f"{cell.median:{spec}} [{cell.low:{spec}}, {cell.high:{spec}}]{never}"
    if isinstance(cell, Interval):
        return f"{cell.estimate:{spec}} ({cell.low:{spec}} to {cell.high:{spec}})"
    return format(cell, spec) if isinstance(cell, float) else str(cell)


def _plain(cell: Cell) -> Any:
    """Return a cell for JSON; nan and infinity become null."""
    if isinstance(cell, Spread | Interval | Outcome):
        return {k: _plain(v) for k, v in vars(cell).items()}
    return None if isinstance(cell, float) and not isfinite(cell) else cell
