"""Rewriting of files of version 0.1: keys without effect are removed, comments and order stay."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import tomlkit
from tomlkit.exceptions import TOMLKitError

from flightbed.config.messages import brief
from flightbed.config.reading import parse_toml, value_at, with_tuples
from flightbed.core.errors import ScenarioError
from flightbed.scenario.reading import settle


class Dropped(NamedTuple):
    """A key that was removed: its value as text, and the setting or kind with which it had no effect."""

    key: str
    value: str
    why: str


def upgraded(text: str, place: str) -> tuple[str, list[Dropped]]:
    """Return the text of a scenario file without the keys that have no effect, and these keys.

    Args:
        text: TOML.
        place: name of the file in errors.

    Raises:
        ScenarioError: the file is not TOML, or invalid for another reason; lists every problem.

    """
    raw = parse_toml(text, place)
    found = settle(raw, place, {})
    try:
        document = tomlkit.parse(text)
    except TOMLKitError as error:
        raise ScenarioError([f"{place}: not TOML that can be rewritten: {error}"]) from None
    removed = []
    for key, why in found.dropped.items():
        if any(other.startswith(f"{key}.") for other in found.dropped):
            continue  # the table is removed with its last key
        path = key.split(".")
        removed.append(Dropped(key, brief(with_tuples(value_at(raw, path))), why))
        _remove(document, path)
    return tomlkit.dumps(document), removed


def _remove(document: Any, path: Sequence[str]) -> None:
    """Remove a value, and the tables that are then empty."""
    for length in range(len(path), 0, -1):
        *outer, last = path[:length]
        table = document
        for part in outer:
            table = table[int(part)] if part.isdecimal() and not isinstance(table, Mapping) else table[part]
        if length < len(path) and (not isinstance(table, Mapping) or table[last]):
            return
        del table[last]
