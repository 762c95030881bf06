"""KEY=VALUE overrides of a nested mapping: ``failures.0.to=0.35`` reaches every key."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping, Sequence
from typing import Any

from flightbed.errors import ScenarioError


def override(raw: Mapping[str, Any], overrides: Sequence[str]) -> tuple[Mapping[str, Any], frozenset[str]]:
    """Apply overrides in order; values are read as TOML, or else taken as text.

    Returns:
        The new mapping, and the keys that were set.

    Raises:
        ScenarioError: an override is not KEY=VALUE, or its key reaches into nothing.

    """
    if isinstance(overrides, str):
        raise TypeError(f"overrides must be a list of KEY=VALUE, not one string (got {overrides!r})")
    keys = []
    for text in overrides:
        key, equals, value = text.partition("=")
        if not equals:
            raise ScenarioError([f"--set {text}: must be KEY=VALUE, for example --set failures.0.to=0.35"])
        raw = replaced(raw, key.split("."), toml_value(value), f"--set {text}")
        keys.append(key)
    return raw, frozenset(keys)


def toml_value(text: str) -> Any:
    """Read a value as TOML, or else take it as text."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        try:
            return float(text)  # ".5" and "1." are numbers to everyone but TOML
        except ValueError:
            return {"True": True, "False": False}.get(text, text)


def setting(key: str, value: Any) -> str:
    """Return KEY=VALUE for a value of TOML, as an override reads it back."""
    is_plain = isinstance(value, str) and toml_value(value) == value and isinstance(toml_value(value), str)
    return f"{key}={value if is_plain else json.dumps(value, ensure_ascii=False)}"


def replaced(node: Any, keys: Sequence[str], value: Any, place: str) -> Any:
    """Return a copy of a nested structure with one value replaced; tables on the way are made as needed.

    Raises ScenarioError, with the place, when the keys reach into nothing.
    """
    key, rest = keys[0], keys[1:]
    missing: Any = [] if rest and rest[0].isdigit() else {}
    if isinstance(node, list):
        if not key.isdigit() or int(key) > len(node):
            raise ScenarioError([f"{place}: '{key}' must be an index from 0 to {len(node)} ({len(node)} adds one)"])
        index = int(key)
        old = node[index] if index < len(node) else missing
        return [*node[:index], replaced(old, rest, value, place) if rest else value, *node[index + 1 :]]
    if not isinstance(node, dict):
        raise ScenarioError([f"{place}: '{key}': there is no table here to reach into"])
    return {**node, key: replaced(node.get(key, missing), rest, value, place) if rest else value}
