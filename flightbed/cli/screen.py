"""Terminal output: results -> lines and tables, and a progress bar."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console, RenderableType
from rich.markup import escape
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from flightbed.analysis.events import failures
from flightbed.analysis.metrics import PHASES
from flightbed.analysis.summary_text import correction, followed, outcome, pace_text
from flightbed.document.document import Table as Rows
from flightbed.document.document import show
from flightbed.statistics.intervals import Interval

if TYPE_CHECKING:
    from flightbed.analysis.comparison import Run
    from flightbed.analysis.metrics import EstimatorMetrics, Metrics
    from flightbed.analysis.result import Result
    from flightbed.analysis.summary import RunSummary
    from flightbed.campaigns.result import Campaign
    from flightbed.document.document import Document

_WIDE = 7  # most columns that a terminal shows with their intervals
_POINTS = 20  # most points of a campaign with a table on a terminal


@contextmanager
def progress_bar() -> Iterator[Callable[[int, int], None]]:
    """Show progress on stderr, if it is a terminal: flights done, rate, time left; yields the function to update it."""
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        ProgressColumn,
        Task,
        TextColumn,
        TimeRemainingColumn,
    )

    class Rate(ProgressColumn):
        def render(self, task: Task) -> Text:
            return Text("" if task.speed is None else f"{task.speed:.3g} flights/s", style="dim")

    screen = Console(stderr=True)
    columns = (TextColumn("flying"), BarColumn(), MofNCompleteColumn(), Rate(), TimeRemainingColumn())
    with Progress(*columns, console=screen, transient=True, disable=not screen.is_terminal) as bar:
        task = bar.add_task("", total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


def run_lines(result: Result) -> Iterator[RenderableType]:
    """Yield the lines on a flight."""
    summary, scenario = result.summary, result.plan.scenario
    trim, metrics, gains_of_law = summary.trim, summary.metrics, summary.gains
    poles = ", ".join(f"{p.real:+.2f}{f'{p.imag:+.2f}j' if p.imag else ''}" for p in summary.short_period.poles_rad_s)
    values = {} if gains_of_law is None else asdict(gains_of_law)
    gains = ", ".join(f"{name} {value:.3g}" for name, value in values.items() if value)
    color = "green" if summary.ended == "time" else "red"
    yield Text.from_markup(f"[bold]{scenario.name}[/bold]: {escape(scenario.description)}")
    grid = Table.grid(padding=(0, 1))
    grid.add_column(style="dim", no_wrap=True)
    grid.add_column()
    for name, text in {
        "condition": f"{result.plan.aircraft.name}, Mach {scenario.condition.mach:g}, {scenario.condition.altitude_ft:,.0f} ft",
        "trim": f"alpha {trim.alpha_deg:.3f} deg, elevator {trim.elevator_deg:.3f} deg, residual {trim.residual:.0e}",
        "poles": f"{poles} rad/s, short period, open loop",
        "law": f"{scenario.control.law}, {correction(scenario)}",
        **({"gains": gains} if gains else {}),
        "failures": "; ".join(failures(scenario)) or "none",
        "outcome": f"[bold {color}]{outcome(summary)}[/bold {color}]; |alpha| up to "
        f"{abs(result.trace['alpha_deg']).max():.1f} deg; at a stop {_number(summary.elevator_at_stop_share, '.0%')} of the time",
        "tracking": "\n".join(_tracked(summary, *one) for one in followed(scenario)),
        **({"pull-up": _pull_up(metrics)} if metrics.pull_up_overshoot is not None else {}),
        **({"own code": _own_code(summary)} if summary.extensions else {}),
        **({"real time": pace_text(summary.realtime, summary.flown_s)} if summary.realtime else {}),
    }.items():
        grid.add_row(f"  {name}", text)
    yield grid
    if metrics.estimators:
        yield _estimates(metrics)
    yield f"  {summary.flown_s:g} s flown in {summary.wall_time_s:.2f} s; written to {escape(str(result.folder))}"


def comparison_lines(runs: Sequence[Run], written: Path) -> Iterator[RenderableType]:
    """Yield the lines on compared runs: metrics, settings that differ, folder."""
    from flightbed.analysis.comparison import differing, metrics_table

    for table in (metrics_table(runs), differing(runs)):
        if not table.rows:
            yield "All settings are the same."
            continue
        yield Text(table.title, style="bold")
        grid = Table(box=None, header_style="dim", padding=(0, 1))
        for column in table.columns:
            grid.add_column(escape(column), overflow="fold")
        for row in table.rows:
            grid.add_row(*(escape(cell) for cell in table.cell_texts(row)))
        yield grid
        if table.note:
            yield Padding(Text(table.note, style="dim"), (0, 1))
    yield f"  written to {escape(str(written))}; look: flightbed view {escape(str(written))}"


def _own_code(summary: RunSummary) -> str:
    return escape(
        "; ".join(f"{own.name} (sha256 {own.sha256[:12] if own.sha256 else 'unknown'})" for own in summary.extensions)
    )


def _tracked(summary: RunSummary, what: str, key: str, unit: str) -> str:
    """Return the tracking RMS of one quantity of ``summary_text.followed`` in words."""
    before, after = (summary.metrics.tracking_rms(phase, key) for phase in PHASES)
    words = f"RMS of {what} {_number(before)} {unit}"
    return words if summary.failed_at_s is None else f"{words}, {_number(after)} {unit} from 0.3 s after the failure"


def _pull_up(metrics: Metrics) -> str:
    """Return the metrics of a pull-up in words."""
    under, flutter = metrics.pull_up_undershoot, metrics.pull_up_flutter_deg
    return (
        f"overshoot {_number(metrics.pull_up_overshoot, '.1%')}"
        f"{'' if under is None else f', undershoot {under:.1%}'}"
        f"{'' if flutter is None else f'; elevator above 5 Hz {flutter:.2f} deg RMS'}"
    )


def _estimates(metrics: Metrics) -> Table:
    table = Table(box=None, header_style="dim", padding=(0, 1, 0, 0))
    for heading in ("  estimator", "K at end", "median", "smoothed,", "first in", "smoothed", "NIS"):
        table.add_column(heading, justify="left" if "estimator" in heading else "right", no_wrap=True)
    table.add_row("", "", "|error|", "RMS error", "+-20 %", "in +-20 %", "(expected)", style="dim")
    for name, m in metrics.estimators.items():
        table.add_row(
            f"  {name}",
            _number(m.final, ".3f"),
            _number(m.median_abs_error_post, ".3f"),
            _number(m.rms_error_smoothed_post, ".3f"),
            _number(m.first_within_20pct_s, ".2f", " s"),
            _number(m.first_within_20pct_smoothed_s, ".2f", " s"),
            nis_words(m),
        )
    return table


def nis_words(measured: EstimatorMetrics) -> str:
    """Return the mean NIS, and in brackets its expectation under the estimator's model."""
    expected = measured.nis_expected
    return _number(measured.nis_mean) + ("" if expected is None else f" ({expected:g})")


def _number(value: float | None, spec: str = ".2f", unit: str = "") -> str:
    return "-" if value is None else format(value, spec) + unit


def campaign_lines(campaign: Campaign, written: Path) -> Iterator[RenderableType]:
    """Yield the lines on a campaign: headline, medians, points, the worst flight, folder."""
    from flightbed.campaigns.report.headline import headline_section
    from flightbed.campaigns.report.points import points_table

    first = headline_section(campaign)
    yield Text.from_markup(f"[bold]{campaign.programme.name}[/bold]: {escape(campaign.programme.description)}")
    for paragraph in first.text:
        yield Padding(escape(paragraph), (0, 2))
    few = 1 < len(campaign.programme.points) <= _POINTS
    for table in (*first.items, *([_without("flights", points_table(campaign, estimators=()))] if few else [])):
        if isinstance(table, Rows):
            grid = Table(box=None, header_style="dim", padding=(0, 1))
            for column in table.columns:
                words = max(map(len, column.split()))  # a heading is broken between them alone
                grid.add_column(escape(column), no_wrap=column == "estimator", min_width=words)
            for row in table.rows:
                medians = [cell.estimate if isinstance(cell, Interval) else cell for cell in row]
                grid.add_row(*(escape(cell) for cell in table.cell_texts(medians)))
            yield Padding(grid, (0, 1))
    summary = campaign.summary
    if summary.worst is not None:
        yield f"  again: flightbed run {escape(str(written))}/scenario.toml{escape(summary.worst.options)}"
    yield f"  {summary.flights.flights} flights in {summary.wall_time_s:.1f} s; written to {escape(str(written))}"


def _without(column: str, table: Rows) -> Rows:
    """Return a table without a column."""
    kept = [i for i, name in enumerate(table.columns) if name != column]
    return replace(table, columns=[table.columns[i] for i in kept], rows=[[row[i] for i in kept] for row in table.rows])


def study_lines(document: Document, written: Path) -> Iterator[RenderableType]:
    """Yield the lines on a study: its first table, its claims, folder. A table of many columns shows estimates without intervals."""
    table, claims, facts = document.tables()[0], document.claims(), document.facts
    wide = len(table.columns) > _WIDE
    yield Text(document.title, style="bold")
    grid = Table(box=None, header_style="dim", padding=(0, 1, 0, 0) if wide else (0, 1))
    for i, column in enumerate(table.columns):
        grid.add_column(escape(column), no_wrap=not wide or i == 0, overflow="fold" if wide else "ellipsis")
    for row in table.rows:
        cells = [cell.estimate if wide and isinstance(cell, Interval) else cell for cell in row]
        grid.add_row(*(escape(cell) for cell in table.cell_texts(cells)))
    yield grid
    yield Padding(Text(table.note, style="dim"), (0, 1))
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


def list_lines(family: str | None) -> Iterator[RenderableType]:
    """Yield names and descriptions, one per line, of one family or of all."""
    from flightbed.config import families
    from flightbed.config.reading import read_toml
    from flightbed.core import data
    from flightbed.models.linear_aircraft import load_flyable
    from flightbed.scenario.reading import load_scenario

    def entries(family: str) -> list[tuple[str, str]]:
        if family == "aircraft":
            return [(name, load_flyable(name).description) for name in data.names("aircraft")]
        if family == "scenarios":
            return [(name, load_scenario(name).description) for name in data.names("scenario")]
        if family == "campaigns":
            return [(name, str(read_toml(data.find_flights(name))["description"])) for name in data.names("campaign")]
        return [(name, families.summary(family, name)) for name in families.names(family)]

    for one in [family] if family else ["aircraft", "scenarios", "campaigns", *families.FAMILIES]:
        if not family:
            yield f"[bold]{one}[/bold]"
        found = entries(one)
        width = max((len(name) for name, _ in found), default=0)
        for name, text in found:
            yield f"{'' if family else '  '}{name:<{width}}  {escape(text)}"
