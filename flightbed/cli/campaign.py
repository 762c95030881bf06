"""The command `flightbed campaign`."""

from __future__ import annotations

import json as json_module
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import RenderableType
from rich.markup import escape
from rich.padding import Padding
from rich.text import Text

from flightbed.cli.app import Flag, Scheduler, Set, Use, Workers, print_error
from flightbed.cli.completion import FlightsName
from flightbed.cli.screen import print_json, print_lines, progress_bar, table, without_intervals

if TYPE_CHECKING:
    from flightbed.campaigns.result import Campaign
    from flightbed.document.document import Table

_POINTS = 20  # most points of a campaign with a table on a terminal


def campaign(
    file: FlightsName,
    /,
    *,
    runs: int | None = None,
    workers: Workers = None,
    scheduler: Scheduler = None,
    out: Path | None = None,
    resume: Flag = False,
    set_: Set = None,
    use: Use = None,
    json: Flag = False,
) -> None:
    """Fly a scenario many times, with successive seeds or over the values in a campaign file; write table, summary and report.

    Args:
        file: Name of a shipped campaign or scenario (`flightbed list campaigns`, `flightbed list scenarios`) or path of its TOML file.
        runs: Number of flights at each point. Default: set by the campaign file; 100 for a scenario.
        out: Folder to write; replaces a finished campaign there. Default: campaigns/NAME, or campaigns/NAME-2, ... if that exists.
        resume: Continue an unfinished campaign: fly only the missing flights.
        json: Print only JSON on stdout: the content of summary.json, and the folder.

    """
    from flightbed.campaigns import run as campaigns
    from flightbed.campaigns.file import load_programme
    from flightbed.config.own_code import using
    from flightbed.scenario.own_code import check_named

    with using(*(use or ())):
        with progress_bar() as progress:
            programme = load_programme(file, set_ or (), runs)
            check_named(programme.scenario, use or ())
            for note in programme.notes:
                print_error(note)
            place = out if out is not None else Path("campaigns") / programme.name
            flown, written = campaigns.run(
                programme, place, workers=workers, scheduler=scheduler, replace=out is not None, resume=resume, progress=progress,
            )  # fmt: skip
        if json:
            print_json(json_module.loads((written / "summary.json").read_text(encoding="utf-8")), written)
        elif flown is None:
            print_lines([f"no flight is missing; finished in {written}"])
        else:
            print_lines(campaign_lines(flown, written))


def campaign_lines(campaign: Campaign, written: Path) -> Iterator[RenderableType]:
    """Yield headline, medians and points of a campaign, the command for its worst flight, and the folder."""
    from flightbed.campaigns.report.headline import headline_section
    from flightbed.campaigns.report.points import points_table
    from flightbed.document.document import Table

    first = headline_section(campaign)
    yield Text.from_markup(f"[bold]{campaign.programme.name}[/bold]: {escape(campaign.programme.description)}")
    for paragraph in first.text:
        yield Padding(escape(paragraph), (0, 2))
    few = 1 < len(campaign.programme.points) <= _POINTS
    for item in (*first.items, *([_without("flights", points_table(campaign, estimators=()))] if few else [])):
        if isinstance(item, Table):
            grid = table()
            for column in item.columns:
                longest = max(map(len, column.split()))  # a heading breaks only between words
                grid.add_column(escape(column), no_wrap=column == "estimator", min_width=longest)
            for row in item.rows:
                grid.add_row(*(escape(cell) for cell in item.cell_texts(without_intervals(row))))
            yield Padding(grid, (0, 1))
    summary = campaign.summary
    if summary.worst is not None:
        yield f"  worst flight: flightbed run {escape(str(written))}/scenario.toml{escape(summary.worst.options)}"
    yield f"  {summary.flights.flights} flights in {summary.wall_time_s:.1f} s; written to {escape(str(written))}"


def _without(column: str, points: Table) -> Table:
    """Return a table without a column."""
    kept = [i for i, name in enumerate(points.columns) if name != column]
    return replace(
        points, columns=[points.columns[i] for i in kept], rows=[[row[i] for i in kept] for row in points.rows]
    )
