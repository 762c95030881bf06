"""The examples run, as scripts in a folder of their own, and say what they should."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"


def _run(name: str, folder: Path) -> str:
    environment = {**os.environ, "MPLBACKEND": "Agg", "PYTHONPATH": str(EXAMPLES.parent)}
    command = [sys.executable, str(EXAMPLES / name)]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, env=environment)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    return done.stdout


def test_fly_and_plot(tmp_path: Path) -> None:
    printed = _run("fly_and_plot.py", tmp_path)
    assert re.search(r"adaptive +flown to 16.5 s", printed)
    assert re.search(r"fixed law +departed at 1\d\.\d\d s", printed)
    assert re.search(r"no failure +flown to 16.5 s", printed)
    assert [p.name for p in tmp_path.iterdir()] == ["elevator-loss.png"]
    assert (tmp_path / "elevator-loss.png").read_bytes()[:4] == b"\x89PNG"
    assert (tmp_path / "elevator-loss.png").stat().st_size > 20_000  # curves, not an empty frame


def test_own_estimator(tmp_path: Path) -> None:
    printed = _run("own_estimator.py", tmp_path)
    assert "contract satisfied" in printed
    finals = {name: float(final) for name, final in re.findall(r"^(\w+) +(\d\.\d+) ", printed, flags=re.MULTILINE)}
    assert finals == {"scheduled": pytest.approx(0.2, abs=0.02), "mine": pytest.approx(0.2, abs=0.1)}
    assert list(tmp_path.iterdir()) == []
    source = (EXAMPLES / "own_estimator.py").read_text().partition("class Window")[2].partition("\n# %%")[0]
    assert len(source.rstrip().splitlines()) <= 40


def test_linearize_and_design(tmp_path: Path) -> None:
    printed = _run("linearize_and_design.py", tmp_path)
    assert "open-loop poles, rad/s: [-20.2   -2.36   0.44]" in printed
    ends = re.findall(r"90 % after (\d\.\d\d) s, peak \d\.\d\d, (\d\.\d\d) at 3 s", printed)
    assert len(ends) == 2
    for rise, end in ends:
        assert 0.05 < float(rise) < 0.5
        assert float(end) == pytest.approx(1.0, abs=0.05)  # speed and height drift a little
    assert "pole placement: short-period poles -1.47, -8.27 +- 8.86j rad/s" in printed


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.py")), ids=lambda p: p.name)
def test_each_opens_as_a_notebook(path: Path) -> None:
    text = path.read_text()
    assert text.startswith('"""')
    assert 3 <= len(re.findall(r"^# %% \S", text, flags=re.MULTILINE)) <= 6
