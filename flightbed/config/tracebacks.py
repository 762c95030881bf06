"""Errors of external code -> one line with file, line and flight time."""

from __future__ import annotations

import sysconfig
import traceback
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from flightbed.config import families
from flightbed.core.errors import ExtensionError, FlightbedError

if TYPE_CHECKING:
    from flightbed.core.signals import Sample

_PACKAGE = str(Path(__file__).resolve().parents[1])
_NOT_EXTERNAL = (_PACKAGE, sysconfig.get_path("stdlib"), "<")


@contextmanager
def error_context(control_hz: int, used: Sequence[families.Permitted] | None = None) -> Iterator[None]:
    """Convert an exception raised by external code, or by a value it returned, into one line with file, line and flight time.

    File, line and time are taken from the traceback; a flight without errors has no overhead.

    Args:
        control_hz: control rate of the flight, Hz.
        used: external code of the flight; None for all permitted code.

    Raises:
        ExtensionError: the converted error, with the original exception as its cause.

    """
    own = tuple(families.in_use().values()) if used is None else used
    try:
        yield
    except FlightbedError:
        raise
    except Exception as error:
        if not own:
            raise
        raise ExtensionError(_flight_message(error, own, control_hz)) from error


def with_error_context(
    samples: Iterator[Sample], control_hz: int, used: Sequence[families.Permitted]
) -> Iterator[Sample]:
    """Yield the samples; errors of external code are converted as by ``error_context``. Raises ExtensionError."""
    with error_context(control_hz, used):
        yield from samples


def constructor_message(error: Exception, extension: families.Permitted) -> str:
    """Return the message for an exception raised by an external factory."""
    found = _own_frame(error, [extension])
    text = error_line(error)
    problem = f"{found[1]}: {text}" if found else f"{text}; docs/extending.md lists the arguments of each factory"
    return f"own code {extension.name}: cannot be built: {problem}"


def _flight_message(error: Exception, own: Sequence[families.Permitted], control_hz: int) -> str:
    frames = [(frame, line) for frame, line in traceback.walk_tb(error.__traceback__)]
    looping = [f for f, _ in frames if f.f_globals.get("__name__") == "flightbed.flight.loop" and "tick" in f.f_locals]
    tick = looping[0].f_locals["tick"] if looping else None
    when = "" if tick is None else f" at t = {tick / control_hz:g} s, tick {tick}"
    if found := _own_frame(error, own):
        return f"own code {found[0]}: fails{when}: {found[1]}: {error_line(error)}"
    names = " or ".join(extension.name for extension in own)
    file, line = frames[-1][0].f_code.co_filename, frames[-1][1]
    return (
        f"own code {names}: returned an invalid value{when}: {error_line(error)} (in {Path(file).name}:{line}); "
        "flightbed.testing.check_estimator finds the faults of an estimator"
    )


def _own_frame(error: Exception, own: Sequence[families.Permitted]) -> tuple[str, str] | None:
    """Return the name of the external code in the innermost external frame, and the "file:line" of that frame."""
    for frame, line in reversed(list(traceback.walk_tb(error.__traceback__))):
        file, inside = frame.f_code.co_filename, frame.f_code.co_qualname.partition(".")[0]
        owners = [e for e in own if file in e.files] or [e for e in own if _is_near(file, e.files)]
        if owners:
            names = [e.name for e in owners if e.name.rpartition(":")[2] == inside] or [owners[0].name]
            return names[0], f"{_short_path(file)}:{line}"
    return None


def _is_near(file: str, files: frozenset[str]) -> bool:
    """Return whether a file lies beside or below external files and is not an installed one."""
    if file.startswith(_NOT_EXTERNAL) or "site-packages" in file:
        return False
    return any(Path(file).is_relative_to(Path(own).parent) for own in files if Path(own).is_absolute())


def location(error: BaseException) -> str:
    """Return the location of an import error, "file:line: ": the innermost frame of external code, or nothing."""
    if isinstance(error, SyntaxError) and error.filename:
        return f"{_short_path(error.filename)}:{error.lineno}: "
    frames = [
        (frame.f_code.co_filename, line)
        for frame, line in traceback.walk_tb(error.__traceback__)
        if not frame.f_code.co_filename.startswith(_NOT_EXTERNAL)
    ]
    return f"{_short_path(frames[-1][0])}:{frames[-1][1]}: " if frames else ""


def _short_path(file: str) -> str:
    """Return a path relative to the working directory if it lies below it."""
    path = Path(file)
    return str(path.relative_to(Path.cwd())) if path.is_absolute() and path.is_relative_to(Path.cwd()) else file


def error_line(error: BaseException) -> str:
    """Return "ValueError: message" on one line."""
    text = error.msg if isinstance(error, SyntaxError) else str(error)
    return f"{type(error).__name__}{': ' if text else ''}{' '.join(text.split())}"
