"""The command `flightbed compare`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import RenderableType
from rich.markup import escape
from rich.padding import Padding
from rich.text import Text

from flightbed.cli.app import Flag
from flightbed.cli.screen import print_json, print_lines, table

if TYPE_CHECKING:
    from flightbed.analysis.comparison import Run


def compare(
    *runs: str,
    out: Path | None = None,
    json: Flag = False,
) -> None:
    """Compare runs: metrics, settings that differ, one recording with a common time axis, and a report.

    Args:
        runs: Two or more folders written by `flightbed run`; differences are relative to the first.
        out: Folder to write; replaces an earlier comparison there. Default: comparisons/FIRST-SECOND-..., or ...-2 if that exists.
        json: Print only JSON on stdout: the content of comparison.json, and the folder.

    """
    from flightbed.analysis import comparison
    from flightbed.core.files import check_target
    from flightbed.report.comparison_report import comparison_report
    from flightbed.runs.comparison_folder import COMPARISON, write_comparison

    read = comparison.load_runs(runs)
    place = out if out is not None else Path("comparisons") / comparison.short_name(read)
    target = check_target(place, COMPARISON, replace=out is not None)
    written = write_comparison(read, comparison_report(read), target, replace=out is not None)
    if json:
        print_json(comparison.to_dict(read), written)
    else:
        print_lines(comparison_lines(read, written))


def comparison_lines(runs: Sequence[Run], written: Path) -> Iterator[RenderableType]:
    """Yield the metrics of the runs, the settings that differ, and the folder."""
    from flightbed.analysis.comparison import different_sources, differing, metrics_table

    for compared in (metrics_table(runs), differing(runs)):
        if not compared.rows:
            yield "All settings are the same."
            continue
        yield Text(compared.title, style="bold")
        grid = table()
        for column in compared.columns:
            grid.add_column(escape(column), overflow="fold")
        for row in compared.rows:
            grid.add_row(*(escape(cell) for cell in compared.cell_texts(row)))
        yield grid
        if compared.note:
            yield Padding(Text(compared.note, style="dim"), (0, 1))
    if sources := different_sources(runs):
        yield Padding(escape(sources), (0, 1))
    yield f"  written to {escape(str(written))}; open: flightbed view {escape(str(written))}"
