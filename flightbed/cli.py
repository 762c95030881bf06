"""The command line: arguments -> the functions of the package; prints; exit codes."""

from __future__ import annotations

import json as json_module
import signal
import sys
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, NoReturn

from cyclopts import App, CycloptsError, Parameter
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from flightbed.errors import FlightbedError, OutputError

if TYPE_CHECKING:
    from flightbed.mission import Result

INTERRUPTED = 130

app = App(
    name="flightbed",
    help="A testbed for flight control under loss of control effectiveness, on JSBSim's nonlinear F-16.",
    version=lambda: version("flightbed"),
    suppress_keyboard_interrupt=False,
    print_error=False,
    exit_on_error=False,
    result_action="return_value",
)
_out = Console(highlight=False)


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run the command line; exit code 0 done, 2 bad input, 3 not computable, 130 interrupted."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))  # unwind: scratch folders go
    try:
        code = app(arguments)
    except CycloptsError as error:
        code = _fail(str(error).replace("\n", " "), 2)
    except FlightbedError as error:
        code = _fail(str(error), error.exit_code)
    except KeyboardInterrupt:
        code = _fail("interrupted; nothing was written", INTERRUPTED)
    except BrokenPipeError:  # the reader of our output has gone: not our failure
        sys.stderr.close()
        code = 0
    sys.exit(code if isinstance(code, int) else 0)


def _fail(message: str, code: int) -> int:
    for line in message.splitlines():
        print(f"flightbed: {line}", file=sys.stderr)  # noqa: T201
    return code


@app.command
def run(
    scenario: str,
    /,
    *,
    out: Path | None = None,
    set_: Annotated[list[str] | None, Parameter(name="--set", negative="", show_default=False)] = None,
    rerun: Literal["save", "off"] = "save",
    json: Annotated[bool, Parameter(negative="", show_default=False)] = False,
) -> None:
    """Fly one scenario and leave a folder with scenario, trace, metrics and Rerun recording.

    Args:
        scenario: A shipped name (see `flightbed list scenarios`) or the path of a TOML file.
        out: Folder to write; an earlier run in it is replaced. Without it: runs/NAME, or runs/NAME-2, ... if that exists.
        set_: KEY=VALUE, replaces one key of the scenario, for example failures.0.to=0.35. May be repeated.
        rerun: Whether to write the Rerun recording.
        json: Print metrics.json, and nothing else, on stdout.

    """
    from flightbed.folder import free_folder
    from flightbed.mission import run as fly
    from flightbed.scenario import load_scenario

    settings = load_scenario(scenario, set_ or ())
    result = fly(settings, out if out is not None else free_folder(settings.name), rerun=rerun == "save")
    if json:
        print(json_module.dumps({**result.summary, "folder": str(result.folder)}, indent=2))  # noqa: T201
    else:
        _show(result)


@app.command
def view(run_folder: str, /) -> int:
    """Open the recording of a run, with its layout, in the Rerun viewer.

    Args:
        run_folder: A folder that `flightbed run` wrote.

    """
    from flightbed.folder import folder_of
    from flightbed.telemetry import view as show

    recording = folder_of(run_folder) / "flight.rrd"
    if not recording.is_file():
        raise OutputError(f"{recording}: there is no recording; fly the scenario again with --rerun save")
    return show(recording)


Family = Literal["aircraft", "scenarios", "estimators", "laws", "failures", "commands"]


@app.command(name="list")
def list_(family: Family | None = None, /) -> None:
    """List what there is, one line each.

    Args:
        family: Only this family.

    """
    from flightbed import data, registry
    from flightbed.aircraft import load_aircraft
    from flightbed.scenario import load_scenario

    def lines(family: str) -> list[tuple[str, str]]:
        if family == "aircraft":
            return [(name, load_aircraft(name).description) for name in data.names("aircraft")]
        if family == "scenarios":
            return [(name, load_scenario(name).description) for name in data.names("scenario")]
        return [(name, registry.summary(family, name)) for name in registry.names(family)]

    for name in [family] if family else ["aircraft", "scenarios", *registry.FAMILIES]:
        if not family:
            _out.print(f"[bold]{name}[/bold]")
        entries = lines(name)
        width = max(len(entry) for entry, _ in entries)
        for entry, text in entries:
            _out.print(f"{'' if family else '  '}{entry:<{width}}  {escape(text)}", soft_wrap=True)


def _show(result: Result) -> None:
    summary, scenario = result.summary, result.plan.scenario
    trim, gains = result.plan.trim, summary["gains"]
    _out.print(f"[bold]{scenario.name}[/bold]  {escape(scenario.description)}", soft_wrap=True)
    poles = ", ".join(f"{re:+.2f}{f'{im:+.2f}j' if im else ''}" for re, im in summary["short_period"]["poles_rad_s"])
    _out.print(
        f"  {scenario.aircraft.model} at Mach {scenario.condition.mach:g}, {scenario.condition.altitude_ft:,.0f} ft: "
        f"alpha {summary['trim']['alpha_deg']:.3f} deg, elevator {summary['trim']['elevator_deg']:.3f} deg, "
        f"residual {trim.residual:.0e}; short-period poles {poles} rad/s",
        soft_wrap=True,
    )
    _out.print(
        f"  law {scenario.control.law}: " + ", ".join(f"{k} {v:.4g}" for k, v in gains.items() if v), soft_wrap=True
    )
    failed = summary["failed_at_s"]
    if summary["departed"]:
        when = summary["departed_at_s"]
        after = f", {when - failed:.2f} s after the failure" if failed is not None and when > failed else ""
        _out.print(f"  [bold red]departed at {when:.2f} s{after}[/bold red]")
    else:
        _out.print(
            f"  [bold green]flown to {summary['flown_s']:g} s[/bold green], "
            f"largest |alpha| {abs(result.trace['alpha_deg']).max():.1f} deg"
        )
    _out.print(
        f"  tracking RMS of q: {_number(summary['tracking_rms_pre_deg_s'])} deg/s"
        + ("" if failed is None else f" before, {_number(summary['tracking_rms_post_deg_s'])} deg/s after the failure")
    )
    if summary["estimators"]:
        _out.print(_estimates(summary))
    _out.print(
        f"  {summary['flown_s']:g} s flown in {summary['wall_time_s']:.2f} s; written to {escape(str(result.folder))}",
        soft_wrap=True,
    )


def _estimates(summary: dict[str, Any]) -> Table:
    table = Table(box=None, header_style="dim", padding=(0, 1))
    table.add_column("  estimator", no_wrap=True)
    for heading in ("final K", "|error|", "smoothed", "in 20 %", "smoothed", "mean NIS"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_row("", "", "median", "RMS", "after", "after", "(2)", style="dim")
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
