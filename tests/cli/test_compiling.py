"""The message while kernels are compiled."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest

from flightbed.cli import compiling
from flightbed.cli.compiling import PARTS, announcer, part_of
from tests.test_architecture import TREES


def test_every_module_with_kernels_has_words() -> None:
    with_kernels = []
    for name, tree in TREES.items():
        imported = {a.name for n in ast.walk(tree) if isinstance(n, ast.ImportFrom) for a in n.names}
        if "compiled" in imported:
            with_kernels.append(name)
    assert len(with_kernels) > 15
    found = {part_of(f"{name}.kernel")[0] for name in with_kernels}
    assert found == {part for _, part, _ in PARTS}
    assert part_of("mine.kernels.f") == ("mine.kernels", 10)


def test_a_line_per_part_if_stderr_is_no_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    announce = announcer()
    for name in ("flight.computer._tick", "analysis.cramer_rao.bound", "flight.computer._other"):
        with announce(f"flightbed.{name}"):
            pass
    captured = capsys.readouterr()
    assert captured.err == (
        "compiling the flight computer, once, about 8 s\ncompiling the Cramer-Rao bound, once, about 2 s\n"
    )
    assert captured.out == ""


def test_a_spinner_on_a_terminal(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    from rich.console import Console

    monkeypatch.setattr(compiling, "stderr", Console(stderr=True, force_terminal=True, width=100))
    announce = announcer()
    with announce("flightbed.flight.computer._tick"):
        pass
    text = capsys.readouterr().err
    assert "compiling the flight computer, once, about 8 s" in text
    assert "\x1b[2K" in text  # the line is erased


def test_the_first_flight_of_a_fresh_cache_says_so_and_the_second_does_not(tmp_path: Path) -> None:
    env = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "kernels")}
    command = [
        sys.executable,
        "-m",
        "flightbed",
        "run",
        "nominal",
        "--set",
        "estimators=[]",
        "--set",
        "adaptation.enabled=false",
    ]
    command += ["--set", "duration_s=1", "--rerun", "off", "--report", "off", "--out", "run"]
    first, second = (
        subprocess.run(command, env=env, cwd=tmp_path, capture_output=True, text=True, check=True) for _ in range(2)
    )
    lines = [line for line in first.stderr.splitlines() if "dropped from the file" not in line]
    assert lines[0].startswith("compiling the flight computer, once, about ")
    assert "compiling" not in second.stderr
    assert list((tmp_path / "kernels").rglob("*.kernel"))
