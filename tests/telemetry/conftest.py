"""Fixtures: a recorded flight and readers of recordings."""

from __future__ import annotations

from pathlib import Path

import pytest

from flightbed.analysis.result import Result
from flightbed.runs.run import run
from flightbed.scenario.reading import load_scenario


@pytest.fixture(scope="session")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Result:
    return run(load_scenario("elevator-loss"), tmp_path_factory.mktemp("runs") / "run")


@pytest.fixture(scope="session")
def recording(flown: Result) -> Path:
    assert flown.folder is not None
    return flown.folder / "flight.rrd"
