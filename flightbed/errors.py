"""Everything that flightbed raises on purpose.

::

    FlightbedError                     one line: place, value, cure
    +-- InputError                     exit code 2: what the user wrote cannot be used
    |   +-- ScenarioError              a scenario file or an override; .problems lists them all
    |   +-- UnknownNameError           a name that nothing is registered under; suggests the nearest
    |   +-- AircraftError              an aircraft folder, or a stock model, that does not fit
    |   +-- OutputError                a folder or file that cannot be read or written
    |   +-- EstimateError              an estimator that corrects the law says what is no number
    |   +-- ExtensionError             code of the user's own that cannot be imported, or fails; its exception is the cause
    +-- NotComputableError             exit code 3: the input is sound, the answer does not exist
        +-- NoTrimError                no equilibrium within the limits; carries the nearest point found
        +-- DesignError                a control law that the design model does not admit
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from typing import Any


class FlightbedError(Exception):
    """Base of all errors that flightbed raises on purpose; ``str()`` is one line (or one line per problem).

    They come whole from a worker process: pickled as they are, not made anew from their message.
    """

    exit_code = 2

    def __reduce__(self) -> tuple[Any, ...]:
        return _rebuild, (type(self), self.args), self.__dict__


def _rebuild(kind: type[FlightbedError], args: tuple[object, ...]) -> FlightbedError:
    return kind.__new__(kind, *args)  # keeps the arguments; what __init__ did is in the state


class InputError(FlightbedError):
    """What the user wrote cannot be used."""


class ScenarioError(InputError):
    """A scenario has problems; every one of them is listed.

    Attributes:
        problems: one line each, naming place, value and cure.

    """

    def __init__(self, problems: Sequence[str]) -> None:
        self.problems = tuple(problems)
        super().__init__("\n".join(self.problems))


class UnknownNameError(InputError):
    """Nothing is registered under a name."""

    def __init__(self, kind: str, name: str, known: Iterable[str], *, also: str = "") -> None:
        self.name = name
        self.known = tuple(sorted(known))
        super().__init__(
            f"unknown {kind} '{name}'{also}{did_you_mean(name, self.known)}; known: {', '.join(self.known)}"
        )


class AircraftError(InputError):
    """An aircraft folder, or the stock model that it is laid over, does not fit."""


class OutputError(InputError):
    """A file or folder cannot be read or written."""


class ExtensionError(InputError):
    """Code outside flightbed cannot be imported, or fails in flight; ``__cause__`` is the exception itself."""


class EstimateError(InputError):
    """The estimator that the law is corrected by says what is no number."""


class NotComputableError(FlightbedError):
    """The input is sound, but what was asked for does not exist."""

    exit_code = 3


class NoTrimError(NotComputableError):
    """No equilibrium exists within the limits.

    Attributes:
        nearest: name -> value of the unknowns at the nearest point found (SI, radians).
        residual: equation -> residual there (g, g, rad/s^2).
        binding: names of the limits that bind there.
        feasible: nearest conditions that can be trimmed, found by moving one of speed, altitude, load factor or bank, in words
            and numbers: name -> value; empty when none was looked for, or found.

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


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return ``"; did you mean X?"`` for the nearest known name, or nothing."""
    near = difflib.get_close_matches(name, list(known), n=1, cutoff=0.5)
    return f"; did you mean {near[0]}?" if near else ""
