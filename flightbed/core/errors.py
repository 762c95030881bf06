"""All errors that flightbed raises deliberately.

::

    FlightbedError                     one line: place, value, cure
    +-- InputError                     exit code 2: invalid user input
    |   +-- ScenarioError              invalid scenario file or override; .problems lists all problems
    |   +-- UnknownNameError           unregistered name; suggests the nearest
    |   +-- AircraftError              invalid aircraft folder, or an overlay that does not fit its stock model
    |   +-- OutputError                a folder or file cannot be read or written
    |   +-- EstimateError              the estimate that corrects the law is not finite
    |   +-- ExtensionError             own code cannot be imported, or fails; its exception is the cause
    +-- NotComputableError             exit code 3: valid input without a solution
        +-- NoTrimError                no equilibrium within the limits; carries the nearest point found
        +-- DesignError                no control law for the design model
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from typing import Any


class FlightbedError(Exception):
    """Base of all errors that flightbed raises deliberately; ``str()`` is one line (or one line per problem).

    Pickling keeps all attributes, so an error from a worker process arrives complete.
    """

    exit_code = 2

    def __reduce__(self) -> tuple[Any, ...]:
        return _rebuild, (type(self), self.args), self.__dict__


def _rebuild(kind: type[FlightbedError], args: tuple[object, ...]) -> FlightbedError:
    return kind.__new__(kind, *args)  # restores the arguments; the attributes set by __init__ are in the state


class InputError(FlightbedError):
    """The user's input is invalid."""


class ScenarioError(InputError):
    """A scenario has problems; the message lists all.

    Attributes:
        problems: one line each, with place, value and cure.

    """

    def __init__(self, problems: Sequence[str]) -> None:
        self.problems = tuple(map(printable, problems))
        super().__init__("\n".join(self.problems))


class UnknownNameError(InputError):
    """No entry is registered under a name.

    Attributes:
        name: the unknown name.
        known: the registered names, sorted.

    """

    def __init__(self, kind: str, name: str, known: Iterable[str], *, also: str = "") -> None:
        self.name = name
        self.known = tuple(sorted(known))
        super().__init__(
            f"unknown {kind} '{printable(name)}'{also}{did_you_mean(name, self.known)}; known: {', '.join(self.known)}"
        )


class AircraftError(InputError):
    """An aircraft folder is invalid, or does not fit the stock model that it modifies."""


class OutputError(InputError):
    """A file or folder cannot be read or written."""


class ExtensionError(InputError):
    """The user's own code cannot be imported, or fails in flight; ``__cause__`` is its exception."""


class EstimateError(InputError):
    """The estimate that corrects the law is not finite."""


class NotComputableError(FlightbedError):
    """The input is valid, but the requested result does not exist."""

    exit_code = 3


class NoTrimError(NotComputableError):
    """No equilibrium exists within the limits.

    Attributes:
        nearest: name -> value of the unknowns at the nearest point found (SI, radians).
        residual: equation -> residual there (g, g, rad/s^2).
        binding: names of the limits active there.
        feasible: description -> value of the nearest conditions with a trim, found by a change of speed, altitude, load factor or
            bank alone; empty if no search was made, or none was found.

    """

    def __init__(
        self, message: str, *, nearest: dict[str, float], residual: dict[str, float], binding: Sequence[str]
    ) -> None:
        self.nearest = nearest
        self.residual = residual
        self.binding = tuple(binding)
        self.feasible: dict[str, float] = {}
        super().__init__(message)


class DesignError(NotComputableError):
    """A control law cannot be designed for the given model."""


def printable(text: str) -> str:
    """Return a text with line breaks and other control characters escaped, so that it fits on one line."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return ``"; did you mean X?"`` for the nearest known name, or nothing."""
    near = difflib.get_close_matches(name, list(known), n=1, cutoff=0.5)
    return f"; did you mean {near[0]}?" if near else ""
