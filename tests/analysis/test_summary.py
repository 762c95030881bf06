"""Summaries are types: metrics.json is read back as it was written, also from version 0.1, and no code indexes a summary by a string."""

from __future__ import annotations

import ast
import dataclasses
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from flightbed.analysis.metrics import Metrics
from flightbed.analysis.result import Result
from flightbed.analysis.summary import ExtensionSummary, RunSummary
from flightbed.campaigns.run import fly
from flightbed.core.environment import environment
from flightbed.core.sources import source_sha256
from flightbed.flight.pacing import WallClock
from flightbed.runs.run import run
from flightbed.scenario.reading import load_scenario
from tests.lateral_flight import SOON, rolling

ROOT = Path(__file__).resolve().parents[2]
SUMMARY_MODULES = {"flightbed/analysis/summary.py", "flightbed/campaigns/summary.py"}
FILES = sorted(
    p for folder in ("flightbed", "benchmarks", "examples", "tools", "tests") for p in (ROOT / folder).rglob("*.py")
)


def _is_summary(node: ast.expr) -> bool:
    """Return whether an expression is named as a summary: ``summary``, ``x_summary``, ``x.summary``."""
    name = node.id if isinstance(node, ast.Name) else node.attr if isinstance(node, ast.Attribute) else ""
    return name == "summary" or name.endswith("_summary")


def _is_text(node: ast.expr) -> bool:
    return isinstance(node, ast.JoinedStr) or (isinstance(node, ast.Constant) and isinstance(node.value, str))


def _string_indices(source: str) -> Iterator[int]:
    """Yield the lines with a string index into a summary: ``summary["x"]``, ``summary[f"x_{y}"]``, ``summary.get("x")``."""
    for node in ast.walk(ast.parse(source)):
        match node:
            case ast.Subscript(value=value, slice=key) if _is_summary(value) and _is_text(key):
                yield node.lineno
            case ast.Call(func=ast.Attribute(value=value, attr="get"), args=[key, *_]) if _is_summary(
                value
            ) and _is_text(key):
                yield node.lineno


def test_no_code_indexes_a_summary_by_a_string() -> None:
    assert len(FILES) > 200
    found = {
        f"{path.relative_to(ROOT).as_posix()}:{line}"
        for path in FILES
        for line in _string_indices(path.read_text(encoding="utf-8"))
        if path.relative_to(ROOT).as_posix() not in SUMMARY_MODULES
    }
    assert found == set()


@pytest.mark.parametrize(
    ("source", "planted"),
    [
        ("summary['departed']", True),
        ("run_summary['departed']", True),
        ("result.summary['trim']['alpha_deg']", True),
        ("run(scenario).summary['ended']", True),
        ("campaign.summary.get('departed', None)", True),
        ("summary[f'tracking_rms_{phase}_{key}']", True),
        ("summary.metrics.estimators['scheduled']", False),
        ("summary.versions.get('jsbsim')", False),
        ("summary[0]", False),
        ("row['departed']", False),
    ],
)
def test_a_planted_string_index_is_found(source: str, planted: bool) -> None:
    assert list(_string_indices(source)) == ([1] if planted else [])


def _paced() -> Result:
    return run(load_scenario("elevator-loss", ["duration_s=0.5", "failures.0.at_s=0.2"]), pace=WallClock())


FLIGHTS = {
    "pitch": lambda: run(load_scenario("elevator-loss", ["duration_s=2", "failures.0.at_s=1"])),
    "lateral": lambda: run(rolling(SOON)),
    "load factor": lambda: run(load_scenario("pull-up-loss", ["duration_s=1", "failures=[]"])),
    "linear aircraft": lambda: run(load_scenario("thesis-loss", ["duration_s=1", "failures.0.at_s=0.5"])),
    "reconstruction": lambda: run(load_scenario("harmonic-gust", ["duration_s=1", "gusts.0.at_s=0.2"])),
    "paced": _paced,
}


@pytest.fixture(scope="module")
def summaries() -> dict[str, RunSummary]:
    return {name: fly_it().summary for name, fly_it in FLIGHTS.items()}


@pytest.mark.parametrize("name", FLIGHTS)
def test_metrics_json_is_read_back(name: str, summaries: dict[str, RunSummary], tmp_path: Path) -> None:
    summary = summaries[name]
    (tmp_path / "metrics.json").write_text(json.dumps(summary.to_dict(), indent=2, allow_nan=False))
    found = RunSummary.read(tmp_path / "metrics.json")
    assert found == summary
    assert json.dumps(found.to_dict()) == json.dumps(summary.to_dict())
    assert (found.realtime is not None) == (name == "paced")
    assert (found.margins.aileron_and_rudder is not None) == (name == "lateral")


def test_sources_and_environment_are_stored(summaries: dict[str, RunSummary]) -> None:
    stored = summaries["pitch"].to_dict()
    assert stored["source_sha256"] == source_sha256()
    assert stored["environment"] == dict(environment())
    assert {"platform", "libc", "jsbsim", "compiled for"} < set(stored["environment"])
    assert stored["plug_ins"] == {}


def test_own_code_is_read_back(summaries: dict[str, RunSummary]) -> None:
    own = (ExtensionSummary("mine.py:E", "0123", {"helper.py": "4567"}), ExtensionSummary("at-hand", None))
    summary = dataclasses.replace(summaries["pitch"], extensions=own)
    assert RunSummary.from_dict(json.loads(json.dumps(summary.to_dict()))) == summary
    assert summary.own_code == ("mine.py:E", "at-hand")


LATER = (
    "estimators_since_s", "tracking_rms_pre_p_deg_s", "tracking_rms_post_p_deg_s", "tracking_rms_pre_beta_deg",
    "tracking_rms_post_beta_deg", "tracking_rms_pre_nz_g", "tracking_rms_post_nz_g", "pull_up_overshoot", "pull_up_undershoot",
    "pull_up_disturbance_g", "pull_up_flutter_deg", "elevator_at_stop_share", "bank_max_deg", "extensions", "realtime", "source_sha256", "environment", "plug_ins", "margins",
)  # fmt: skip


def _version_0_1(summary: RunSummary) -> dict[str, Any]:
    """Return the metrics.json of an early 0.1: without the later keys, with a removed one."""
    early: dict[str, Any] = json.loads(json.dumps(summary.to_dict()))
    for key in LATER:
        del early[key]
    for measured in early["estimators"].values():
        for key in ("false_alarms", "nees_mean_post", "efficiency", "nis_expected"):
            del measured[key]
    return {**early, "gone": {"a": 1}}


def test_a_folder_of_version_0_1_is_read(summaries: dict[str, RunSummary]) -> None:
    now = summaries["pitch"]
    found = RunSummary.from_dict(_version_0_1(now))
    assert found.others == {"gone": {"a": 1}}
    assert (found.source_sha256, found.environment, found.plug_ins) == (None, {}, {})
    assert (found.bank_max_deg, found.realtime, found.extensions, found.metrics.estimators_since_s) == (
        None,
        None,
        (),
        None,
    )
    before, after = found.metrics.estimators["scheduled"], now.metrics.estimators["scheduled"]
    assert (before.final, before.nis_mean, before.nis_expected) == (after.final, after.nis_mean, None)
    assert found.trim == now.trim
    assert found.to_dict()["gone"] == {"a": 1}


@pytest.mark.parametrize("key", ["estimators", "flown_s", "failed_at_s", "departed", "departed_at_s", "ended", "trim"])
def test_a_file_without_a_key_of_every_version_is_refused(key: str, summaries: dict[str, RunSummary]) -> None:
    values = summaries["pitch"].to_dict()
    del values[key]
    with pytest.raises(ValueError, match=key):
        RunSummary.from_dict(values)


@pytest.mark.parametrize("values", [[], {}, {"estimators": []}])
def test_other_json_is_refused(values: Any) -> None:
    with pytest.raises(ValueError, match="not the metrics of a flight"):
        RunSummary.from_dict(values)


def test_the_keys_of_metrics_json_and_their_order(summaries: dict[str, RunSummary]) -> None:
    """Scripts read them: a key is added, never renamed."""
    assert list(summaries["pitch"].to_dict()) == [
        "scenario", "seed", *(f.name for f in dataclasses.fields(Metrics)), "snr_db", "ended", "failed_at_s", "flown_s",
        "elevator_at_stop_share", "bank_max_deg", "trim", "short_period", "gains", "extensions", "aircraft_sha256", "wall_time_s",
        "real_time_factor", "realtime", "versions", "source_sha256", "environment", "plug_ins", "margins",
    ]  # fmt: skip


def test_a_campaign_is_summarized_once_from_its_rows() -> None:
    campaign = fly(load_scenario("elevator-loss-fixed", ["duration_s=1", "failures.0.at_s=0.4"]), 3)
    assert campaign.summary is campaign.summary
    found, stored = campaign.summary, campaign.summary.to_dict()
    assert list(stored)[:6] == ["scenario", "name", "campaign", "flights", "runs", "first_seed"]
    assert list(stored)[-10:] == [
        "bootstrap",
        "histories",
        "points",
        "worst",
        "wall_time_s",
        "aircraft_sha256",
        "versions",
        "source_sha256",
        "extensions",
        "plug_ins",
    ]
    assert found.flights.departed is not None
    assert stored["departed"]["count"] == found.flights.departed.count == 0
    for column, values in found.flights.quantities.items():
        assert values.median == campaign.quantity(column).median
