"""The JSON Schema of ``aircraft.toml`` and the readers agree."""

from __future__ import annotations

import shutil
import tomllib
from copy import deepcopy
from pathlib import Path
from typing import Any

import pytest
import tomli_w
from jsonschema import Draft202012Validator

from flightbed.aircraft.edits import EDITS
from flightbed.aircraft.schema import aircraft_schema, edits
from flightbed.core import data
from flightbed.core.errors import AircraftError
from flightbed.models.linear_aircraft import load_flyable

VALIDATOR = Draft202012Validator(aircraft_schema())


def raw_aircraft(name: str) -> dict[str, Any]:
    """Return the contents of a shipped aircraft.toml."""
    return tomllib.loads((data.shipped("aircraft") / name / "aircraft.toml").read_text())


def test_the_kinds_of_edits_are_those_that_are_applied() -> None:
    assert set(edits()) == set(EDITS)


def change(raw: dict[str, Any], path: str, value: Any) -> dict[str, Any]:
    """Return nested tables with another value at a path; None removes the key."""
    raw = deepcopy(raw)
    *outer, last = path.split(".")
    table: Any = raw
    for part in outer:
        table = table[int(part)] if isinstance(table, list) else table[part]
    if value is None:
        del table[last]
    else:
        table[last] = value
    return raw


@pytest.mark.parametrize(
    ("name", "path", "value", "message"),
    [
        ("f16", "schema", 2, r"schema: must be 1 \(got 2\)"),
        ("f16", "title", "x", "unknown key title"),
        ("f16", "limits", None, "limits is missing"),
        ("f16", "stock.sha", "x", r"unknown key stock\.sha; did you mean sha256\?"),
        ("f16", "elevator.lag_rad_s", 0.0, r"elevator\.lag_rad_s: must be above 0"),
        ("f16", "aileron.min_deg", None, r"aileron\.min_deg is missing"),
        ("f16", "aileron.lag_rads", 1.0, r"unknown key aileron\.lag_rads; did you mean lag_rad_s\?"),
        ("f16", "rudder", None, "go together: give all or none"),
        ("f16", "properties.lateral_direct", None, "go together: give all or none"),
        ("f16", "properties.elevator_bend", "x", r"unknown key properties\.elevator_bend"),
        ("f16", "equal_to", ["x"], r"equal_to\.0: must be a fingerprint"),
        ("f16", "edits.0.do", "declared", r"edits\.0\.do: must be one of declare, .* \(got 'declared'\); did you mean declare\?"),
        ("f16", "edits.0.count", 1, r"edits\.0: unknown key count; 'declare' has: property, value"),
        ("f16", "edits.0.value", None, r"edits\.0 \(declare\): value is missing"),
        ("sillence", "kind", "lineal", "unknown key kind|kind: must be"),
        ("sillence", "condition.gamma_deg", 0.0, r"unknown key condition\.gamma_deg"),
        ("sillence", "short_period.z_q", None, r"short_period\.z_q is missing"),
        ("sillence", "elevator.lag_rad_s", -1.0, r"elevator\.lag_rad_s: must be above 0"),
        ("sillence", "elevator", None, "elevator is missing"),
    ],
)  # fmt: skip
def test_schema_and_reader_refuse_the_same_files(
    tmp_path: Path, name: str, path: str, value: Any, message: str
) -> None:
    raw = change(raw_aircraft(name), path, value)
    assert not VALIDATOR.is_valid(raw)
    folder = tmp_path / name
    shutil.copytree(data.shipped("aircraft") / name, folder)
    (folder / "aircraft.toml").write_text(tomli_w.dumps(raw))
    with pytest.raises(AircraftError, match=message):
        load_flyable(str(folder))


def test_optional_keys_may_be_absent(tmp_path: Path) -> None:
    raw = raw_aircraft("f16")
    raw = {key: value for key, value in raw.items() if key not in ("equal_to", "aileron", "rudder")}
    raw["properties"] = {
        key: value for key, value in raw["properties"].items() if not key.startswith(("lateral", "aileron", "rudder"))
    }
    raw["edits"] = [edit for edit in raw["edits"] if "$aileron" not in str(edit) and "$rudder" not in str(edit)]
    raw["edits"] = [edit for edit in raw["edits"] if edit.get("with") != "lateral.xml"]
    assert VALIDATOR.is_valid(raw)
    folder = tmp_path / "mine"
    shutil.copytree(data.shipped("aircraft") / "f16", folder)
    (folder / "aircraft.toml").write_text(tomli_w.dumps(raw))
    assert load_flyable(str(folder)).lateral == {}  # type: ignore[union-attr]


def test_the_line_that_names_the_schema_is_not_part_of_the_fingerprint(tmp_path: Path) -> None:
    folder = tmp_path / "mine"
    shutil.copytree(data.shipped("aircraft") / "f16", folder)
    file = folder / "aircraft.toml"
    first, _, rest = file.read_text().partition("\n")
    assert first.startswith("#:schema ")
    file.write_text(rest)
    assert load_flyable(str(folder)).sha256 == load_flyable("f16").sha256
