"""Shared pieces: the F-16, its design at the main condition, and flights on the linear plant."""

from __future__ import annotations

import os
import zlib
from collections.abc import Iterator
from pathlib import Path

# Before numpy is loaded: its threads spin on matrices this small, and take the other core from whatever runs there.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import hypothesis
import numpy as np
import pytest

from flightbed.aircraft.overlay import Aircraft, load_aircraft
from flightbed.avionics.short_period import ShortPeriod
from flightbed.core.units import FT
from flightbed.models.linearize import linearize
from flightbed.models.reduce import short_period
from flightbed.models.trim import trim
from flightbed.plant.airframe import JsbsimAirframe
from tests.flights import ShippedFlight, campaigns_in_this_process, once
from tests.golden_flights import GOLDEN_PROPERTY, Compared, summary

# Files of the fast suite that take longest, 10 s and more; a process that takes one last keeps the others waiting.
HEAVY = (
    "studies/test_sillence.py", "studies/test_wu.py", "studies/test_estimators.py", "telemetry/test_live.py", "telemetry/test_viewer.py",
    "studies/test_kemp.py", "campaigns/test_journal.py", "campaigns/test_killed_flights.py", "runs/test_compare.py", "test_extending.py",
    "test_benchmarks.py", "testing/test_check.py", "estimation/reconstruction/test_elevator.py", "flight/test_load_factor_axis.py",
    "campaigns/test_run.py", "report/test_in_a_browser.py", "report/test_flight_report.py", "studies/test_dying_workers.py",
    "parallel/test_executor.py", "cli/test_run.py", "studies/test_gupta.py", "flight/test_pacing.py",
)  # fmt: skip

os.environ.pop("RERUN", None)  # RERUN=off would turn every recording into nothing
hypothesis.settings.register_profile("repeatable", derandomize=True, deadline=None)
hypothesis.settings.load_profile("repeatable")


@pytest.fixture(scope="session")
def f16() -> Aircraft:
    return load_aircraft("f16")


@pytest.fixture(scope="session")
def design(f16: Aircraft) -> ShortPeriod:
    """The design model at Mach 0.8, 20,000 ft."""
    airframe = JsbsimAirframe(f16, mach=0.8, altitude_m=20000 * FT)
    return short_period(linearize(airframe, trim(airframe)), actuator_rad_s=f16.actuator.lag_rad_s)


@pytest.fixture(scope="session")
def shipped_flight(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> ShippedFlight:
    """Shipped scenario -> its Result, flown once in a session."""
    base = tmp_path_factory.getbasetemp()
    # Not by the environment, which a session inside a test inherits.
    folder = (base.parent if hasattr(request.config, "workerinput") else base) / "shipped-flights"
    folder.mkdir(exist_ok=True)
    return once(folder)


@pytest.fixture
def in_this_process() -> Iterator[None]:
    with campaigns_in_this_process():
        yield


@pytest.fixture
def rng(request: pytest.FixtureRequest) -> np.random.Generator:
    """A generator seeded from the test's name; the seed is printed when the test fails."""
    seed = zlib.crc32(request.node.nodeid.encode())
    print(f"seed {seed}")
    return np.random.default_rng(seed)


def pytest_configure(config: pytest.Config) -> None:
    """Let ``--dist loadfile`` keep the order of the collection; by default files with many tests come first."""
    if hasattr(config.option, "loadscopereorder"):
        config.option.loadscopereorder = False


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put the files that take longest first, in the order of ``HEAVY``; the order of all others stays."""
    rank = {Path(__file__).parent / name: number for number, name in enumerate(HEAVY)}
    if gone := [str(file) for file in rank if not file.is_file()]:
        raise pytest.UsageError(f"HEAVY in tests/conftest.py: no such files: {', '.join(gone)}; correct the list")
    items.sort(key=lambda item: rank.get(item.path, len(rank)))


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Print how the shipped flights were compared with the golden table."""
    reports = [report for kind in ("passed", "failed") for report in terminalreporter.stats.get(kind, [])]
    found = [value for report in reports for name, value in report.user_properties if name == GOLDEN_PROPERTY]
    if found:
        terminalreporter.write_line("golden flights: " + summary([Compared(*values) for values in found]))
