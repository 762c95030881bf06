"""The command line: arguments -> the functions of the package; prints; exit codes."""

from __future__ import annotations

import json as json_module
import os
import signal
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Literal, NoReturn

from cyclopts import App, CycloptsError, Parameter
from rich.console import Console, RenderableType

from flightbed.core.errors import FlightbedError, InputError, OutputError

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


class _Out(Console):
    def on_broken_pipe(self) -> None:  # rich would exit with 1
        raise BrokenPipeError


_out = _Out(highlight=False)

Flag = Annotated[bool, Parameter(negative="", show_default=False)]
Several = Annotated[list[str] | None, Parameter(negative="", show_default=False)]
Sets = Annotated[list[str] | None, Parameter(name="--set", negative="", show_default=False)]


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run the command line; exit code 0 done, 2 bad input, 3 not computable, 130 interrupted."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))  # unwind: scratch folders go
    try:
        code = app(arguments)
    except CycloptsError as error:
        code = _fail(str(error).replace("\n", " "), 2)
    except FlightbedError as error:
        code = _fail(str(error), error.exit_code)
    except KeyboardInterrupt as stop:
        code = _fail(str(stop) or "interrupted; nothing was written", INTERRUPTED)
    except BrokenPipeError:  # the reader of our output has gone: not our failure
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # or the flush at exit complains
        code = 0
    sys.exit(code if isinstance(code, int) else 0)


def _print(lines: Iterable[RenderableType]) -> None:
    for line in lines:
        _out.print(line, soft_wrap=isinstance(line, str))


def _fail(message: str, code: int) -> int:
    for line in message.splitlines():
        print(f"flightbed: {line}", file=sys.stderr)
    return code


@app.command
def run(
    scenario: str,
    /,
    *,
    out: Path | None = None,
    set_: Sets = None,
    use: Several = None,
    rerun: Literal["save", "live", "off"] = "save",
    viewer: Annotated[str | None, Parameter(show_default=False)] = None,
    report: Literal["save", "off"] = "save",
    realtime: Flag = False,
    json: Flag = False,
) -> None:
    """Fly one scenario and leave a folder with scenario, trace, metrics, Rerun recording and report.

    Args:
        scenario: A shipped name (see `flightbed list scenarios`) or the path of a TOML file.
        out: Folder to write; an earlier run in it is replaced. Without it: runs/NAME, or runs/NAME-2, ... if that exists.
        set_: KEY=VALUE, replaces one key of the scenario, as in --set failures.0.to=0.35; repeat --set for each key.
        use: MODULE:ATTRIBUTE or FILE.py:ATTRIBUTE, code outside flightbed that the scenario names and that may be imported and run;
            repeat --use for each.
        rerun: save writes the Rerun recording; live shows the flight in the viewer too, while it flies.
        viewer: HOST:PORT of the viewer that live shows it in; without it one on this computer, opened if there is none.
        report: Whether to write the report, a page with figures.
        realtime: Fly at the pace of the clock, and tell how well it was kept.
        json: Print the content of metrics.json, and the folder, as JSON and nothing else on stdout.

    """
    from flightbed.config.own_code import using
    from flightbed.flight.pacing import WallClock
    from flightbed.runs.run import run as fly
    from flightbed.scenario.own_code import check_named
    from flightbed.scenario.reading import load_scenario
    from flightbed.telemetry.live import Live, address

    if viewer is not None and rerun != "live":
        raise InputError(f"--viewer {viewer}: has no effect without --rerun live")
    live = Live(*address(viewer), lambda text: _fail(text, 0)) if rerun == "live" else None
    with using(*(use or ())):
        settings = load_scenario(scenario, set_ or ())
        check_named(settings, use or ())
        place = out if out is not None else Path("runs") / settings.name
        pace = WallClock() if realtime else None
        parts = {"rerun": rerun != "off", "report": report == "save"}
        result = fly(settings, place, **parts, replace=out is not None, pace=pace, live=live)
    if json:
        print(json_module.dumps({**result.summary.to_dict(), "folder": str(result.folder)}, indent=2))
    else:
        from flightbed.cli.screen import run_lines

        _print(run_lines(result))


@app.command
def view(
    run_folder: str,
    /,
    *,
    picture: Path | None = None,
    at_s: float | None = None,
    tab: str | None = None,
) -> int:
    """Open the recording of a run, with its layout, in the Rerun viewer.

    Args:
        run_folder: A folder that `flightbed run` or `flightbed compare` wrote.
        picture: Write what the viewer shows to this PNG file instead; needs no display.
        at_s: Flight time in the picture, s; the end of the flight without it.
        tab: Page in the picture: overview, estimators, airframe, or roll and yaw, where they are flown.

    """
    from flightbed.runs.folder import recording_of
    from flightbed.telemetry import viewer

    recording = recording_of(run_folder)
    if picture is not None:
        viewer.picture(recording, picture, at_s=at_s, tab=tab)
        return 0
    for option, value in (("--at-s", at_s), ("--tab", tab)):
        if value is not None:
            raise InputError(f"{option} {value}: has no effect without --picture")
    if not viewer.has_display():
        raise OutputError(
            f"there is no display for the viewer; write a picture, --picture FILE.png, or copy {recording} to a machine that has one, "
            f"or serve it to a browser: rerun --bind 127.0.0.1 --web-viewer {recording}"
        )
    return viewer.view(recording)


@app.command
def compare(
    *runs: str,
    out: Path | None = None,
    json: Flag = False,
) -> None:
    """Put runs side by side: metrics and differences, one recording on one time axis, a report page.

    Args:
        runs: Folders that `flightbed run` wrote, two or more; differences are from the first.
        out: Folder to write; an earlier comparison in it is replaced. Without it: comparisons/FIRST-SECOND-..., or ...-2 if that exists.
        json: Print what comparison.json holds, and the folder, as JSON and nothing else on stdout.

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
        print(json_module.dumps({**comparison.to_dict(read), "folder": str(written)}, indent=2))
    else:
        from flightbed.cli.screen import comparison_lines

        _print(comparison_lines(read, written))


@Parameter(name="*")
@dataclass(frozen=True)
class ConditionOptions:
    """Where to trim; --altitude-ft and the speed also take lists and a:b:step, and then sweep."""

    mach: str | None = None
    "Mach number."
    tas_fps: str | None = None
    "True airspeed, ft/s."
    cas_kt: str | None = None
    "Calibrated airspeed, kt."
    altitude_ft: str = "20000"
    "Geometric altitude, ft."
    gamma_deg: float = 0.0
    "Flight-path angle, deg."
    load_factor: float | None = None
    "Of a pull-up with wings level, g."
    bank_deg: float = 0.0
    "Of a steady turn, right positive, deg."
    cg_shift_cbar: float = 0.0
    "C.g. shift in mean chords, aft positive."
    effectiveness: float = 1.0
    "Share K of the elevator's deflection that acts; overlay aircraft only."
    engine: Literal["steady", "frozen"] = "steady"
    "Spool, propeller speed and manifold pressure: at the steady state of every motion, or held as trimmed (then no throttle)."


@app.command
def trim(
    aircraft: str,
    /,
    *,
    condition: ConditionOptions | None = None,
    format_: Annotated[Literal["table", "json", "csv", "parquet"], Parameter(name="--format")] = "table",
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
) -> None:
    """Find steady flight (level, climbing, pulling up, turning): angle of attack and controls.

    Args:
        aircraft: A name under aircraft/, the path of such a folder, or an aircraft that ships with JSBSim (jsbsim:NAME where an
            overlay has that name).
        condition: Where.
        format_: table for people; json, csv or parquet for programs.
        output: Write to this file instead of stdout; needed for parquet.

    """
    from flightbed.models.survey import sweep

    plane, queries = sweep.read_conditions(aircraft, condition or ConditionOptions())
    _deliver(sweep.trim_all(plane, queries, format_, output), output)


@app.command
def linearize(
    aircraft: str,
    /,
    *,
    condition: ConditionOptions | None = None,
    format_: Annotated[Literal["table", "json", "csv", "parquet", "npz", "mat"], Parameter(name="--format")] = "table",
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    part: Literal["full", "longitudinal", "lateral", "short-period"] = "full",
    actuator: Flag = False,
    control_hz: float | None = None,
    validate: Flag = False,
    picture: Path | None = None,
) -> None:
    """Trim and linearize the rigid-body motion: matrices, modes, short period, discrete model.

    Args:
        aircraft: A name under aircraft/, the path of such a folder, or an aircraft that ships with JSBSim (jsbsim:NAME where an
            overlay has that name).
        condition: Where.
        format_: table for people; json, csv or parquet (a line a condition), npz or mat (one condition) for tools.
        output: Write to this file instead of stdout; needed for parquet, npz and mat.
        part: Which states.
        actuator: Add the elevator's actuator as a state; the input is then its command.
        control_hz: Rate of the discrete model in json, npz and mat; 100 if not given.
        validate: Fly small doublets through the aircraft too, at 200 and 400 Hz, and tell how far the model is; in json, and in
            the table of one condition.
        picture: Draw the stability map of a sweep to this png, svg or pdf.

    """
    from flightbed.models.survey import sweep

    plane, queries = sweep.read_conditions(aircraft, condition or ConditionOptions())
    options = sweep.ModelOptions(part, actuator, control_hz, validate)
    _deliver(sweep.linearize_all(plane, queries, format_, output, options, picture), output)


def _deliver(content: bytes, output: Path | None) -> None:
    from flightbed.core.files import write_atomic

    if output is not None:
        write_atomic(output, content)
        return
    sys.stdout.buffer.write(content)
    sys.stdout.buffer.flush()


@app.command
def campaign(
    file: str,
    /,
    *,
    runs: Annotated[int | None, Parameter(show_default=False)] = None,
    workers: Annotated[int | None, Parameter(show_default=False)] = None,
    scheduler: Annotated[str | None, Parameter(show_default=False)] = None,
    out: Path | None = None,
    resume: Flag = False,
    set_: Sets = None,
    use: Several = None,
    json: Flag = False,
) -> None:
    """Fly a campaign, many flights over what its file varies or one scenario with successive seeds; leave table, summary and report.

    Args:
        file: A shipped name (see `flightbed list campaigns` and `scenarios`) or the path of a campaign's or scenario's TOML file.
        runs: Flights at each point; without it what the file says, of a scenario 100.
        workers: Processes that fly, all cores without it; the results do not depend on it.
        scheduler: tcp://HOST:PORT of a dask scheduler whose workers fly instead; needs the extra `distributed`.
        out: Folder to write; a finished campaign in it is replaced. Without it: campaigns/NAME, or campaigns/NAME-2, ... if that exists.
        resume: Continue an unfinished campaign: fly only the missing flights.
        set_: KEY=VALUE, replaces one key of the (base) scenario, as in --set failures.0.to=0.35; repeat --set for each key.
        use: MODULE:ATTRIBUTE or FILE.py:ATTRIBUTE, code outside flightbed that the scenario names and that may be imported and run.
        json: Print the content of summary.json, and the folder, as JSON and nothing else on stdout.

    """
    from flightbed.campaigns import run as campaigns
    from flightbed.campaigns.file import load_programme
    from flightbed.cli.screen import campaign_lines, progress_bar
    from flightbed.config.own_code import using
    from flightbed.scenario.own_code import check_named

    with using(*(use or ())):
        with progress_bar() as progress:
            programme = load_programme(file, set_ or (), runs)
            check_named(programme.scenario, use or ())
            place = out if out is not None else Path("campaigns") / programme.name
            flown, written = campaigns.run(
                programme, place, workers=workers, scheduler=scheduler, replace=out is not None, resume=resume, progress=progress,
            )  # fmt: skip
        if json:
            stored = json_module.loads((written / "summary.json").read_text(encoding="utf-8"))
            print(json_module.dumps({**stored, "folder": str(written)}, indent=2))
        else:
            _print(
                campaign_lines(flown, written) if flown is not None else [f"nothing is missing; finished in {written}"]
            )


@app.command
def reproduce(
    study: str,
    /,
    *,
    runs: Annotated[int | None, Parameter(show_default=False)] = None,
    out: Path | None = None,
    workers: Annotated[int | None, Parameter(show_default=False)] = None,
    use: Several = None,
    settings: Annotated[list[Path] | None, Parameter(negative="", show_default=False)] = None,
    scheduler: Annotated[str | None, Parameter(show_default=False)] = None,
    json: Flag = False,
) -> None:
    """Recompute a study, a published one or the comparison of all estimators, and leave a folder with report and results.

    Args:
        study: A name; see `flightbed list studies`.
        runs: Flights of each case; without it, as many as the study takes.
        out: Folder to write; an earlier study in it is replaced. Without it: studies/NAME, or studies/NAME-2, ... if that exists.
        workers: Processes that fly, all cores without it; the results do not depend on it.
        scheduler: tcp://HOST:PORT of a dask scheduler whose workers fly instead; needs the extra `distributed`.
        use: MODULE:ATTRIBUTE or FILE.py:ATTRIBUTE, your own estimator as a further one in the study `estimators`; repeat --use for each.
        settings: TOML file with the keys of the `[[estimators]]` table of a further estimator; repeat --settings for each.
        json: Print what results.json holds, and the folder, as JSON and nothing else on stdout.

    """
    from flightbed.cli.screen import progress_bar, study_lines
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
        print(json_module.dumps({**document.to_dict(), "folder": str(written)}, indent=2))
    else:
        _print(study_lines(document, written))


Family = Literal["aircraft", "scenarios", "campaigns", "estimators", "laws", "failures", "commands", "studies"]


@app.command(name="list")
def list_(family: Family | None = None, /) -> None:
    """List what there is, one line each.

    Args:
        family: Only this family.

    """
    from flightbed.cli.screen import list_lines

    _print(list_lines(family))
