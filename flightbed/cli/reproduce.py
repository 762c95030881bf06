"""The command `flightbed reproduce`."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter
from rich.console import RenderableType
from rich.markup import escape
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from flightbed.cli.app import Flag, Scheduler, Workers
from flightbed.cli.completion import StudyName
from flightbed.cli.screen import print_json, print_lines, progress_bar, table, without_intervals
from flightbed.core.errors import InputError

if TYPE_CHECKING:
    from flightbed.document.document import Document

_WIDE = 7  # most columns of a table that shows its intervals on a terminal


def reproduce(
    study: StudyName,
    /,
    *,
    runs: int | None = None,
    workers: Workers = None,
    scheduler: Scheduler = None,
    out: Path | None = None,
    use: Annotated[list[str] | None, Parameter(negative="")] = None,
    settings: Annotated[list[Path] | None, Parameter(negative="")] = None,
    json: Flag = False,
) -> None:
    """Recompute a study, a published one or the comparison of all estimators; write a folder with report and results.

    Args:
        study: Name of a study (`flightbed list studies`).
        runs: Number of flights of each case. Default: set by the study.
        out: Folder to write; replaces an earlier study there. Default: studies/NAME, or studies/NAME-2, ... if that exists.
        use: MODULE:ATTRIBUTE or FILE.py:ATTRIBUTE: your own estimator, added to the study `estimators`. Repeat --use for each.
        settings: TOML file with the settings of an estimator in the study `estimators`, your own or a further built-in one: the
            keys of one `[[estimators]]` table. Repeat --settings for each.
        json: Print only JSON on stdout: the content of results.json, and the folder.

    """
    from flightbed.config import families
    from flightbed.config.own_code import using
    from flightbed.core.files import check_target
    from flightbed.parallel.executor import opener
    from flightbed.studies.base import reproduce as recompute
    from flightbed.studies.base import with_own
    from flightbed.studies.folder import STUDY, write_study

    chosen = families.factory("studies", study)()
    if runs is not None and runs < 1:
        raise InputError(f"--runs: must be at least 1 (got {runs})")
    executor = opener(workers, scheduler)
    place = out if out is not None else Path("studies") / study
    target = check_target(place, STUDY, replace=out is not None)
    with using(*(use or ())):
        chosen = with_own(chosen, use or (), settings or ())
        with progress_bar() as progress:
            document = recompute(chosen, runs or chosen.runs, executor=executor, progress=progress)
    written = write_study(document, target, replace=out is not None)
    if json:
        print_json(document.to_dict(), written)
    else:
        print_lines(study_lines(document, written))


def study_lines(document: Document, written: Path) -> Iterator[RenderableType]:
    """Yield the first table of a study, without intervals if it is wide, the claims with their verdicts, and the folder."""
    from flightbed.document.document import show

    first, claims, facts = document.tables()[0], document.claims(), document.facts
    wide = len(first.columns) > _WIDE
    yield Text(document.title, style="bold")
    grid = table(padding=(0, 1, 0, 0) if wide else (0, 1))
    for i, column in enumerate(first.columns):
        grid.add_column(escape(column), no_wrap=not wide or i == 0, overflow="fold" if wide else "ellipsis")
    for row in first.rows:
        grid.add_row(*(escape(cell) for cell in first.cell_texts(without_intervals(row) if wide else row)))
    yield grid
    yield Padding(Text(first.note, style="dim"), (0, 1))
    verdicts = Table(box=None, show_header=False, padding=(0, 1))
    for claim in claims:
        verdict = {True: "[green]holds[/green]", False: "[red]no[/red]", None: "[dim]open[/dim]"}[claim.holds]
        verdicts.add_row(
            verdict, f"{escape(claim.text)} [dim]{escape(claim.measured)}: {show(claim.interval, '.3g')}[/dim]"
        )
    yield verdicts
    held = sum(bool(claim.holds) for claim in claims)
    judged = f"{held} of {len(claims)} claims hold; " if claims else ""
    drawn = f"{len(document.pictures())} figures; " if document.pictures() else ""
    yield (
        f"  {judged}{facts['flights']} runs in {facts['wall_time_s']:.0f} s; {drawn}written to {escape(str(written))}"
    )
