"""The JSON Schema of a scenario accepts what the loader accepts, apart from the relations that its description excepts.

Files are generated from the schema itself, kind by kind, and changed at one place: another value, a foreign key, a key less.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from jsonschema import Draft202012Validator

from flightbed.core.errors import ScenarioError
from flightbed.scenario.reading import load_scenario
from flightbed.scenario.schema import scenario_schema

SCHEMA = scenario_schema()
VALIDATOR = Draft202012Validator(SCHEMA)
Draw = Callable[[Any], Any]

# Message of the loader -> the words of the schema's description that except it.
EXCEPTED = {
    r"kind: unknown \w+; known|law: unknown law|shape: unknown gust": "a kind that it does not list is an installed kind or own code",
    r"must be unique \(got": "names of estimators are unique",
    r"no estimator is named": "name one of them",
    r"must be no later than the last tick": "times lie within the flight",
    r"must be a whole number of ticks": "a whole number of control ticks",
    r"plant_hz must be an integer multiple": "plant_hz is a multiple of control_hz",
    r"bounds must rise": "bounds rise",
    r"low_hz: must be no higher|variance_min: must be below|low_norm: must be below": "the lower one is below the higher one",
    r"poles must lie in the left half plane": "poles lie in the left half plane",
    r"must come in conjugate pairs": "in conjugate pairs",
    r"poles: must be three with": "three of a law in g",
    r"poles: cannot be combined with control.gains": "and without gains",
    r"so that each pulse lasts at least one tick": "a pulse lasts at least one tick",
    r"_hz: must be below \S+ half of|must be below half of": "a frequency lies below half of control_hz",
    r"the band from low_hz to high_hz must hold": "a band holds 1 to 100 multiples of 1/period_s",
    r"input: must be 'absolute' with model": "input = 'deviation' needs model = 'short-period'",
    r"model: .*'two-stage'|needs the scheduled model|model: must be 'scheduled'": "needs the scheduled model of 'two-stage'",
    r"must estimate the elevator's effectiveness": "needs an estimator of the elevator's K",
    r"which identifies its own model": "a law that does not identify its own model",
    r"which redesigns it|which has no alarm test": "method = 'redesign' needs the law 'lq' and an estimator with alarms",
    r"which waits for an estimator's alarm": "without oracle",
    r"the stock laws control aileron and rudder": "failures of aileron and rudder need lateral.enabled",
    r"must be a whole number \(got \d+\.0\)": "whole numbers have no decimal point",
}
OTHER_TABLE = "keys that a setting of another table leaves without effect"

# Values that seldom conflict with those of other tables, so that more of the generated files are accepted.
USUAL: dict[str, list[Any]] = {
    "duration_s": [16.5, 20.0],
    "control_hz": [100, 50],
    "plant_hz": [200, 400],
    "at_s": [0.0, 4.5, 7.25],
    "bounds": [[0.0, 1.0], [0.1, 0.9]],
    "poles": [[[-4.0, 2.0], [-4.0, -2.0], [-20.0, 0.0]]],
    "frequency_hz": [0.5, 2.0],
    "low_hz": [0.2, 0.3],
    "high_hz": [1.0, 2.0],
    "period_s": [4.5, 6.0],
    "start_s": [0.0, 1.0],
    "switch_s": [0.3, 0.5],
    "surface": ["elevator"],
    "state_from": [""],
}


@st.composite
def files(draw: Draw) -> dict[str, Any]:
    """Draw the contents of a file that the schema accepts."""
    content: dict[str, Any] = _value(draw, SCHEMA, "")
    return content


def _value(draw: Draw, schema: dict[str, Any], name: str) -> Any:
    if "const" in schema:
        return schema["const"]
    if name in USUAL and draw(st.integers(0, 9)):
        return draw(st.sampled_from(USUAL[name]))
    if "enum" in schema:
        return draw(st.sampled_from(schema["enum"]))
    if "oneOf" in schema:
        kinds = [kind for kind in schema["oneOf"] if kind["title"] != "installed kind or own code"]
        return _table(draw, draw(st.sampled_from(kinds)))
    if schema.get("type") == "object":
        return _table(draw, schema)
    if "prefixItems" in schema:
        return [_value(draw, item, "") for item in schema["prefixItems"]]
    if schema.get("type") == "array":
        return [_value(draw, schema["items"], "") for _ in range(draw(st.integers(schema.get("minItems", 0), 2)))]
    return draw(_plain(schema))


def _plain(schema: dict[str, Any]) -> st.SearchStrategy[Any]:
    """Return numbers, often at a limit or the default; text; true and false."""
    if schema["type"] == "boolean":
        return st.booleans()
    if schema["type"] == "string":
        return st.sampled_from(["a", "b", "c-1"] if "pattern" in schema else ["", "a", "b"])
    low, high = schema.get("minimum", schema.get("exclusiveMinimum", -1e3)), schema.get("maximum", 1e3)
    ends = [end for end in (low, high, schema.get("default", high)) if end != schema.get("exclusiveMinimum")]
    if schema["type"] == "integer":
        return st.sampled_from(ends) | st.integers(low, min(high, low + 100))
    inside = st.floats(low, min(high, low + 100.0), exclude_min="exclusiveMinimum" in schema)
    return st.sampled_from(ends) | inside


def _table(draw: Draw, schema: dict[str, Any]) -> dict[str, Any]:
    """Draw a table: required keys, some others, and none that a rule forbids."""
    properties, required = schema["properties"], schema.get("required", [])
    optional = sorted(set(properties) - set(required))
    some = draw(st.lists(st.sampled_from(optional), unique=True, max_size=5)) if optional else []
    table = {key: _value(draw, properties[key], key) for key in [*required, *some]}
    while forbidden := [key for key in _forbidden(schema, table) if key in table]:
        table = {key: value for key, value in table.items() if key not in forbidden}
    return table


def _forbidden(schema: dict[str, Any], table: dict[str, Any]) -> Iterator[str]:
    for rule in schema.get("allOf", ()):
        holds = Draft202012Validator(rule["if"]).is_valid(table)
        then = rule.get("then" if holds else "else", {})
        yield from (key for key, value in then.get("properties", {}).items() if value is False)


JUNK = (-1e9, 1e9, -1, 0, 1, 0.5, 2.0, "text", "", "a", True, False, [], [1.0], [0.0, 1.0], {}, {"a": 1})
FOREIGN = ("nosuch", "window", "kind", "to", "amplitude_deg_s", "gains", "memory", "name")


@st.composite
def changed_files(draw: Draw) -> dict[str, Any]:
    """Draw the contents of a file with one change that the schema may or may not accept."""
    content = draw(files())
    tables = list(_tables(content))
    table = draw(st.sampled_from(tables))
    how = draw(st.sampled_from(["value", "value", "foreign", "missing"]))
    if how == "foreign":
        table[draw(st.sampled_from(FOREIGN))] = draw(st.sampled_from(JUNK))
    elif table:
        key = draw(st.sampled_from(sorted(table)))
        if how == "missing":
            del table[key]
        else:
            table[key] = draw(st.sampled_from(JUNK))
    return content


def _tables(value: Any) -> Iterator[dict[str, Any]]:
    if isinstance(value, dict):
        yield value
    for inner in value.values() if isinstance(value, dict) else value if isinstance(value, list) else ():
        yield from _tables(inner)


def problems_of(content: dict[str, Any]) -> list[str]:
    """Return the loader's problems with a file."""
    try:
        load_scenario(content)
    except ScenarioError as error:
        return list(error.problems)
    return []


def is_excepted(problem: str) -> bool:
    """Return whether the description of the schema excepts a problem: a key of another table disables the key, or a relation."""
    if found := re.search(r"^scenario: (\S+): has no effect with (\S+)", problem):
        key, other = (each.rpartition(".")[0] for each in found.groups())
        return key != other
    return any(re.search(pattern, problem) for pattern in EXCEPTED)


def check(content: dict[str, Any], seen: Counter[str]) -> None:
    """Compare schema and loader on a file, and count the outcome."""
    problems, valid = problems_of(content), VALIDATOR.is_valid(content)
    if valid:
        assert [problem for problem in problems if not is_excepted(problem)] == []
    else:
        assert problems != [], [error.message[:200] for error in VALIDATOR.iter_errors(content)]
    seen["refused" if not valid else "relation" if problems else "accepted"] += 1


def compare(number: int) -> Counter[str]:
    """Compare schema and loader on this number of files as they are generated, and as many changed ones; return the outcomes."""
    seen: Counter[str] = Counter()
    quiet = settings(
        max_examples=number,
        derandomize=True,
        deadline=None,
        database=None,
        suppress_health_check=list(HealthCheck),
    )

    @quiet
    @given(files())
    def accepted(content: dict[str, Any]) -> None:
        assert VALIDATOR.is_valid(content)
        check(content, seen)

    @quiet
    @given(changed_files())
    def changed(content: dict[str, Any]) -> None:
        check(content, seen)

    accepted()
    changed()
    return seen


def test_the_description_of_the_schema_names_every_exception() -> None:
    for words in (*EXCEPTED.values(), OTHER_TABLE):
        assert words in SCHEMA["description"]


def test_schema_and_loader_accept_the_same_files() -> None:
    seen = compare(60)
    assert seen["accepted"] > 30
    assert seen["refused"] > 30


@pytest.mark.long
def test_schema_and_loader_accept_the_same_files_of_a_thousand() -> None:
    seen = compare(500)
    assert seen["accepted"] > 250
    assert seen["refused"] > 250
