"""The documents stay true: every key is explained, and the README's Python runs."""

from __future__ import annotations

import json
import re
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from flightbed.campaigns.file import load_programme
from flightbed.campaigns.settings import CampaignSettings
from flightbed.config.catalogue import catalogue
from flightbed.config.table import known_keys
from flightbed.core import data
from flightbed.flight.pacing import WallClock
from flightbed.runs.run import run
from flightbed.scenario.reading import load_scenario
from flightbed.scenario.tables import Scenario
from tests.test_architecture import LEVEL
from tools.tables import keys

ROOT = Path(__file__).resolve().parents[1]


def test_the_tables_of_keys_are_those_of_the_settings_classes() -> None:
    page = keys.PAGE.read_text(encoding="utf-8")
    assert keys.filled(page) == page, "write them again: python -m tools.tables.keys"
    tables = page.partition("## Keys")[2].partition("## metrics.json")[0]
    explained = set(re.findall(r"^\| `([^`]+)`", tables, flags=re.MULTILINE))
    shared = re.compile(r"lateral\.(roll|sideslip)\.(?!kind|amplitude)")  # with the command's descriptions
    assert explained == {key.path for key in catalogue(Scenario) if not shared.match(key.path)}


def test_the_campaign_file_of_the_document_loads_and_every_key_is_in_the_table(tmp_path: Path) -> None:
    page = (ROOT / "docs" / "campaigns.md").read_text()
    (example,) = re.findall(r"```toml\n(.*?)```", page, flags=re.DOTALL)
    (tmp_path / "my.toml").write_text(example)
    assert len(load_programme(tmp_path / "my.toml")) == 3 * 5 * 20
    rows = [
        line.split("|")[1]
        for line in page.partition("## Definition of a flight")[0].splitlines()
        if line.startswith("| `")
    ]
    explained = {key for row in rows for key in re.findall(r"`([^`]+)`", row)} - set(data.names("campaign"))
    inner = {"axes": known_keys(CampaignSettings, ("axes",)), "criteria": known_keys(CampaignSettings, ("criteria",))}
    inner |= {table: known_keys(CampaignSettings, (table,)) for table in ("traces", "histories")}
    outer = set(known_keys(CampaignSettings, ())) - set(inner)
    assert explained == outer | {f"{table}.{key}" for table, keys in inner.items() for key in keys}
    shipped = dict(
        re.findall(r"^\| `([a-z-]+)` \|.*\| (\d+) \|$", page.partition("## Campaign file")[0], flags=re.MULTILINE)
    )
    assert shipped == {name: str(len(load_programme(name))) for name in data.names("campaign")}


def test_every_metric_is_explained() -> None:
    text = (ROOT / "docs" / "scenario.md").read_text().partition("## metrics.json")[2]
    flown = run(load_scenario("nominal", ["duration_s=0.5"]), pace=WallClock())
    stored = json.loads(json.dumps(flown.summary.to_dict()))
    for key in stored:
        assert f"`{key}" in text or key in ("scenario", "seed"), key
    for key in stored["estimators"]["scheduled"]:
        assert key in text, key
    for key in stored["realtime"]:
        assert f"`realtime.{key}`" in text or f"`.{key}`" in text, key
    assert all(f"`{column}`" in text for column in ("release_late_ms", "compute_ms", "slack_ms"))


def test_the_python_of_the_readme_runs() -> None:
    (code,) = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), flags=re.DOTALL)
    names: dict[str, Any] = {}
    exec(compile(code, "README.md", "exec"), names)
    assert names["result"].metrics.departed is False
    assert names["model"].A.shape == (10, 10)


def test_the_worked_example_of_linearize_says_what_comes_out(capsys: pytest.CaptureFixture[str]) -> None:
    (code,) = re.findall(r"```python\n(.*?)```", (ROOT / "docs" / "linearize.md").read_text(), flags=re.DOTALL)
    exec(compile(code, "linearize.md", "exec"), {})
    roots = [float(x) for x in capsys.readouterr().out.strip("[] \n").split()]
    assert roots[0] == pytest.approx(0.32, abs=0.005)
    assert 0.009 < roots[-1] < roots[1] < 0.03


def test_links_between_documents_lead_somewhere() -> None:
    for page in [ROOT / "README.md", *(ROOT / "docs").glob("*.md"), ROOT / "aircraft" / "f16" / "README.md"]:
        for target in re.findall(r"\]\((?!https?:)([^)#]+)\)", page.read_text()):
            assert (page.parent / target).exists(), f"{page.name}: {target}"


ARCHITECTURE = (ROOT / "docs" / "architecture.md").read_text()


def test_every_file_that_the_architecture_page_names_exists() -> None:
    named = set(re.findall(r"`((?:[a-z_]+/)*[a-z_]+\.py)`", ARCHITECTURE))
    assert len(named) > 30
    missing = {n for n in named if not any((ROOT / top / n).is_file() for top in ("flightbed", "")) and "/" in n}
    assert missing == set()


def test_the_walks_of_the_architecture_page_go_down_along_imports() -> None:
    section = ARCHITECTURE[ARCHITECTURE.index("## Three walks") : ARCHITECTURE.index("## Telemetry")]
    walks = re.findall(r"`[\w/]+\.py` \(\d\)(?:\s+->\s+`[\w/]+\.py` \(\d\))+", section)
    assert len(walks) == 12
    for walk in walks:
        steps = [(m[0], int(m[1])) for m in re.findall(r"`([\w/]+\.py)` \((\d)\)", walk)]
        for (source, level), (target, lower) in pairwise(steps):
            assert LEVEL[source.split("/")[0]] == level, source
            assert LEVEL[target.split("/")[0]] == lower < level, walk
            text = (ROOT / "flightbed" / source).read_text()
            package, _, module = target.removesuffix(".py").replace("/", ".").rpartition(".")
            imported = (
                rf"from flightbed\.{package}\.{module} import|from flightbed\.{package} import [^\n]*\b{module}\b"
            )
            assert re.search(imported, text), f"{source} does not import {target}"
