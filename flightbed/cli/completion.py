"""Shell completion: names of scenarios, campaigns, aircraft and studies, and the command that installs it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter
from rich.markup import escape

from flightbed.cli.app import app
from flightbed.cli.screen import print_lines
from flightbed.core.errors import InputError

if TYPE_CHECKING:
    from cyclopts.completion import CompletionContext


def _scenarios(context: CompletionContext) -> Iterator[str]:
    """Yield the names of the shipped scenarios, and the TOML files and folders that the typed path begins."""
    from flightbed.core import data

    yield from data.names("scenario")
    yield from _paths(context.incomplete, lambda path: path.suffix == ".toml")


def _flights(context: CompletionContext) -> Iterator[str]:
    """Yield the names of the shipped campaigns and scenarios, and TOML files and folders."""
    from flightbed.core import data

    yield from data.names("campaign")
    yield from _scenarios(context)


def _aircraft(context: CompletionContext) -> Iterator[str]:
    """Yield the names of the shipped aircraft, and folders."""
    from flightbed.core import data

    yield from data.names("aircraft")
    yield from _paths(context.incomplete, lambda _path: False)


def _studies(_context: CompletionContext) -> Iterator[str]:
    """Yield the names of the studies, and "all"."""
    from flightbed.config import families

    yield from (*families.names("studies"), "all")


def _paths(typed: str, is_wanted: Callable[[Path], bool]) -> Iterator[str]:
    """Yield the folders, with a slash, and the wanted files whose path begins with the typed text."""
    folder, slash, start = typed.rpartition("/")
    for path in sorted(Path(f"{folder}{slash}" or ".").expanduser().iterdir()):
        if path.name.startswith(start) and not (path.name.startswith(".") and not start):
            is_folder = path.is_dir()
            if is_folder or is_wanted(path):
                yield f"{folder}{slash}{path.name}{'/' if is_folder else ''}"


ScenarioName = Annotated[str, Parameter(completer=_scenarios)]
FlightsName = Annotated[str, Parameter(completer=_flights)]
StudyName = Annotated[str, Parameter(completer=_studies)]
AircraftName = Annotated[
    str,
    Parameter(
        completer=_aircraft,
        help="Name of a shipped aircraft (`flightbed list aircraft`), path of an aircraft folder, or name of an aircraft that ships "
        "with JSBSim (jsbsim:NAME if flightbed ships one of that name too).",
    ),
]


def install_completion(
    *,
    shell: Literal["bash", "zsh", "fish", "powershell"] | None = None,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
) -> None:
    """Install completion of commands, options and names in the shell.

    The script is written to the folder in which the shell looks for it, and the shell's startup file loads it.

    Args:
        shell: The shell. Default: the one that runs this command.
        output: File to write instead; no startup file is changed.

    """
    from cyclopts.completion import detect

    if shell is None:
        try:
            shell = detect.detect_shell()
        except detect.ShellDetectionError:
            raise InputError("--install-completion: the shell is unknown; name it with --shell") from None
    if output is not None and not output.parent.is_dir():
        raise InputError(f"--output {output}: there is no folder {output.parent}")
    try:
        path = app.install_completion(shell=shell, output=output, add_to_startup=output is None)
    except OSError as error:
        raise InputError(
            f"--install-completion: {error.strerror}: {error.filename}; name a file with --output"
        ) from None
    print_lines([escape(f"completion for {shell} is in {path}; it works in the next shell")])
