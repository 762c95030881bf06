"""The command `flightbed run`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from rich.console import RenderableType
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from flightbed.cli.app import Flag, Set, Use, print_error
from flightbed.cli.completion import ScenarioName
from flightbed.cli.screen import print_json, print_lines, table
from flightbed.core.errors import InputError

if TYPE_CHECKING:
    from flightbed.analysis.metrics import EstimatorMetrics, Metrics
    from flightbed.analysis.result import Result
    from flightbed.analysis.summary import RunSummary


def run(
    scenario: ScenarioName,
    /,
    *,
    out: Path | None = None,
    set_: Set = None,
    use: Use = None,
    rerun: Literal["save", "live", "off"] = "save",
    viewer: str | None = None,
    report: Literal["save", "off"] = "save",
    realtime: Flag = False,
    json: Flag = False,
) -> None:
    """Fly one scenario; write a folder with scenario, trace, metrics, Rerun recording and report.

    Args:
        scenario: Name of a shipped scenario (`flightbed list scenarios`) or path of a TOML file.
        out: Folder to write; replaces an earlier run there. Default: runs/NAME, or runs/NAME-2, ... if that exists.
        rerun: save writes the Rerun recording; live also shows the flight in the viewer while it flies.
        viewer: HOST:PORT of the viewer for --rerun live. Default: the viewer on this computer, opened if none is running.
        report: save writes report.html, a page with figures.
        realtime: Fly in real time; report late ticks, jitter and compute time.
        json: Print only JSON on stdout: the content of metrics.json, and the folder.

    """
    from flightbed.config.own_code import using
    from flightbed.flight.pacing import WallClock
    from flightbed.runs.run import run as fly
    from flightbed.scenario.own_code import check_named
    from flightbed.scenario.reading import read_scenario
    from flightbed.telemetry.live import Live, address

    if viewer is not None and rerun != "live":
        raise InputError(f"--viewer {viewer}: has no effect without --rerun live")
    live = Live(*address(viewer), print_error) if rerun == "live" else None
    with using(*(use or ())):
        reading = read_scenario(scenario, set_ or ())
        settings = reading.scenario
        for note in reading.notes:
            print_error(note)
        check_named(settings, use or ())
        place = out if out is not None else Path("runs") / settings.name
        pace = WallClock() if realtime else None
        parts = {"rerun": rerun != "off", "report": report == "save"}
        result = fly(settings, place, **parts, replace=out is not None, pace=pace, live=live)
    for note in result.plan.notes:
        print_error(note)
    if json:
        print_json(result.summary.to_dict(), result.folder)
    else:
        print_lines(run_lines(result))


def run_lines(result: Result) -> Iterator[RenderableType]:
    """Yield the settings and the outcome of a flight, a table of its estimates, and the folder."""
    from flightbed.analysis.events import failures
    from flightbed.analysis.summary_text import correction, followed, outcome, pace_text

    summary, scenario = result.summary, result.plan.scenario
    trim, metrics = summary.trim, summary.metrics
    poles = ", ".join(f"{p.real:+.2f}{f'{p.imag:+.2f}j' if p.imag else ''}" for p in summary.short_period.poles_rad_s)
    designed = {} if summary.gains is None else asdict(summary.gains)
    gains = ", ".join(f"{name} {value:.3g}" for name, value in designed.items() if value)
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
        "tracking": "\n".join(_tracking(summary, *quantity) for quantity in followed(scenario)),
        **({"pull-up": _pull_up(metrics)} if metrics.pull_up_overshoot is not None else {}),
        **({"own code": _own_code(summary)} if summary.extensions else {}),
        **({"real time": pace_text(summary.realtime, summary.flown_s)} if summary.realtime else {}),
    }.items():
        grid.add_row(f"  {name}", text)
    yield grid
    if metrics.estimators:
        yield _estimates(metrics)
    yield f"  {summary.flown_s:g} s flown in {summary.wall_time_s:.2f} s; written to {escape(str(result.folder))}"


def _tracking(summary: RunSummary, error: str, key: str, unit: str) -> str:
    """Return the tracking RMS of one quantity of ``summary_text.followed`` in words."""
    from flightbed.analysis.metrics import PHASES

    before, after = (summary.metrics.tracking_rms(phase, key) for phase in PHASES)
    words = f"RMS of {error} {_number(before)} {unit}"
    return words if summary.failed_at_s is None else f"{words}, {_number(after)} {unit} from 0.3 s after the failure"


def _pull_up(metrics: Metrics) -> str:
    """Return the metrics of a pull-up in words."""
    under, flutter = metrics.pull_up_undershoot, metrics.pull_up_flutter_deg
    return (
        f"overshoot {_number(metrics.pull_up_overshoot, '.1%')}"
        f"{'' if under is None else f', undershoot {under:.1%}'}"
        f"{'' if flutter is None else f'; elevator above 5 Hz {flutter:.2f} deg RMS'}"
    )


def _own_code(summary: RunSummary) -> str:
    """Return names and hashes of the code outside flightbed."""
    return escape(
        "; ".join(f"{own.name} (sha256 {own.sha256[:12] if own.sha256 else 'unknown'})" for own in summary.extensions)
    )


def _estimates(metrics: Metrics) -> Table:
    """Return the table of the estimators' errors, a row each."""
    grid = table(padding=(0, 1, 0, 0))
    for heading in ("  estimator", "K at end", "median", "smoothed,", "first in", "smoothed", "NIS"):
        grid.add_column(heading, justify="left" if "estimator" in heading else "right", no_wrap=True)
    grid.add_row("", "", "|error|", "RMS error", "+-20 %", "in +-20 %", "(expected)", style="dim")
    for name, m in metrics.estimators.items():
        grid.add_row(
            f"  {name}",
            _number(m.final, ".3f"),
            _number(m.median_abs_error_post, ".3f"),
            _number(m.rms_error_smoothed_post, ".3f"),
            _number(m.first_within_20pct_s, ".2f", " s"),
            _number(m.first_within_20pct_smoothed_s, ".2f", " s"),
            _nis(m),
        )
    return grid


def _nis(measured: EstimatorMetrics) -> str:
    """Return the mean NIS and, in brackets, its expectation under the estimator's model."""
    expected = measured.nis_expected
    return _number(measured.nis_mean) + ("" if expected is None else f" ({expected:g})")


def _number(value: float | None, spec: str = ".2f", unit: str = "") -> str:
    return "-" if value is None else format(value, spec) + unit
