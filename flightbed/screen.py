"""What the command line shows: results -> lines and tables for a terminal; prints nothing."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import RenderableType
from rich.markup import escape
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from flightbed.card import correction, failures, kept_pace, outcome
from flightbed.document import show

if TYPE_CHECKING:
    from flightbed.comparison import Run
    from flightbed.document import Document
    from flightbed.mission import Result


def run_lines(result: Result) -> Iterator[RenderableType]:
    """Tell how a flight went."""
    summary, scenario = result.summary, result.plan.scenario
    trim = summary["trim"]
    poles = ", ".join(f"{re:+.2f}{f'{im:+.2f}j' if im else ''}" for re, im in summary["short_period"]["poles_rad_s"])
    gains = ", ".join(f"{name} {value:.3g}" for name, value in summary["gains"].items() if value)
    before, after = summary["tracking_rms_pre_deg_s"], summary["tracking_rms_post_deg_s"]
    color = "green" if summary["ended"] == "time" else "red"
    yield Text.from_markup(f"[bold]{scenario.name}[/bold]: {escape(scenario.description)}")
    grid = Table.grid(padding=(0, 1))
    grid.add_column(style="dim", no_wrap=True)
    grid.add_column()
    for name, text in {
        "condition": f"{result.plan.aircraft.name}, Mach {scenario.condition.mach:g}, {scenario.condition.altitude_ft:,.0f} ft",
        "trim": f"alpha {trim['alpha_deg']:.3f} deg, elevator {trim['elevator_deg']:.3f} deg, residual {trim['residual']:.0e}",
        "poles": f"{poles} rad/s, short period, open loop",
        "law": f"{scenario.control.law}, {correction(scenario)}",
        "gains": gains,
        "failures": "; ".join(failures(scenario)) or "none",
        "outcome": f"[bold {color}]{outcome(summary)}[/bold {color}]; |alpha| up to "
        f"{abs(result.trace['alpha_deg']).max():.1f} deg; at a stop {summary['elevator_at_stop_share']:.0%} of the time",
        "tracking": f"RMS of q - q_ref {_number(before)} deg/s"
        + ("" if summary["failed_at_s"] is None else f", {_number(after)} deg/s from 0.3 s after the failure"),
        **({"own code": _own_code(summary)} if summary["extensions"] else {}),
        **({"real time": kept_pace(summary)} if summary["realtime"] else {}),
    }.items():
        grid.add_row(f"  {name}", text)
    yield grid
    if summary["estimators"]:
        yield _estimates(summary)
    yield f"  {summary['flown_s']:g} s flown in {summary['wall_time_s']:.2f} s; written to {escape(str(result.folder))}"


def comparison_lines(runs: Sequence[Run], written: Path) -> Iterator[RenderableType]:
    """Tell how runs differ: metrics, settings, and where the rest is."""
    from flightbed.comparison import differing, metrics_table

    for table in (metrics_table(runs), differing(runs)):
        if not table.rows:
            yield "All settings are the same."
            continue
        yield Text(table.title, style="bold")
        grid = Table(box=None, header_style="dim", padding=(0, 1))
        for column in table.columns:
            grid.add_column(escape(column))
        for row in table.rows:
            grid.add_row(*(escape(cell) for cell in table.shown(row)))
        yield grid
    yield f"  written to {escape(str(written))}; look: flightbed view {escape(str(written))}"


def _own_code(summary: dict[str, Any]) -> str:
    return escape(
        "; ".join(
            f"{own['name']} (sha256 {own['sha256'][:12] if own['sha256'] else 'unknown'})"
            for own in summary["extensions"]
        )
    )


def _estimates(summary: dict[str, Any]) -> Table:
    table = Table(box=None, header_style="dim", padding=(0, 1))
    for heading in ("  estimator", "K at end", "median", "smoothed,", "first in", "smoothed", "NIS"):
        table.add_column(heading, justify="left" if "estimator" in heading else "right", no_wrap=True)
    table.add_row("", "", "|error|", "RMS error", "+-20 %", "in +-20 %", "(2 is right)", style="dim")
    for name, m in summary["estimators"].items():
        table.add_row(
            f"  {name}",
            _number(m["final"], ".3f"),
            _number(m["median_abs_error_post"], ".3f"),
            _number(m["rms_error_smoothed_post"], ".3f"),
            _number(m["first_within_20pct_s"], ".2f", " s"),
            _number(m["first_within_20pct_smoothed_s"], ".2f", " s"),
            _number(m["nis_mean"]),
        )
    return table


def _number(value: float | None, spec: str = ".2f", unit: str = "") -> str:
    return "-" if value is None else format(value, spec) + unit


def study_lines(document: Document, written: Path) -> Iterator[RenderableType]:
    """Tell what a study found: its first table, its claims, and where the rest is."""
    table, claims, facts = document.tables()[0], document.claims(), document.facts
    yield Text(document.title, style="bold")
    grid = Table(box=None, header_style="dim", padding=(0, 1))
    for column in table.columns:
        grid.add_column(escape(column), no_wrap=True)
    for row in table.rows:
        grid.add_row(*(escape(cell) for cell in table.shown(row)))
    yield grid
    yield Padding(Text(table.note, style="dim"), (0, 1))
    told = Table(box=None, show_header=False, padding=(0, 1))
    for claim in claims:
        verdict = {True: "[green]holds[/green]", False: "[red]no[/red]", None: "[dim]open[/dim]"}[claim.holds]
        told.add_row(
            verdict, f"{escape(claim.text)} [dim]{escape(claim.measured)}: {show(claim.interval, '.3g')}[/dim]"
        )
    yield told
    held = sum(bool(claim.holds) for claim in claims)
    yield (
        f"  {held} of {len(claims)} claims hold; {facts['flights']} flights in {facts['wall_time_s']:.0f} s; "
        f"{len(document.pictures())} figures; written to {escape(str(written))}"
    )
