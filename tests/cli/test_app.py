"""The application: one line per error with its exit code, help for every option, and a cheap start."""

from __future__ import annotations

import json
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pytest

from flightbed.cli.main import app
from tests.command_line import COMMAND, assert_error, assert_one_clear_line, call, flightbed

COMMANDS = (
    "campaign", "compare", "compile", "keys", "linearize", "list", "new", "reproduce", "run", "schema", "trim", "upgrade", "view",
)  # fmt: skip


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (["run", "elevator-los"], 2, "unknown scenario 'elevator-los' (neither a shipped name nor a path); did you mean elevator-loss?"),
        (["run"], 2, "requires an argument"),
        (["run", "nominal", "--ot", "x"], 2, "Unknown option"),
        (["run", "nominal", "--rerun", "lve"], 2, "Invalid value"),
        (["run", "nominal", "--report", "lve"], 2, "Invalid value"),
        (["campaign", "nominal", "--runs", "0"], 2, "--runs: must be at least 1 (got 0)"),
        (["campaign", "nominal", "--workers", "0"], 2, "--workers: must be at least 1 (got 0)"),
        (["campaign", "nominl"], 2, "unknown scenario 'nominl'"),
        (["campaign", "nominal", "--set", "seed=9223372036854775800"], 2, "seed: must be at most 9223372036854775708 with 100 flights"),
        (["campaign", "nominal", "--out", "."], 2, "--out .: is the folder you are in"),
        (["fly"], 2, "Unknown command"),
        (["list", "planes"], 2, "Invalid value"),
        (["run", "nominal", "--set", "sede=1"], 2, "unknown key sede; did you mean seed?"),
        (["run", "nominal", "--set", "seed=x"], 2, "--set seed: must be a whole number (got 'x')"),
        (["run", "elevator-loss", "--set", "failures.0.to=1.2"], 2, "must be between 0 and 1 (got 1.2)"),
        (["run", "nominal", "--set", "rates.plant_hz=130"], 2, "must be an integer multiple of control_hz (got 130 and 100)"),
        (["run", "nominal", "--set", "estimators.0.kind=kalman"], 2, "unknown estimator"),
        (["run", "nominal", "--set", "aircraft.model=f61"], 2, "unknown aircraft 'f61' (neither a shipped name nor a path); did you mean f16?"),
        (["run", "nominal", "--set", "control.poles=[[-1,0]]"], 3, "the loop has 3 states, 1 poles are given"),
        (["run", "nominal", "--set", "condition.mach=0.3", "--set", "condition.altitude_ft=45000"], 3, "no trim at Mach 0.30, 45000 ft"),
        (["run", "nominal", "--out", "/proc/nowhere/x"], 2, "--out /proc/nowhere/x: cannot be written"),
        (["run", "nominal", "--out", "."], 2, "--out .: is the folder you are in"),
        (["view", "."], 2, "not a run's folder (no metrics.json)"),
    ],
)  # fmt: skip
def test_an_error_is_one_line_and_an_exit_code(tmp_path: Path, arguments: list[str], code: int, message: str) -> None:
    assert_one_clear_line(arguments, code, message, cwd=tmp_path)


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (["run", "elevator-los"], 2, "unknown scenario 'elevator-los'"),
        (["run", "nominal", "--ot", "x"], 2, "Unknown option"),
        (["run", "nominal", "--set", "control.poles=[[-1,0]]"], 3, "the loop has 3 states, 1 poles are given"),
    ],
)
def test_an_error_of_a_new_process_is_one_line_and_an_exit_code(
    tmp_path: Path, arguments: list[str], code: int, message: str
) -> None:
    done = flightbed(*arguments, cwd=tmp_path)
    assert_error(done.returncode, done.stdout, done.stderr, code, message)
    assert list(tmp_path.iterdir()) == []


def test_a_closed_pipe_is_no_error(tmp_path: Path) -> None:
    command = f"{sys.executable} -m flightbed list | head -n 1; exit ${{PIPESTATUS[0]}}"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=False, cwd=tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (0, "aircraft\n", "")


def test_every_command_is_registered() -> None:
    assert {name for name in app if not name.startswith("-")} == set(COMMANDS)


@pytest.mark.parametrize("command", COMMANDS)
def test_help_explains_every_argument_and_fits_80_columns(command: str, tmp_path: Path) -> None:
    arguments = app[command].assemble_argument_collection(parse_docstring=True)
    shown = [argument for argument in arguments if not argument.children]
    assert shown or command == "compile"
    assert [argument.name for argument in shown if not argument.parameter.help] == []
    done = call(command, "--help", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith(f"Usage: flightbed {command}")
    assert max(map(len, done.stdout.splitlines())) <= 80
    for argument in shown:
        assert argument.names[0] in done.stdout


def test_the_command_line_loads_no_other_package_until_a_command_runs() -> None:
    code = (
        "import json, sys, flightbed; before = set(sys.modules); import flightbed.cli.main; "
        "print(json.dumps(sorted(set(sys.modules) - before)))"
    )
    loaded = json.loads(subprocess.run([sys.executable, "-c", code], check=True, capture_output=True).stdout)
    own = {name for name in loaded if name.split(".")[0] == "flightbed"}
    assert {name for name in own if not name.startswith("flightbed.cli")} <= {
        "flightbed.core", "flightbed.core.errors", "flightbed.core.compilation",
    }  # fmt: skip


def test_the_version_is_one_line(tmp_path: Path) -> None:
    done = subprocess.run([*COMMAND, "--version"], capture_output=True, text=True, check=True, cwd=tmp_path)
    assert done.stdout == f"{version('flightbed')}\n"
