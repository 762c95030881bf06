"""`flightbed schema`, and the schemas that are shipped."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator

from flightbed.cli.schema import schema_text
from flightbed.core import data
from flightbed.core.units import unit_of
from tests.command_line import assert_one_clear_line, flightbed

ROOT = Path(__file__).resolve().parents[2]
FILES = {
    "scenario": sorted(data.shipped("scenario").glob("*.toml")),
    "campaign": sorted(data.shipped("campaign").glob("*.toml")),
    "aircraft": sorted(data.shipped("aircraft").glob("*/aircraft.toml")),
}
KINDS = sorted(FILES)


def shipped_schema(kind: str) -> dict[str, Any]:
    """Return a schema as it is shipped."""
    content: dict[str, Any] = json.loads((data.shipped("scenario") / "schema" / f"{kind}.json").read_text())
    return content


def tables(schema: Any, place: str = "") -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield place and schema of each key: of tables, lists of tables, and each kind; not of rules between keys."""
    for key, value in schema.get("properties", {}).items():
        if isinstance(value, dict):
            yield f"{place}{key}", value
            yield from tables(value, f"{place}{key}.")
    if "items" in schema:
        yield from tables(schema["items"], place)
    for kind in schema.get("oneOf", ()):
        if "title" in kind and "type" in kind:
            yield from tables(kind, f"{place}{kind['title']}.")


@pytest.mark.parametrize("kind", KINDS)
def test_the_shipped_schema_is_what_the_command_writes(kind: str) -> None:
    shipped = (data.shipped("scenario") / "schema" / f"{kind}.json").read_text()
    assert shipped == schema_text(kind), "write it again: python -m tools.schemas"  # type: ignore[arg-type]


def test_the_command_prints_the_schema_of_a_scenario_and_refuses_other_files(tmp_path: Path) -> None:
    printed = flightbed("schema", cwd=tmp_path)
    assert json.loads(printed.stdout) == shipped_schema("scenario")
    assert printed.stderr == ""
    assert_one_clear_line(["schema", "run"], 2, 'Invalid value "run" for FILE', cwd=tmp_path)


@pytest.mark.parametrize("kind", KINDS)
def test_it_is_a_schema_that_describes_every_key(kind: str) -> None:
    schema = shipped_schema(kind)
    Draft202012Validator.check_schema(schema)
    found = list(tables(schema))
    assert len(found) > {"scenario": 250, "campaign": 20, "aircraft": 60}[kind]
    without = [place for place, key in found if not key.get("description", "").strip()]
    assert without == []


@pytest.mark.parametrize("kind", KINDS)
def test_numbers_have_units_and_integers_have_ranges(kind: str) -> None:
    for place, key in tables(shipped_schema(kind)):
        name = place.rpartition(".")[2]
        if key.get("type") in ("number", "integer") and unit_of(name) != "1":
            unit = "1/s" if name.endswith("_1_s") else "1/s^2" if name.endswith("_1_s2") else unit_of(name)
            assert f"Unit: {unit}." in key["description"], place
        if key.get("type") == "integer" and "const" not in key:
            assert "minimum" in key, place
            assert "maximum" in key or kind == "aircraft", place


@pytest.mark.parametrize("kind", KINDS)
def test_every_shipped_file_is_valid_and_names_its_schema(kind: str) -> None:
    validator = Draft202012Validator(shipped_schema(kind))
    assert FILES[kind]
    for file in FILES[kind]:
        text = file.read_text()
        assert [error.message for error in validator.iter_errors(tomllib.loads(text))] == [], file
        first = text.partition("\n")[0]
        assert first.startswith("#:schema ."), file
        target = file.parent / first.removeprefix("#:schema ")
        assert target.resolve() == (ROOT / "scenarios" / "schema" / f"{kind}.json").resolve(), file


def test_schemas_are_neither_scenarios_nor_campaigns_nor_aircraft() -> None:
    for kind in ("scenario", "campaign", "aircraft"):
        assert "schema" not in data.names(kind)


@pytest.mark.parametrize(
    ("change", "valid"),
    [
        ({"axes": [{"key": "condition.mach", "values": [0.5, 0.6]}]}, True),
        ({"axes": [{"key": "condition.mach", "from": 0.5, "to": 0.6, "count": 3}]}, True),
        ({"axes": [{"key": "condition.mach", "from": 0.5, "to": 0.6}]}, False),
        ({"axes": [{"key": "condition.mach", "values": [0.5], "count": 3}]}, False),
        ({"axes": [{"key": "condition.mach"}]}, False),
        ({"axes": [{"key": "condition.mach", "distribution": "uniform", "low": 0.5, "high": 0.6}]}, True),
        ({"axes": [{"key": "condition.mach", "distribution": "uniform", "low": 0.5}]}, False),
        ({"axes": [{"key": "condition.mach", "distribution": "uniform", "low": 0.5, "high": 0.6, "std": 1.0}]}, False),
        ({"axes": [{"key": "condition.mach", "distribution": "normal", "mean": 0.5, "std": 0.1, "low": 0.4}]}, True),
        ({"axes": [{"key": "condition.mach", "distribution": "normal", "mean": 0.5}]}, False),
        ({"criteria": [{"metric": "departed", "equals": False}]}, True),
        ({"criteria": [{"metric": "departed", "min": 0, "max": 1.5}]}, True),
        ({"criteria": [{"metric": "departed", "equals": False, "max": 1}]}, False),
        ({"criteria": [{"metric": "departed"}]}, False),
        ({"traces": {"keep": "chosen", "indices": [3]}}, True),
        ({"traces": {"keep": "chosen"}}, False),
        ({"traces": {"indices": [3]}}, False),
        ({"histories": {"keep": "chosen", "points": [0]}}, True),
        ({"histories": {"keep": "none", "points": [0]}}, False),
        ({"runs": 0}, False),
        ({"runs": True}, False),
    ],
)
def test_the_schema_of_a_campaign_states_what_the_reader_checks(change: dict[str, Any], valid: bool) -> None:
    from flightbed.campaigns.settings import CampaignSettings
    from flightbed.config.reading import with_tuples
    from flightbed.config.table import ValidationError

    raw = {"schema": 1, "name": "mine", "base": "elevator-loss", "runs": 2, **change}
    assert Draft202012Validator(shipped_schema("campaign")).is_valid(raw) is valid
    if valid:
        assert CampaignSettings.model_validate(with_tuples(raw)).name == "mine"
    else:
        with pytest.raises(ValidationError):
            CampaignSettings.model_validate(with_tuples(raw))
