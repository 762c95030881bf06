"""What is raised by code of the user's own -> one line with its file, its line, and the flight's time."""

from __future__ import annotations

import sysconfig
import traceback
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from flightbed import registry
from flightbed.errors import ExtensionError, FlightbedError

if TYPE_CHECKING:
    from flightbed.signals import Sample

_PACKAGE = str(Path(__file__).resolve().parent)
_NOT_OWN = (_PACKAGE, sysconfig.get_path("stdlib"), "<")


@contextmanager
def watched(control_hz: int, used: Sequence[registry.Permitted] | None = None) -> Iterator[None]:
    """Turn what is raised by own code, or on what it gave, into one line with its file, its line and the flight's time.

    Nothing is watched while all goes well: the traceback tells the rest.

    Args:
        control_hz: of the flight.
        used: the code in question; all that is permitted if None.

    Raises:
        ExtensionError: with the exception as its cause.

    """
    own = tuple(registry.in_use().values()) if used is None else used
    try:
        yield
    except FlightbedError:
        raise
    except Exception as error:
        if not own:
            raise
        raise ExtensionError(_in_flight(error, own, control_hz)) from error


def guarded(samples: Iterator[Sample], control_hz: int, used: Sequence[registry.Permitted]) -> Iterator[Sample]:
    """Yield the samples, watched."""
    with watched(control_hz, used):
        yield from samples


def in_constructor(error: Exception, extension: registry.Permitted) -> str:
    """Return the line for what was raised when own code was to build what flies."""
    found = _own_frame(error, [extension])
    said = line_of(error)
    told = f"{found[1]}: {said}" if found else f"{said}; docs/extending.md shows with which arguments it is called"
    return f"own code {extension.name}: cannot be built: {told}"


def _in_flight(error: Exception, own: Sequence[registry.Permitted], control_hz: int) -> str:
    frames = [(frame, line) for frame, line in traceback.walk_tb(error.__traceback__)]
    looping = [f for f, _ in frames if f.f_globals.get("__name__") == "flightbed.loop" and f.f_code.co_name == "fly"]
    tick = looping[0].f_locals.get("tick") if looping else None
    when = "" if tick is None else f" at t = {tick / control_hz:g} s, tick {tick}"
    if found := _own_frame(error, own):
        return f"own code {found[0]}: fails{when}: {found[1]}: {line_of(error)}"
    names = " or ".join(extension.name for extension in own)
    file, line = frames[-1][0].f_code.co_filename, frames[-1][1]
    return (
        f"own code {names}: gave what cannot be flown{when}: {line_of(error)} (in {Path(file).name}:{line}); "
        "flightbed.testing.check_estimator finds what is wrong with an estimator"
    )


def _own_frame(error: Exception, own: Sequence[registry.Permitted]) -> tuple[str, str] | None:
    """Return whose frame is the innermost that is own code, and its file and line."""
    for frame, line in reversed(list(traceback.walk_tb(error.__traceback__))):
        file, inside = frame.f_code.co_filename, frame.f_code.co_qualname.partition(".")[0]
        whose = [e for e in own if file in e.files] or [e for e in own if _is_near(file, e.files)]
        if whose:
            names = [e.name for e in whose if e.name.rpartition(":")[2] == inside] or [whose[0].name]
            return names[0], f"{_shown(file)}:{line}"
    return None


def _is_near(file: str, files: frozenset[str]) -> bool:
    """Tell whether a file lies beside or below own files, and is none that somebody installed."""
    if file.startswith(_NOT_OWN) or "site-packages" in file:
        return False
    return any(Path(file).is_relative_to(Path(own).parent) for own in files if Path(own).is_absolute())


def place_of(error: BaseException) -> str:
    """Return the place of an error of import, "file:line: ", as near to the user's code as it is known."""
    if isinstance(error, SyntaxError) and error.filename:
        return f"{_shown(error.filename)}:{error.lineno}: "
    frames = [
        (frame.f_code.co_filename, line)
        for frame, line in traceback.walk_tb(error.__traceback__)
        if not frame.f_code.co_filename.startswith(_NOT_OWN)
    ]
    return f"{_shown(frames[-1][0])}:{frames[-1][1]}: " if frames else ""


def _shown(file: str) -> str:
    """Return a path as the user would write it."""
    path = Path(file)
    return str(path.relative_to(Path.cwd())) if path.is_absolute() and path.is_relative_to(Path.cwd()) else file


def line_of(error: BaseException) -> str:
    """Return "ValueError: message" on one line."""
    text = error.msg if isinstance(error, SyntaxError) else str(error)
    return f"{type(error).__name__}{': ' if text else ''}{' '.join(text.split())}"
