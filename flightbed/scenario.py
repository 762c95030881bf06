"""TOML -> frozen Scenario, with --set overrides; every problem is reported at once."""

from __future__ import annotations

import tomllib
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

from flightbed import data
from flightbed.consistency import idle_keys
from flightbed.errors import ScenarioError, did_you_mean
from flightbed.override import override
from flightbed.settings import Scenario, ValidationError, known_keys
from flightbed.wording import brief, message

__all__ = ["Scenario", "load_scenario"]


def load_scenario(source: str | Path | Mapping[str, Any], overrides: Sequence[str] = ()) -> Scenario:
    """Read a scenario: a path, a shipped name, or a mapping; then apply overrides like ``"failures.0.to=0.35"``.

    Raises UnknownNameError when there is no such scenario, ScenarioError with every problem otherwise.
    """
    if isinstance(source, Mapping):
        place = "scenario"
        raw: Mapping[str, Any] = source
    else:
        path = data.find("scenario", str(source))
        place = _shown(path)
        try:
            raw = tomllib.loads(path.read_text(encoding="utf-8"))
        except (OSError, UnicodeDecodeError) as error:
            raise ScenarioError([f"{place}: cannot be read: {error}"]) from None
        except tomllib.TOMLDecodeError as error:
            raise ScenarioError([f"{place}: not TOML: {error}"]) from None
    raw, overridden = override(raw, overrides)
    description = raw.get("description", "")
    if overridden and "description" not in overridden and isinstance(description, str):
        raw = {**raw, "description": f"{description} (changed: {', '.join(overrides)})".strip()}
    try:
        scenario = Scenario.model_validate(_frozen(raw))
    except ValidationError as error:
        raise ScenarioError(_problems(error, place, overridden)) from None
    if idle := [
        f"--set {key}: has no effect with {why}" for key, why in idle_keys(scenario).items() if key in overridden
    ]:
        raise ScenarioError(idle)
    return scenario


def _frozen(value: Any) -> Any:
    """Return nested lists as tuples: strict validation takes no list for a tuple."""
    if isinstance(value, Mapping):
        return {key: _frozen(inner) for key, inner in value.items()}
    return tuple(map(_frozen, value)) if isinstance(value, list | tuple) else value


def _shown(path: Path) -> str:
    return f"scenarios/{path.name}" if path.parent == data.shipped("scenario") else str(path)


def _problems(error: ValidationError, place: str, overridden: Collection[str]) -> list[str]:
    problems = []
    for item in error.errors(include_url=False):
        key = ".".join(str(part) for part in item["loc"])
        where = f"--set {key}" if key in overridden else f"{place}: {key}"
        if item["type"] == "consistency":
            problems += [f"{place}: {line}" for line in item["msg"].splitlines()]
        elif item["type"] == "extra_forbidden":
            known = known_keys(item["loc"][:-1])
            hint = did_you_mean(str(item["loc"][-1]), known) or f"; known: {', '.join(known)}"
            by_override = any(k == key or k.startswith(f"{key}.") for k in overridden)
            problems.append(f"{'--set' if by_override else place}: unknown key {key}{hint}")
        else:
            text = message(item)
            got = (
                ""
                if item["type"] in ("missing", "rates", "bounds", "poles", "outside")
                else f" (got {brief(item['input'])})"
            )
            problems.append(f"{where}: {text}{got}")
    return problems
