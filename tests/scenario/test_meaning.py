"""A file means what it says: a key without effect is refused, dropped by name where an override disables it, or an old default."""

from __future__ import annotations

import tomllib
from typing import Any

import pytest

from flightbed.core import data
from flightbed.core.errors import ScenarioError
from flightbed.scenario.reading import Scenario, load_scenario, read_scenario, settle

TWO_STAGE = {"name": "b", "kind": "two-stage"}


def raw_scenario(**tables: Any) -> dict[str, Any]:
    """Return the contents of a short file with these tables."""
    return {"schema": 1, "name": "mine", "duration_s": 10.0, **tables}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"failures": [{"kind": "cg-shift", "at_s": 1.0, "shift_cbar": 0.01, "to": 0.2}]},
            "scenario: failures.0.to: 'cg-shift' has no such key ('effectiveness', 'ramp', 'rate-limit', 'structural' have it); remove it",
        ),
        (
            {"failures": [{"at_s": 1.0, "to": 0.2, "over_s": 3.0}]},
            "scenario: failures.0.over_s: 'effectiveness' has no such key ('ramp' has it); remove it",
        ),
        (
            {"estimators": [{**TWO_STAGE, "forgetting": 0.95}]},
            "scenario: estimators.0.forgetting: has no effect with estimators.0.memory = 'variable' (got 0.95); remove it",
        ),
        (
            {"estimators": [{"name": "a", "memory": "expanding", "window": 20}]},
            "scenario: estimators.0.window: has no effect with estimators.0.memory = 'expanding' (got 20); remove it",
        ),
        (
            {"estimators": [{"name": "a", "prior": {"alpha_deg": 1.0}}]},
            "scenario: estimators.0.prior.alpha_deg: has no effect with estimators.0.prior.state = 'measurement' (got 1.0); remove it",
        ),
        (
            {"estimators": [{"name": "a", "kind": "plid", "prior": {"state": "fixed"}}]},
            "scenario: estimators.0.prior.state: 'plid' has no such key ('loop-gain' has it); remove it",
        ),
        (
            {"adaptation": {"estimator": "nobody"}},
            "scenario: adaptation.estimator: has no effect with adaptation.enabled = false (got 'nobody'); remove it\n"
            "scenario: adaptation.estimator: no estimator is named 'nobody'; known: none",
        ),
        (
            {"control": {"state_from": "nobody"}},
            "scenario: control.state_from: no estimator is named 'nobody'; known: none",
        ),
        (
            {"lateral": {"roll": {"kind": "doublet"}}},
            "scenario: lateral.roll.kind: has no effect with lateral.enabled = false (got 'doublet'); remove it",
        ),
        (
            {"sensors": {"beta_std_deg": 0.1}},
            "scenario: sensors.beta_std_deg: has no effect with lateral.enabled = false (got 0.1); remove it",
        ),
        (
            {"control": {"law": "proportional", "integral_pole_rad_s": -1.0}},
            "scenario: control.integral_pole_rad_s: 'proportional' has no such key ('proportional-integral' has it); remove it",
        ),
        (
            {"command": {"kind": "none", "period_s": 3.0}},
            "scenario: command.period_s: 'none' has no such key (",
        ),
        (
            {"command": {"amplitude_g": 2.0}},
            "scenario: command.amplitude_g: has no effect with control.law = 'proportional' (got 2.0); remove it",
        ),
    ],
)
def test_a_key_without_effect_is_refused_in_a_file(change: dict[str, Any], message: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        load_scenario(raw_scenario(**change))
    found = "\n".join(caught.value.problems)
    assert found.startswith(message) if message.endswith("(") else found == message


@pytest.mark.parametrize("name", sorted(data.names("scenario")))
def test_the_resolved_file_holds_only_keys_that_act_and_is_the_same_scenario(name: str) -> None:
    scenario = load_scenario(name)
    resolved = tomllib.loads(scenario.to_toml())
    assert load_scenario(resolved) == scenario
    assert load_scenario(resolved).to_dict() == scenario.to_dict() == resolved


def test_a_resolved_flight_has_few_keys() -> None:
    def count(value: Any) -> int:
        if isinstance(value, dict):
            return sum(map(count, value.values()))
        if isinstance(value, list) and value and isinstance(value[0], dict):
            return sum(map(count, value))
        return 1

    assert count(load_scenario("elevator-loss").to_dict()) <= 80


@pytest.mark.parametrize(
    ("override", "dropped"),
    [
        ("adaptation.enabled=false", {"adaptation.estimator", "adaptation.floor"}),
        ("command.kind=none", {"command.amplitude_deg_s", "command.period_s", "command.count"}),
        ("estimators.0.memory=expanding", {"estimators.0.window"}),
        ("estimators.0.kind=plid", {"estimators.0.input", "estimators.0.memory", "estimators.0.window"}),
    ],
)
def test_a_key_that_an_override_leaves_without_effect_is_dropped_and_named(override: str, dropped: set[str]) -> None:
    reading = read_scenario("elevator-loss", [override])
    assert dropped <= set(reading.dropped)
    (note,) = reading.notes
    assert note.startswith("dropped from the file: ")
    for key in reading.dropped:
        assert key in note
        assert key in reading.scenario.description.partition("dropped: ")[2]
    assert load_scenario(reading.scenario.to_dict()) == reading.scenario


def test_an_override_without_effect_is_refused_whatever_other_overrides_do() -> None:
    with pytest.raises(ScenarioError) as caught:
        load_scenario("elevator-loss", ["adaptation.enabled=false", "adaptation.floor=0.2"])
    assert list(caught.value.problems) == ["--set adaptation.floor: has no effect with adaptation.enabled = false"]


def test_a_key_that_has_no_effect_in_the_file_alone_is_refused_with_overrides_too() -> None:
    raw = raw_scenario(estimators=[{"name": "a", "memory": "expanding", "window": 20}])
    with pytest.raises(ScenarioError, match=r"estimators.0.window: has no effect"):
        load_scenario(raw, ["duration_s=2.0"])


def test_a_name_that_does_not_exist_is_refused_where_an_override_switches_it_off() -> None:
    raw = raw_scenario(estimators=[{"name": "a"}], adaptation={"enabled": True, "estimator": "nobody"})
    with pytest.raises(ScenarioError, match="adaptation.estimator: no estimator is named 'nobody'"):
        load_scenario(raw, ["adaptation.enabled=false"])


def test_at_a_point_of_a_campaign_values_without_effect_are_dropped() -> None:
    raw = raw_scenario(estimators=[{"name": "a", "kind": "plid", "window": 20}])
    reading = settle(raw, "here", {})
    assert set(reading.dropped) == {"estimators.0.window"}
    assert isinstance(reading.scenario, Scenario)
