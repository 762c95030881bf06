"""A wheel in a fresh environment flies a shipped scenario from another directory."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.wheels import build_wheel, call, fresh_environment

pytestmark = pytest.mark.long


def test_an_installed_wheel_flies_the_shipped_scenario(tmp_path: Path) -> None:
    python = fresh_environment(tmp_path / "fresh", build_wheel(tmp_path))
    away = tmp_path / "away"
    away.mkdir()
    printed = call(python.with_name("flightbed"), "run", "elevator-loss", "--json", cwd=away)
    metrics = json.loads(printed)
    assert metrics["departed"] is False
    assert sorted(p.name for p in (away / metrics["folder"]).iterdir()) == [
        "flight.rrd", "metrics.json", "report.html", "scenario.toml", "trace.parquet",
    ]  # fmt: skip
    home = call(python, "-c", "import flightbed; print(flightbed.__file__)", cwd=away).strip()
    assert str(tmp_path / "fresh") in home
