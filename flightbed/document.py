"""What a report is made of: sections of text, tables, claims, pictures, listings; plain values, to be printed, saved or laid out."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import isfinite
from typing import Any

from flightbed.statistics import Interval, Outcome, Spread

Cell = str | float | int | None | Spread | Interval | Outcome


@dataclass(frozen=True)
class Table:
    """A table.

    Attributes:
        key: its name in machine-readable results.
        title: what it shows.
        columns: headings, with units.
        rows: as many cells each.
        formats: column -> how its numbers are shown; .4g without.
        note: a remark below it.

    """

    key: str
    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    formats: Mapping[str, str] = field(default_factory=dict)
    note: str = ""

    def shown(self, row: Sequence[Cell]) -> list[str]:
        """Return the cells of a row as text."""
        return [show(cell, self.formats.get(column, ".4g")) for column, cell in zip(self.columns, row, strict=True)]


@dataclass(frozen=True)
class Claim:
    """Something that a paper argues from, and what the computation says.

    Attributes:
        key: its name in machine-readable results.
        text: the claim.
        measured: what was computed to decide it.
        interval: of that.
        holds: whether the computation agrees, with 95 % confidence; None if these runs do not settle it.

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
        key: its name; of a published figure its number.
        title: what it shows.
        svg: the drawing.
        parameters: what was flown, in words.
        facts: numbers computed from what is drawn.

    """

    key: str
    title: str
    svg: str
    parameters: str
    facts: str = ""


@dataclass(frozen=True)
class Listing:
    """Text that is shown as it is, line by line: a file, commands."""

    title: str
    text: str


Item = Table | Claim | Picture | Listing


@dataclass(frozen=True)
class Section:
    """A heading, paragraphs, and what belongs to it."""

    heading: str
    text: Sequence[str] = ()
    items: Sequence[Item] = ()


@dataclass(frozen=True)
class Document:
    """A whole report.

    Attributes:
        title: what it is about.
        sections: its parts, in order.
        facts: values about it as a whole: versions, settings, time.
        lead: what a reader should see first, before the contents; its heading is not shown.

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
        """Return nested plain values, ready for JSON: every number; no drawing and no listing."""
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
    """Return a cell as text: median [5 %, 95 %] of a spread, estimate (95 % interval) of an interval, - for nothing.

    Of an outcome: the spread over the flights that stayed, and how many went when.
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
    """Return a cell for JSON, which has neither nan nor infinity: both are null."""
    if isinstance(cell, Spread | Interval | Outcome):
        return {k: _plain(v) for k, v in vars(cell).items()}
    return None if isinstance(cell, float) and not isfinite(cell) else cell
