"""`flightbed run`: the printed summary, JSON, and a complete folder or none."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from flightbed.aircraft.overlay import load_aircraft
from tests.command_line import COMMAND, call, flightbed, heed_interrupts


def test_run_prints_the_outcome_and_writes_a_folder(tmp_path: Path) -> None:
    done = flightbed("run", "elevator-loss-fixed", cwd=tmp_path)
    assert done.returncode == 0, done.stderr  # a departure is a result, not an error
    assert "departed at" in done.stdout
    assert "written to runs/elevator-loss-fixed" in done.stdout
    printed = [line.rstrip() for line in done.stdout.splitlines()]
    assert max(len(line) for line in printed[:-1]) <= 80, printed  # fits a plain terminal; only the path may be longer
    assert sorted(p.name for p in (tmp_path / "runs/elevator-loss-fixed").iterdir()) == [
        "flight.rrd", "metrics.json", "report.html", "scenario.toml", "trace.parquet",
    ]  # fmt: skip


def test_json_is_the_only_text_on_stdout(tmp_path: Path) -> None:
    options = ("--rerun", "off", "--report", "off", "--json")
    done = flightbed("run", "nominal", "--set", "duration_s=1", *options, "--out", "x", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    printed = json.loads(done.stdout)
    assert printed.pop("folder") == "x"
    assert printed == json.loads((tmp_path / "x" / "metrics.json").read_text())
    assert {p.name for p in (tmp_path / "x").iterdir()} == {"metrics.json", "scenario.toml", "trace.parquet"}


def test_a_scenario_of_an_equal_aircraft_flies_and_says_so(tmp_path: Path) -> None:
    aircraft = load_aircraft("f16")
    bound = [
        "--set", f"aircraft.sha256={aircraft.equal_to[0]}", "--set", "duration_s=0.2", "--set", "failures=[]",
    ]  # fmt: skip
    done = flightbed("run", "nominal", *bound, "--rerun", "off", "--json", "--out", "x", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    (line,) = done.stderr.splitlines()
    assert line.startswith(f"flightbed: aircraft.sha256: the scenario names {aircraft.equal_to[0][:12]}..., an earlier")
    assert json.loads(done.stdout)["aircraft_sha256"] == aircraft.sha256
    assert f'sha256 = "{aircraft.sha256}"' in (tmp_path / "x" / "scenario.toml").read_text()
    assert line.removeprefix("flightbed: ") in (tmp_path / "x" / "report.html").read_text()
    again = call("run", "x/scenario.toml", "--rerun", "off", "--report", "off", cwd=tmp_path)
    assert (again.returncode, again.stderr) == (0, "")


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
        [*COMMAND, "run", "nominal", "--set", f"duration_s={600 if pace else 36000}", "--out", "x", *pace],
        cwd=away, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env={**os.environ, "TMPDIR": str(scratch)},
        preexec_fn=heed_interrupts,
    )  # fmt: skip
    deadline = time.monotonic() + 120.0
    while not list(scratch.glob("flightbed-*/*/f16/f16.xml")):  # the aircraft is built, the flight begins
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.05)
    time.sleep(1.5)
    assert process.poll() is None
    process.send_signal(number)
    stdout, stderr = process.communicate(timeout=60)
    assert process.returncode == code
    assert stdout == ""
    assert stderr == ("flightbed: interrupted; nothing was written\n" if number == signal.SIGINT else "")
    assert list(away.iterdir()) == []
    assert list(scratch.iterdir()) == []


def test_a_run_killed_while_writing_leaves_no_folder(tmp_path: Path) -> None:
    """After SIGKILL during writing the folder is absent; a hidden scratch folder may remain."""
    code = (
        "import os, signal, flightbed.analysis.trace as t, flightbed\n"
        "t.Trace.write = lambda *a: os.kill(os.getpid(), signal.SIGKILL)\n"
        "flightbed.run(flightbed.load_scenario('nominal', ['duration_s=0.2']), 'x')"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, check=False, capture_output=True)
    assert done.returncode == -signal.SIGKILL
    assert not (tmp_path / "x").exists()
    assert all(p.name.startswith(".") for p in tmp_path.iterdir())
