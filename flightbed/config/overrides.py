"""KEY=VALUE overrides of a nested mapping; a dotted key such as ``failures.0.to`` addresses any value."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping, Sequence
from typing import Any

from flightbed.core.errors import ScenarioError


def override(raw: Mapping[str, Any], overrides: Sequence[str]) -> tuple[Mapping[str, Any], frozenset[str]]:
    """Apply overrides in order; a value that is not TOML is text.

    Returns:
        The new mapping, and the keys that the overrides set.

    Raises:
        ScenarioError: an override is not KEY=VALUE, or its key addresses a value inside a scalar.

    """
    if isinstance(overrides, str):
        raise TypeError(f"overrides must be a list of KEY=VALUE, not one string (got {overrides!r})")
    keys = []
    for text in overrides:
        key, equals, value = text.partition("=")
        if not equals:
            raise ScenarioError([f"--set {text}: must be KEY=VALUE, for example --set failures.0.to=0.35"])
        raw = replace_at(raw, key.split("."), toml_value(value), f"--set {text}")
        keys.append(key)
    return raw, frozenset(keys)


def toml_value(text: str) -> Any:
    """Return the TOML value of a text; a text that is not TOML is returned unchanged."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        try:
            return float(text)  # TOML has no ".5" and "1."
        except ValueError:
            return {"True": True, "False": False}.get(text, text)


def setting(key: str, value: Any) -> str:
    """Return the override KEY=VALUE of a TOML value; ``override`` reads the same value back."""
    is_plain = isinstance(value, str) and toml_value(value) == value and isinstance(toml_value(value), str)
    return f"{key}={value if is_plain else json.dumps(value, ensure_ascii=False)}"


def replace_at(node: Any, keys: Sequence[str], value: Any, place: str) -> Any:
    """Return a copy of a nested structure with one value replaced; missing tables and lists on its path are created.

    Raises ScenarioError, which names ``place``, for an index outside a list and for a key inside a scalar.
    """
    key, rest = keys[0], keys[1:]
    missing: Any = [] if rest and _is_index(rest[0]) else {}
    if isinstance(node, list):
        if not _is_index(key) or int(key) > len(node):
            raise ScenarioError([f"{place}: '{key}' must be an index from 0 to {len(node)} ({len(node)} adds one)"])
        index = int(key)
        old = node[index] if index < len(node) else missing
        return [*node[:index], replace_at(old, rest, value, place) if rest else value, *node[index + 1 :]]
    if not isinstance(node, dict):
        raise ScenarioError([f"{place}: '{key}': the value that contains it is not a table; use a key of the scenario"])
    return {**node, key: replace_at(node.get(key, missing), rest, value, place) if rest else value}


def _is_index(key: str) -> bool:
    return key.isascii() and key.isdecimal()
