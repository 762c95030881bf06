"""A wheel built from the tree, installed in a fresh environment, flies the shipped scenario from another directory."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import venv
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


def _run(*command: object, cwd: Path) -> str:
    # PIP_* and the like stay: they say where packages come from. PYTHONPATH would let the tree shine through.
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    done = subprocess.run(
        [str(c) for c in command], cwd=cwd, capture_output=True, text=True, check=False, env=environment
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.wheel
def test_an_installed_wheel_flies_the_shipped_scenario(tmp_path: Path) -> None:
    _run(sys.executable, "-m", "build", "--wheel", "--outdir", tmp_path / "dist", ROOT, cwd=tmp_path)
    (wheel,) = (tmp_path / "dist").glob("flightbed-*.whl")
    names = zipfile.ZipFile(wheel).namelist()
    assert "flightbed/aircraft_data/f16/aircraft.toml" in names
    assert "flightbed/scenario_data/elevator-loss.toml" in names
    assert "flightbed/scenario_data/campaigns/effectiveness-grid.toml" in names
    assert not any(name.startswith(("tests/", "runs/")) or name.endswith("f16.xml") for name in names)
    venv.create(tmp_path / "fresh", with_pip=True)
    python = tmp_path / "fresh" / "bin" / "python"
    _run(python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", wheel, cwd=tmp_path)
    away = tmp_path / "away"
    away.mkdir()
    printed = _run(tmp_path / "fresh" / "bin" / "flightbed", "run", "elevator-loss", "--json", cwd=away)
    metrics = json.loads(printed)
    assert metrics["departed"] is False
    assert sorted(p.name for p in (away / metrics["folder"]).iterdir()) == [
        "flight.rrd", "metrics.json", "report.html", "scenario.toml", "trace.parquet",
    ]  # fmt: skip
    home = _run(python, "-c", "import flightbed; print(flightbed.__file__)", cwd=away).strip()
    assert str(tmp_path / "fresh") in home
