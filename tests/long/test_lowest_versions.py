"""flightbed works with the lowest versions that pyproject.toml permits: golden flights, a run, linearize and a campaign."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from tests.lowest_versions import lowest, pins
from tests.wheels import ROOT, build_wheel, call, fresh_environment

pytestmark = pytest.mark.long

TOOLS = ("pytest", "pytest-timeout", "hypothesis")  # the golden flights are tests


@pytest.fixture(scope="module")
def oldest(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Python of an environment with flightbed's wheel and the lowest versions."""
    folder = tmp_path_factory.mktemp("oldest")
    return fresh_environment(folder / "env", *pins(["dev"], TOOLS), build_wheel(folder))


def _flightbed(python: Path, *arguments: object, cwd: Path) -> str:
    return call(python.with_name("flightbed"), *arguments, cwd=cwd)


def test_a_pin_is_the_lower_bound() -> None:
    assert lowest("numpy>=2.0") == "numpy==2.0"
    assert lowest("pydantic>=2.10,<3") == "pydantic==2.10"
    assert lowest("jsbsim==1.3.3") == "jsbsim==1.3.3"
    for unbound in ("numpy", "numpy<3"):
        with pytest.raises(ValueError, match="must have one lower bound"):
            lowest(unbound)


def test_the_installed_versions_are_the_pinned_ones(oldest: Path, tmp_path: Path) -> None:
    listed = json.loads(
        call(oldest, "-m", "pip", "list", "--format", "json", "--disable-pip-version-check", cwd=tmp_path)
    )
    found = {re.sub(r"[-_.]+", "-", item["name"]).lower(): item["version"] for item in listed}
    for pin in pins(["dev"], TOOLS):
        name, version = pin.split("==")
        assert re.sub(r"(\.0)+$", "", found[name]) == re.sub(r"(\.0)+$", "", version), name


def test_golden_flights(oldest: Path, tmp_path: Path) -> None:
    """By their samples: these versions are not in the table of SHA-256."""
    printed = call(
        oldest, "-m", "pytest", "-q", "-p", "no:cacheprovider", "tests/test_golden_flights.py",
        cwd=ROOT, PYTHONPATH=str(ROOT), NUMBA_CACHE_DIR=str(tmp_path / "numba"),
    )  # fmt: skip
    assert re.search(
        r"golden flights: \d+ shipped scenarios: 0 columns compared by SHA-256, \d{4} with samples", printed
    ), printed


def test_a_run_linearize_and_a_campaign(oldest: Path, tmp_path: Path) -> None:
    flown = json.loads(_flightbed(oldest, "run", "elevator-loss", "--json", "--out", "run", cwd=tmp_path))
    assert flown["departed"] is False
    assert flown["estimators"]["scheduled"]["final"] == pytest.approx(0.2, abs=0.02)
    assert (tmp_path / "run" / "flight.rrd").stat().st_size > 100_000
    assert "</html>" in (tmp_path / "run" / "report.html").read_text()
    model = json.loads(_flightbed(oldest, "linearize", "f16", "--mach", "0.8", "--format", "json", cwd=tmp_path))
    poles = [pole[0] for pole in flown["short_period"]["poles_rad_s"]]
    assert max(poles) == pytest.approx(0.44, abs=0.01)
    assert model
    options = ["--runs", "12", "--workers", "2", "--set", "duration_s=2", "--set", "failures.0.at_s=1", "--json"]
    printed = json.loads(_flightbed(oldest, "campaign", "elevator-loss", *options, "--out", "campaign", cwd=tmp_path))
    assert (printed["flights"], printed["errors"]) == (12, 0)
