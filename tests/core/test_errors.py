"""Errors keep their message and attributes between processes."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable

import pytest

from flightbed.core import errors
from flightbed.core.errors import (
    AircraftError,
    DesignError,
    EstimateError,
    ExtensionError,
    FlightbedError,
    InputError,
    NotComputableError,
    NoTrimError,
    OutputError,
    ScenarioError,
    UnknownNameError,
)

NO_TRIM = NoTrimError("no trim here", nearest={"alpha": 0.4}, residual={"lift": 0.3}, binding=["alpha"])
NO_TRIM.feasible["mach"] = 0.35
NO_TRIM.args = ("no trim at Mach 0.30: no trim here",)  # as the plan words it

ALL = [
    ScenarioError(["one: must be 1 (got 2)", "two: is missing"]),
    UnknownNameError("aircraft", "f61", ["f16", "c172"], also=" (not a folder)"),
    NO_TRIM,
    *(
        kind("a line")
        for kind in (
            FlightbedError,
            InputError,
            AircraftError,
            OutputError,
            EstimateError,
            ExtensionError,
            NotComputableError,
            DesignError,
        )
    ),
]


def test_every_class_of_error_is_among_them() -> None:
    def below(kind: type[FlightbedError]) -> set[type[FlightbedError]]:
        return {kind}.union(*map(below, kind.__subclasses__()))

    ours = {kind for kind in below(FlightbedError) if kind.__module__ == errors.__name__}
    assert ours == {type(error) for error in ALL}


@pytest.mark.parametrize("again", [lambda e: pickle.loads(pickle.dumps(e)), copy.copy, copy.deepcopy])
@pytest.mark.parametrize("error", ALL, ids=lambda e: type(e).__name__)
def test_an_error_comes_whole_from_another_process(
    error: FlightbedError, again: Callable[[FlightbedError], FlightbedError]
) -> None:
    found = again(error)
    assert type(found) is type(error)
    assert (str(found), found.args, vars(found), found.exit_code) == (
        str(error),
        error.args,
        vars(error),
        error.exit_code,
    )


def test_notes_come_with_it() -> None:
    error = InputError("a line")
    error.add_note("in seed 7")
    assert pickle.loads(pickle.dumps(error)).__notes__ == ["in seed 7"]
