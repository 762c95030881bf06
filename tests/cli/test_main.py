"""The command line as a user meets it: one line per error, the right exit code, no half files."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.command_line import COMMAND, assert_error, assert_one_clear_line, flightbed, heed_interrupts


def test_run_says_what_happened_and_leaves_a_folder(tmp_path: Path) -> None:
    done = flightbed("run", "elevator-loss-fixed", cwd=tmp_path)
    assert done.returncode == 0, done.stderr  # a flight that departs is a result
    assert "departed at" in done.stdout
    assert "written to runs/elevator-loss-fixed" in done.stdout
    shown = [line.rstrip() for line in done.stdout.splitlines()]
    assert max(len(line) for line in shown[:-1]) <= 80, shown  # readable in a plain terminal; the path may be long
    assert sorted(p.name for p in (tmp_path / "runs/elevator-loss-fixed").iterdir()) == [
        "flight.rrd", "metrics.json", "report.html", "scenario.toml", "trace.parquet",
    ]  # fmt: skip


def test_a_reader_that_goes_away_is_no_failure(tmp_path: Path) -> None:
    command = f"{sys.executable} -m flightbed list | head -n 1; exit ${{PIPESTATUS[0]}}"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=False, cwd=tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (0, "aircraft\n", "")


def test_json_is_alone_on_stdout(tmp_path: Path) -> None:
    options = ("--rerun", "off", "--report", "off", "--json")
    done = flightbed("run", "nominal", "--set", "duration_s=1", *options, "--out", "x", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    printed = json.loads(done.stdout)
    assert printed.pop("folder") == "x"
    assert printed == json.loads((tmp_path / "x" / "metrics.json").read_text())
    assert {p.name for p in (tmp_path / "x").iterdir()} == {"metrics.json", "scenario.toml", "trace.parquet"}


def test_list_names_everything_with_a_line_each(tmp_path: Path) -> None:
    listed = flightbed("list", cwd=tmp_path).stdout
    for name in ("f16", "nominal", "elevator-loss", "elevator-loss-fixed", "straight-and-level", "doublet", "constant", "none",
                 "3-2-1-1", "chirp", "multisine", "random", "dither", "proportional", "proportional-integral", "lq", "effectiveness", "loop-gain",
                 "two-stage", "stuck", "floating", "hardover", "rate-limit", "bias"):  # fmt: skip
        assert f"\n  {name} " in listed
    laws = [line.split()[0] for line in flightbed("list", "laws", cwd=tmp_path).stdout.splitlines()]
    assert laws == ["lq", "nz-adaptive", "nz-scheduled", "proportional", "proportional-integral"]


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
def test_errors_are_one_clear_line(tmp_path: Path, arguments: list[str], code: int, message: str) -> None:
    assert_one_clear_line(arguments, code, message, cwd=tmp_path)


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (["run", "elevator-los"], 2, "unknown scenario 'elevator-los'"),
        (["run", "nominal", "--ot", "x"], 2, "Unknown option"),
        (["run", "nominal", "--set", "control.poles=[[-1,0]]"], 3, "the loop has 3 states, 1 poles are given"),
    ],
)
def test_errors_of_a_new_process_are_one_clear_line(
    tmp_path: Path, arguments: list[str], code: int, message: str
) -> None:
    done = flightbed(*arguments, cwd=tmp_path)
    assert_error(done.returncode, done.stdout, done.stderr, code, message)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("number", "code", "pace"),
    [
        (signal.SIGINT, 130, []),
        (signal.SIGTERM, 143, ["--realtime"]),
        pytest.param(signal.SIGINT, 130, ["--realtime"], marks=pytest.mark.long),
        pytest.param(signal.SIGTERM, 143, [], marks=pytest.mark.long),
    ],
)
def test_an_interrupted_flight_leaves_nothing(
    tmp_path: Path, number: signal.Signals, code: int, pace: list[str]
) -> None:
    scratch, away = tmp_path / "scratch", tmp_path / "away"
    scratch.mkdir()
    away.mkdir()
    process = subprocess.Popen(
        [*COMMAND, "run", "nominal", "--set", "duration_s=36000", "--out", "x", *pace],
        cwd=away, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env={**os.environ, "TMPDIR": str(scratch)},
        preexec_fn=heed_interrupts,
    )  # fmt: skip
    deadline = time.monotonic() + 120.0
    while not list(scratch.glob("flightbed-*/*/f16/f16.xml")):  # the aircraft has been built: the flight begins
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.05)
    time.sleep(2.0)
    assert process.poll() is None
    process.send_signal(number)
    stdout, stderr = process.communicate(timeout=60)
    assert process.returncode == code
    assert stdout == ""
    assert stderr == ("flightbed: interrupted; nothing was written\n" if number == signal.SIGINT else "")
    assert list(away.iterdir()) == []
    assert list(scratch.iterdir()) == []


def test_killed_while_writing_leaves_no_half_run(tmp_path: Path) -> None:
    """kill -9 in the middle of the writing: the folder is not there; a hidden scratch folder may be."""
    code = (
        "import os, signal, flightbed.analysis.trace as t, flightbed\n"
        "t.Trace.write = lambda *a: os.kill(os.getpid(), signal.SIGKILL)\n"
        "flightbed.run(flightbed.load_scenario('nominal', ['duration_s=0.2']), 'x')"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, check=False, capture_output=True)
    assert done.returncode == -signal.SIGKILL
    assert not (tmp_path / "x").exists()
    assert all(p.name.startswith(".") for p in tmp_path.iterdir())


def test_view_without_a_display_says_what_to_do(tmp_path: Path) -> None:
    flightbed("run", "nominal", "--set", "duration_s=0.2", "--out", "x", cwd=tmp_path)
    environment = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY")}
    done = subprocess.run(
        [*COMMAND, "view", "x"], capture_output=True, text=True, check=False, cwd=tmp_path, env=environment
    )
    assert done.returncode == 2
    assert (
        "there is no display for the viewer; write a picture, --picture FILE.png, or copy x/flight.rrd" in done.stderr
    )
    assert len(done.stderr.splitlines()) == 1


def test_view_reports_a_missing_recording(tmp_path: Path) -> None:
    flightbed("run", "nominal", "--set", "duration_s=0.2", "--rerun", "off", "--out", "x", cwd=tmp_path)
    done = flightbed("view", "x", cwd=tmp_path)
    assert done.returncode == 2
    assert "there is no recording; fly the scenario again with --rerun save" in done.stderr
