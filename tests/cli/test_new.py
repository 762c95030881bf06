"""`flightbed new`: a scenario to start from."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator

from flightbed.config import families
from flightbed.core import data
from flightbed.scenario.reading import load_scenario
from flightbed.scenario.schema import scenario_schema
from flightbed.scenario.template import template
from tests.command_line import assert_one_clear_line, call, flightbed

FAMILIES = ("commands", "failures", "gusts", "laws", "estimators")
KINDS = [kind for family in FAMILIES for kind in families.built_in(family)]
VALIDATOR = Draft202012Validator(scenario_schema())


@pytest.mark.parametrize("kind", KINDS)
def test_a_new_file_of_every_kind_is_accepted(kind: str) -> None:
    raw = tomllib.loads(template("mine", [kind], "scenario.json"))
    scenario = load_scenario(raw)
    assert kind in {
        scenario.command.kind,
        scenario.control.law,
        *(failure.kind for failure in scenario.failures),
        *(gust.shape for gust in scenario.gusts),
        *(estimator.kind for estimator in scenario.estimators),
    }
    assert VALIDATOR.is_valid(raw)


@pytest.mark.parametrize("kind", KINDS)
def test_every_default_that_the_file_lists_can_be_set_unless_it_names_a_condition(kind: str) -> None:
    text = template("mine", [kind], "scenario.json")
    active = [
        line.removeprefix("# ") if " = " in line and "Only with" not in line and "lateral.enabled" not in line else line
        for line in text.splitlines()
    ]
    load_scenario(tomllib.loads("\n".join(active)))


def test_several_kinds_make_one_file() -> None:
    raw = tomllib.loads(
        template("mine", ["ramp", "stuck", "sine", "plid", "two-stage", "chirp", "lq"], "scenario.json")
    )
    assert [failure["kind"] for failure in raw["failures"]] == ["ramp", "stuck"]
    assert [estimator["name"] for estimator in raw["estimators"]] == ["plid", "two-stage"]
    assert raw["adaptation"]["estimator"] == "plid"
    load_scenario(raw)


def test_the_command_writes_a_file_that_names_the_shipped_schema_and_flies(tmp_path: Path) -> None:
    done = flightbed("new", "mine", "--kind", "ramp", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout == "written to mine.toml; fly it: flightbed run mine.toml\n"
    text = (tmp_path / "mine.toml").read_text()
    (address,) = re.findall(r"^#:schema file://(.*)$", text, flags=re.MULTILINE)
    assert Path(address) == data.shipped("scenario") / "schema" / "scenario.json"
    flown = call(
        "run", "mine.toml", "--set", "duration_s=5", "--rerun", "off", "--report", "off", "--json", cwd=tmp_path
    )
    assert json.loads(flown.stdout)["scenario"] == "mine"


def test_an_existing_file_is_not_replaced(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text("kept")
    refused = call("new", "other", "-o", "mine.toml", cwd=tmp_path)
    assert refused.returncode == 2
    assert refused.stderr == "flightbed: -o mine.toml: exists; give another file\n"
    assert file.read_text() == "kept"
    assert [path.name for path in tmp_path.iterdir()] == ["mine.toml"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["a b"], "new a b: a name must be letters, digits, - and _"),
        (["mine", "--kind", "rmp"], "--kind rmp: there is no such kind; did you mean ramp?; flightbed list names them"),
        (["mine", "--kind", "chirp", "--kind", "pulse"], "--kind pulse: a scenario has one of the commands (got 'chirp' too)"),
        (["mine", "-o", "nowhere/mine.toml"], "-o nowhere/mine.toml: cannot be written: No such file or directory"),
    ],
)  # fmt: skip
def test_errors_are_one_line_and_leave_nothing(tmp_path: Path, arguments: list[str], message: str) -> None:
    assert_one_clear_line(["new", *arguments], 2, message, cwd=tmp_path)
