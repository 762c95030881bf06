"""Functions called by address: results, arrays that they write, errors, and one caller for several of them, compiled and plain."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest

from flightbed.core.by_address import by_address
from flightbed.core.compiled import Array, compiled

KERNELS = by_address(("array", "float", "int", "bool"), "float")
WRITERS = by_address(("array", "array"), "none")
_call, _write = KERNELS.call, WRITERS.call


@compiled
def scaled(values: Array, factor: float, at: int, negative: bool) -> float:
    values[at] *= factor
    return float(-values[at] if negative else values[at])


@compiled
def total(values: Array, factor: float, _at: int, _negative: bool) -> float:
    return float(factor * np.sum(values))


@compiled
def failing(values: Array, _factor: float, _at: int, _negative: bool) -> float:
    if values.size > 2:
        raise ValueError("too many values")
    return 0.0


@compiled
def copied(source: Array, target: Array) -> None:
    target[:] = source


@compiled
def through(at: float, values: Array, factor: float, place: int, negative: bool) -> float:
    return float(_call(at, values[1:], factor, place, negative))


@compiled
def write_through(at: float, source: Array, target: Array) -> None:
    _write(at, source, target[2:])


def test_results_and_arrays() -> None:
    values = np.array([9.0, 1.0, 2.0, 3.0])
    assert through(KERNELS.address(scaled), values, 5.0, 1, True) == -10.0
    assert values.tolist() == [9.0, 1.0, 10.0, 3.0]
    assert through(KERNELS.address(total), values, 0.5, 0, False) == 7.0
    assert KERNELS.address(scaled) == KERNELS.address(scaled) != KERNELS.address(total)
    target = np.zeros(4)
    write_through(WRITERS.address(copied), np.array([7.0, 8.0]), target)
    assert target.tolist() == [0.0, 0.0, 7.0, 8.0]


def test_an_error_reaches_the_caller() -> None:
    at = KERNELS.address(failing)
    assert through(at, np.zeros(3), 1.0, 0, False) == 0.0
    with pytest.raises(ValueError, match="^too many values$"):
        through(at, np.zeros(4), 1.0, 0, False)


def test_plain_python_gives_the_same() -> None:
    code = (
        "import numpy as np\n"
        "from tests.core.test_by_address import test_an_error_reaches_the_caller, test_results_and_arrays\n"
        "test_results_and_arrays()\ntest_an_error_reaches_the_caller()\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        env=os.environ | {"FLIGHTBED_PLAIN": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
