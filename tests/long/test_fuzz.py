"""Random scenarios: each is accepted, or refused with an InputError of one line per problem; accepted ones fly or are not computable."""

from __future__ import annotations

import copy
import math
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from flightbed.core import data
from flightbed.core.errors import FlightbedError, InputError, ScenarioError
from flightbed.runs.run import run
from flightbed.scenario.reading import Scenario, load_scenario

pytestmark = pytest.mark.long

TEXTS = {name: (data.shipped("scenario") / f"{name}.toml").read_text() for name in data.names("scenario")}
RAW = {name: tomllib.loads(text) for name, text in TEXTS.items()}
Key = tuple[str | int, ...]


def _keys(value: Any, prefix: Key = ()) -> Iterator[Key]:
    """Yield the path of every value and table."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, inner in items:
        yield (*prefix, key)
        yield from _keys(inner, (*prefix, key))


def _value_at(raw: Any, key: Key) -> Any:
    for part in key:
        raw = raw[part]
    return raw


KEYS = {name: list(_keys(raw)) for name, raw in RAW.items()}
DOTTED = sorted({".".join(map(str, key)) for keys in KEYS.values() for key in keys})
NUMBERS = st.one_of(
    st.integers(), st.floats(), st.sampled_from([0, -1, 1, 2**31, 2**63 - 1, 2**63, 10**400, 1e308, 5e-324, -0.0, 0.5])
)
WORDS = sorted({
    "none", "doublet", "multisine", "loop-gain", "two-stage", "plid", "input-kalman", "retrospective-cost", "scheduled",
    "short-period", "window", "expanding", "forgetting", "lq", "proportional", "nz-adaptive", "stuck", "cg-shift",
    "structural", "f16", "sillence", "jsbsim:c172x", "jsbsim:", "os:system", "x.py:y", "../f16", "/", "~nobody", "a\nb", "\x00", "",
})  # fmt: skip
PLAIN = st.one_of(
    st.none(), st.booleans(), NUMBERS, st.text(max_size=8), st.sampled_from(WORDS), st.dates(), st.times()
)
VALUES = st.recursive(
    PLAIN,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=5,
)
THOROUGH = settings(max_examples=1500, suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large])


def _accepted(source: str | Path | dict[str, Any], overrides: list[str]) -> Scenario | None:
    """Return the scenario of an input; None for one that is refused as it should be. Other exceptions fail the test."""
    try:
        scenario = load_scenario(source, overrides)
    except InputError as error:
        lines = str(error).splitlines()
        problems = getattr(error, "problems", ())
        assert lines
        assert all(line.strip() for line in lines), lines
        assert all(len(problem.splitlines()) == 1 for problem in problems), problems
        return None
    assert (
        load_scenario(tomllib.loads(scenario.to_toml())) == scenario
    )  # what is accepted survives the folder of its run
    return scenario


@st.composite
def mutated(draw: st.DrawFn) -> dict[str, Any]:
    """A shipped scenario with some values replaced, removed, added or doubled."""
    name = draw(st.sampled_from(sorted(RAW)))
    raw = copy.deepcopy(RAW[name])
    for _ in range(draw(st.integers(1, 3))):
        *path, last = draw(st.sampled_from(KEYS[name]))
        try:
            place: Any = raw
            for key in path:
                place = place[key]
            how = draw(st.sampled_from(["replace", "replace", "replace", "remove", "add", "double"]))
            if how == "replace":
                place[last] = draw(VALUES)
            elif how == "remove":
                del place[last]
            elif how == "add" and isinstance(place, dict):
                place[draw(st.text(max_size=6))] = draw(VALUES)
            elif isinstance(place[last], list):
                place[last] = place[last] * 2
        except (KeyError, IndexError, TypeError):  # an earlier change has removed the place
            continue
    return raw


@THOROUGH
@given(raw=mutated())
def test_mappings(raw: dict[str, Any]) -> None:
    _accepted(raw, [])


@THOROUGH
@given(
    name=st.sampled_from(sorted(RAW)),
    keys=st.lists(
        st.one_of(st.sampled_from(DOTTED), st.builds("{}.{}".format, st.sampled_from(DOTTED), st.text(max_size=4)), st.text(max_size=8)),
        min_size=1, max_size=2,
    ),
    values=st.lists(st.one_of(NUMBERS.map(repr), st.sampled_from(WORDS), st.text(max_size=10), st.sampled_from(["[", "{}", "[[1]]", "{a=1}", "[1,", "1979-05-27", "inf", "nan"])), min_size=2, max_size=2),
)  # fmt: skip
def test_overrides(name: str, keys: list[str], values: list[str]) -> None:
    _accepted(name, [f"{key}={value}" for key, value in zip(keys, values, strict=False)])


@THOROUGH
@given(
    name=st.sampled_from(sorted(TEXTS)), at=st.floats(0, 1, exclude_max=True), length=st.integers(0, 30), new=st.binary(max_size=6)
)  # fmt: skip
def test_texts(name: str, at: float, length: int, new: bytes, tmp_path_factory: pytest.TempPathFactory) -> None:
    text = TEXTS[name].encode()
    begin = int(at * len(text))
    path = tmp_path_factory.getbasetemp() / "fuzzed.toml"
    path.write_bytes(text[:begin] + new + text[begin + length :])
    _accepted(path, [])


FLOWN = load_scenario("thesis-loss", ["duration_s=0.4", "failures.0.at_s=0.2"])
FLOWN_RAW = tomllib.loads(FLOWN.to_toml())
FLOWN_NUMBERS = [
    key for key in _keys(FLOWN_RAW)
    if key[0] not in ("duration_s", "schema", "rates") and not isinstance(key[-1], int)
    and isinstance(_value_at(FLOWN_RAW, key), int | float)
]  # fmt: skip


@settings(max_examples=600, suppress_health_check=[HealthCheck.too_slow])
@given(data=st.data())
def test_flights_on_the_linear_plant(data: st.DataObject) -> None:
    """Any accepted scenario flies to finite commands, departs, or ends with a deliberate error."""
    keys = data.draw(st.lists(st.sampled_from(FLOWN_NUMBERS), min_size=1, max_size=4, unique=True))
    raw = copy.deepcopy(FLOWN_RAW)
    for *path, last in keys:
        place: Any = raw
        for key in path:
            place = place[key]
        old = place[last]
        scaled = st.sampled_from([0.0, -1.0, 1e-300, 1e-9, 0.5, 2.0, 1e3, 1e12, 1e300]).map(
            lambda factor, old=old: factor * (old or 1.0)
        )
        place[last] = data.draw(
            st.one_of(scaled, st.floats(allow_nan=False, allow_infinity=False), st.integers(-5, 50))
        )
    scenario = _accepted(raw, [])
    if scenario is None:
        return
    try:
        with np.errstate(all="ignore"):
            result = run(scenario, rerun=False, report=False)
    except FlightbedError as error:
        problems = error.problems if isinstance(error, ScenarioError) else (str(error),)
        assert len(str(error).splitlines()) == len(problems) > 0  # noqa: PT017  # most inputs raise nothing
        return
    assert 0 < len(result.trace) <= 40
    assert math.isfinite(result.trace["t_s"][-1])
