"""Shared pieces: the F-16, its design at the main condition, and flights on the linear plant."""

from __future__ import annotations

import os
import zlib

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
from tests.flights import ShippedFlight, once
from tests.golden_flights import GOLDEN_PROPERTY, Compared, summary

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
def shipped_flight(tmp_path_factory: pytest.TempPathFactory) -> ShippedFlight:
    """Shipped scenario -> its Result, flown once in a session."""
    base = tmp_path_factory.getbasetemp()
    folder = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "shipped-flights"
    folder.mkdir(exist_ok=True)
    return once(folder)


@pytest.fixture
def rng(request: pytest.FixtureRequest) -> np.random.Generator:
    """A generator seeded from the test's name; the seed is printed when the test fails."""
    seed = zlib.crc32(request.node.nodeid.encode())
    print(f"seed {seed}")
    return np.random.default_rng(seed)


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Print how the shipped flights were compared with the golden table."""
    reports = [report for kind in ("passed", "failed") for report in terminalreporter.stats.get(kind, [])]
    found = [value for report in reports for name, value in report.user_properties if name == GOLDEN_PROPERTY]
    if found:
        terminalreporter.write_line("golden flights: " + summary([Compared(*values) for values in found]))
