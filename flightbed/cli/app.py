"""The cyclopts application: version, options of several commands, errors and exit codes."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from importlib.metadata import version
from typing import Annotated

from cyclopts import App, CycloptsError, Parameter

from flightbed.core.errors import FlightbedError

DONE, BAD_INPUT, INTERRUPTED = 0, 2, 130  # further exit codes: FlightbedError.exit_code

app = App(
    name="flightbed",
    help="A testbed for flight control under loss of control effectiveness, on JSBSim's nonlinear F-16.",
    version=lambda: version("flightbed"),
    suppress_keyboard_interrupt=False,
    print_error=False,
    exit_on_error=False,
    result_action="return_value",
)

Flag = Annotated[bool, Parameter(negative="", show_default=False)]
Set = Annotated[
    list[str] | None,
    Parameter(
        name="--set",
        negative="",
        help="KEY=VALUE replaces one key of the scenario, for example --set failures.0.to=0.35. Repeat --set for each key.",
    ),
]
Use = Annotated[
    list[str] | None,
    Parameter(
        negative="",
        help="MODULE:ATTRIBUTE or FILE.py:ATTRIBUTE: code that the scenario names and that flightbed may import and run. "
        "Repeat --use for each.",
    ),
]
Workers = Annotated[
    int | None,
    Parameter(
        help="Number of local processes; the results do not depend on it. Default: one per core.",
    ),
]
Scheduler = Annotated[
    str | None,
    Parameter(
        help="tcp://HOST:PORT of a dask scheduler, whose workers fly instead of local processes. "
        "Requires the extra `distributed`.",
    ),
]


def exit_code(arguments: Sequence[str] | None = None) -> int:
    """Run the command of the arguments, those of the process if None; return the exit code.

    Errors and interrupts become lines on stderr. Exit codes: 0 done, 2 bad input, 3 not computable, 130 interrupted.
    """
    try:
        code = app(arguments)
    except CycloptsError as error:
        print_error(str(error).replace("\n", " "))
        return BAD_INPUT
    except FlightbedError as error:
        print_error(str(error))
        return error.exit_code
    except KeyboardInterrupt as stop:
        print_error(str(stop) or "interrupted; nothing was written")
        return INTERRUPTED
    except BrokenPipeError:  # the reader of stdout closed it, as `head` does: not an error
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # the flush at exit would fail otherwise
        return DONE
    return code if isinstance(code, int) else DONE


def print_error(message: str) -> None:
    """Print a message on stderr, each line after the program's name."""
    for line in message.splitlines():
        print(f"flightbed: {line}", file=sys.stderr)
