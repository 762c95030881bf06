"""Files of version 0.1: the resolved ones are read, keys with another value are refused with the cure, and ``upgrade`` removes them."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import pytest

from flightbed.core.errors import ScenarioError
from flightbed.scenario.reading import load_scenario
from flightbed.scenario.upgrade import upgraded

FOLDER = Path(__file__).parents[1] / "golden" / "version_0_1"
# file -> the shipped scenario that it resolves: on the F-16, with roll and yaw, linear
READ = {
    "elevator-loss": "elevator-loss",
    "aileron-loss": "aileron-loss",
    "thesis-loss-without-integral": "thesis-loss",
}


def _settings(scenario: Any) -> dict[str, Any]:
    """Return the settings of a scenario; texts have changed since version 0.1, and a resolved file names its aircraft by hash."""
    return {key: value for key, value in scenario.to_dict().items() if key not in ("description", "aircraft")}


@pytest.mark.parametrize("name", sorted(READ))
def test_a_resolved_file_of_version_0_1_is_read(name: str) -> None:
    old = load_scenario(FOLDER / f"{name}.toml")
    new = load_scenario(READ[name])
    assert _settings(old) == _settings(new)
    assert old.aircraft.model == new.aircraft.model
    assert len(old.aircraft.sha256) == 64


def test_a_key_without_effect_that_does_not_have_its_old_default_is_refused_with_the_cure() -> None:
    file = FOLDER / "thesis-loss.toml"
    with pytest.raises(ScenarioError) as caught:
        load_scenario(file)
    assert str(caught.value) == (
        f"{file}: control.gains.integral: 'proportional' has no such key ('proportional-integral' has it); "
        "remove it, or let `flightbed upgrade` do so"
    )
    text, dropped = upgraded(file.read_text(), str(file))
    assert ("control.gains.integral", "-0.0001", "law = 'proportional'") in dropped
    assert _settings(load_scenario(tomllib.loads(text))) == _settings(load_scenario("thesis-loss"))


@pytest.mark.parametrize("name", [*sorted(READ), "thesis-loss"])
def test_an_upgraded_file_is_the_same_scenario_and_is_not_changed_again(name: str) -> None:
    file = FOLDER / f"{name}.toml"
    text, dropped = upgraded(file.read_text(), str(file))
    assert dropped
    assert text.startswith("# Resolved by version 0.1")
    raw = tomllib.loads(text)
    assert raw == _without_empty(raw)
    if name in READ:
        assert load_scenario(raw) == load_scenario(file)
    assert upgraded(text, str(file)) == (text, [])


def _without_empty(value: Any) -> Any:
    """Return nested values without empty tables."""
    if isinstance(value, list):
        return [_without_empty(inner) for inner in value]
    if not isinstance(value, dict):
        return value
    return {key: kept for key, inner in value.items() if (kept := _without_empty(inner)) != {}}


HAND_WRITTEN = """# my notes
schema = 1
name = "mine"          # of this file
duration_s = 10.0

[command]
kind = "none"
amplitude_deg_s = 3.0  # not used
# a comment between
filter_rad_s = 2.0     # kept

[[estimators]]
name = "a"
memory = "expanding"   # all readings
window = 20            # not used

[[estimators]]
name = "b"
kind = "two-stage"
forgetting = 0.95

[[failures]]
kind = "cg-shift"
at_s = 1.0
shift_cbar = 0.01
to = 0.2
"""


def test_upgrade_removes_keys_without_effect_and_keeps_the_rest_as_it_was_written() -> None:
    with pytest.raises(ScenarioError, match=r"failures\.0\.to: 'cg-shift' has no such key"):
        load_scenario(tomllib.loads(HAND_WRITTEN))
    text, dropped = upgraded(HAND_WRITTEN, "mine.toml")
    assert {key: value for key, value, _ in dropped} == {
        "command.amplitude_deg_s": "3.0",
        "estimators.0.window": "20",
        "estimators.1.forgetting": "0.95",
        "failures.0.to": "0.2",
    }
    gone = ("amplitude_deg_s", "window", "forgetting", "to = 0.2")
    lines = [line for line in HAND_WRITTEN.splitlines() if not line.startswith(gone)]
    assert text.splitlines() == lines
    load_scenario(tomllib.loads(text))
    assert upgraded(text, "mine.toml") == (text, [])


def test_upgrade_refuses_a_file_that_is_invalid_for_another_reason() -> None:
    with pytest.raises(ScenarioError, match=r"mine\.toml: unknown key durations; did you mean duration_s\?"):
        upgraded(HAND_WRITTEN.replace("duration_s", "durations"), "mine.toml")
    with pytest.raises(ScenarioError, match=r"mine\.toml: not TOML"):
        upgraded("schema = = 1", "mine.toml")
