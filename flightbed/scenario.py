"""Reading of scenarios: TOML -> frozen Scenario, with --set overrides; all problems are reported at once."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

from pydantic import ValidationError

from flightbed.consistency import contradictions, idle_keys
from flightbed.core import data
from flightbed.core.errors import ScenarioError, did_you_mean
from flightbed.override import override
from flightbed.settings.base import known_keys
from flightbed.settings.scenario import Scenario
from flightbed.wording import brief, message

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
        f"--set {key}: has no effect with {why}" for key, why in idle_keys(scenario).items() if key in overridden
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
    if found := contradictions(scenario):
        raise ScenarioError([f"{place}: {line}" for line in found])
    return scenario


def read_toml(path: Path) -> dict[str, Any]:
    """Return the contents of a TOML file. Raises ScenarioError."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise ScenarioError([f"{shown(path)}: cannot be read: {error}"]) from None
    except tomllib.TOMLDecodeError as error:
        raise ScenarioError([f"{shown(path)}: not TOML: {error}"]) from None


def frozen(value: Any) -> Any:
    """Return nested lists as tuples: strict validation rejects a list where a tuple is declared."""
    if isinstance(value, Mapping):
        return {key: frozen(inner) for key, inner in value.items()}
    return tuple(map(frozen, value)) if isinstance(value, list | tuple) else value


def shown(path: Path) -> str:
    """Return the name of a scenario or campaign file in errors: its path in the source tree if it is shipped."""
    for kind, folder in (("scenario", "scenarios"), ("campaign", "scenarios/campaigns")):
        if path.parent == data.shipped(kind):
            return f"{folder}/{path.name}"
    return str(path)


def problems(
    error: ValidationError, place: str, origins: Mapping[str, str] = MappingProxyType({}), *, model: type
) -> list[str]:
    """Return the problems of a validation, one line each, with place, value and cure."""

    def origin_of(key: str) -> str:
        """Return the origin of a key or of a key inside it, with its separator."""
        origin = next((o for k, o in origins.items() if k == key or k.startswith(f"{key}.")), None)
        return f"{place}: " if origin is None else f"{origin} " if origin == "--set" else f"{origin}: "

    found = []
    for item in error.errors(include_url=False):
        key = ".".join(str(part) for part in item["loc"])
        if item["type"] == "consistency":
            found += [f"{place}: {key}{': ' if key else ''}{line}" for line in item["msg"].splitlines()]
        elif item["type"] == "extra_forbidden":
            known = known_keys(model, item["loc"][:-1])
            hint = did_you_mean(str(item["loc"][-1]), known) or f"; known: {', '.join(known)}"
            found.append(f"{origin_of(key).rstrip(': ')}: unknown key {key}{hint}")
        else:
            exact = origin_of(key) if key in origins else f"{place}: "
            silent = item["type"] in ("missing", "rates", "bounds", "poles", "outside")
            got = "" if silent else f" (got {brief(item['input'])})"
            found.append(f"{exact}{key}: {message(item)}{got}")
    return found
