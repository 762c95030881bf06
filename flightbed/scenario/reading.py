"""Reading of scenarios: TOML -> frozen Scenario, with --set overrides; all problems are reported at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from flightbed.config.overrides import override
from flightbed.config.reading import frozen, problems, read_toml, shown
from flightbed.config.table import ValidationError
from flightbed.core import data
from flightbed.core.errors import ScenarioError
from flightbed.scenario.checks import conflicts, unused_keys
from flightbed.scenario.tables import Scenario

__all__ = ["Scenario", "load_scenario"]


def load_scenario(source: str | Path | Mapping[str, Any], overrides: Sequence[str] = ()) -> Scenario:
    """Read a scenario and apply overrides.

    Args:
        source: path, shipped name, or mapping.
        overrides: KEY=VALUE, such as ``"failures.0.to=0.35"``.

    Raises:
        UnknownNameError: no such scenario.
        ScenarioError: the scenario is invalid; lists every problem.

    """
    if isinstance(source, Mapping):
        return build(source, "scenario", overrides)
    path = data.find("scenario", str(source))
    return build(read_toml(path), shown(path), overrides)


def build(raw: Mapping[str, Any], place: str, overrides: Sequence[str] = ()) -> Scenario:
    """Return the scenario of a file's contents with overrides; ``place`` names the file in errors. Raises ScenarioError."""
    return changed(raw, place, overrides)[1]


def changed(raw: Mapping[str, Any], place: str, overrides: Sequence[str]) -> tuple[Mapping[str, Any], Scenario]:
    """Return a file's contents with overrides applied and noted in the description, and its scenario. Raises ScenarioError."""
    raw, overridden = override(raw, overrides)
    description = raw.get("description", "")
    if overridden and "description" not in overridden and isinstance(description, str):
        raw = {**raw, "description": f"{description} (changed: {', '.join(overrides)})".strip()}
    scenario = validated(raw, place, dict.fromkeys(overridden, "--set"))
    if idle := [
        f"--set {key}: has no effect with {why}" for key, why in unused_keys(scenario).items() if key in overridden
    ]:
        raise ScenarioError(idle)
    return raw, scenario


def validated(raw: Mapping[str, Any], place: str, origins: Mapping[str, str]) -> Scenario:
    """Return the scenario of nested plain values.

    Args:
        raw: contents of a file, overrides applied.
        place: name of the file in errors.
        origins: key set elsewhere -> its origin in errors, ``"--set"`` or a place in a campaign file.

    Raises:
        ScenarioError: the scenario is invalid; lists every problem.

    """
    try:
        scenario = Scenario.model_validate(frozen(raw))
    except ValidationError as error:
        raise ScenarioError(problems(error, place, origins, model=Scenario)) from None
    if found := conflicts(scenario):
        raise ScenarioError([f"{place}: {line}" for line in found])
    return scenario
