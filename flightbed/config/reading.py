"""TOML files and validation errors as lines with place, value and cure."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

from flightbed.config.messages import brief, message
from flightbed.config.table import ValidationError, known_keys
from flightbed.core import data
from flightbed.core.errors import ScenarioError, did_you_mean


def read_toml(path: Path) -> dict[str, Any]:
    """Return the contents of a TOML file. Raises ScenarioError."""
    place = display_path(path)
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ScenarioError([f"{place}: cannot be read: {error}"]) from None
    return parse_toml(text, place)


def parse_toml(text: str, place: str) -> dict[str, Any]:
    """Return the contents of a TOML text; ``place`` names it in errors. Raises ScenarioError."""
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ScenarioError([f"{place}: not TOML: {error}"]) from None
    except RecursionError:
        raise ScenarioError([f"{place}: not TOML that can be read: its values are nested too deeply"]) from None


def with_tuples(value: Any) -> Any:
    """Return nested lists as tuples: strict validation rejects a list where a tuple is declared."""
    if isinstance(value, Mapping):
        return {key: with_tuples(inner) for key, inner in value.items()}
    return tuple(map(with_tuples, value)) if isinstance(value, list | tuple) else value


def display_path(path: Path) -> str:
    """Return the name of a scenario or campaign file in errors: its path in the source tree if it is shipped."""
    for kind, folder in (("scenario", "scenarios"), ("campaign", "scenarios/campaigns")):
        if path.parent == data.shipped(kind):
            return f"{folder}/{path.name}"
    return str(path)


def value_at(raw: Any, path: Sequence[str]) -> Any:
    """Return the value at a path of nested tables and lists; None where there is none."""
    for part in path:
        if isinstance(raw, Mapping):
            raw = raw.get(part)
        elif isinstance(raw, list | tuple) and part.isdecimal() and int(part) < len(raw):
            raw = raw[int(part)]
        else:
            return None
    return raw


def without(raw: Any, path: Sequence[str]) -> Any:
    """Return nested tables and lists without the value at a path, which must exist."""
    key, *rest = path
    if isinstance(raw, Mapping):
        if rest:
            return {**raw, key: without(raw[key], rest)}
        return {k: v for k, v in raw.items() if k != key}
    index = int(key)
    return [*raw[:index], *([without(raw[index], rest)] if rest else []), *raw[index + 1 :]]


def given_keys(raw: Mapping[str, Any], place: str = "") -> Iterator[str]:
    """Yield the dotted keys of all values in nested tables; ``place`` ends in a dot. Tables of options are single values."""
    for key, value in raw.items():
        name = f"{place}{key}"
        if isinstance(value, Mapping) and key != "options":
            yield from given_keys(value, f"{name}.")
        elif isinstance(value, list | tuple) and value and all(isinstance(inner, Mapping) for inner in value):
            for i, inner in enumerate(value):
                yield from given_keys(inner, f"{name}.{i}.")
        else:
            yield name


def validation_lines(
    error: ValidationError, place: str, origins: Mapping[str, str] = MappingProxyType({}), *, model: type
) -> list[str]:
    """Return the problems of a validation, one line each, with place, value and cure."""

    def origin_of(key: str) -> str:
        """Return the origin of a key or of a key inside it, with its separator."""
        origin = next((o for k, o in origins.items() if k == key or k.startswith(f"{key}.")), None)
        return f"{place}: " if origin is None else f"{origin} " if origin == "--set" else f"{origin}: "

    found = []
    for item in error.errors(include_url=False):
        key = key_of(item)
        if item["type"] == "consistency":
            found += [f"{place}: {key}{': ' if key else ''}{line}" for line in item["msg"].splitlines()]
        elif item["type"] == "foreign":
            found.append(f"{origin_of(key).rstrip(': ')}: {foreign(key, item['ctx'])}")
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


def key_of(item: Any) -> str:
    """Return the dotted key of an error of a validation."""
    return ".".join(map(str, item["loc"]))


def foreign(key: str, context: Mapping[str, Any]) -> str:
    """Return the message of a key that the kind of its table does not have; ``context`` as in ``family.Family``."""
    if have := context["have"]:
        kinds = ", ".join(have)
        return (
            f"{key}: '{context['kind']}' has no such key ({kinds} {'has' if len(have) == 1 else 'have'} it); remove it"
        )
    known = context["known"]
    near = did_you_mean(key.rpartition(".")[2], known) or f"; '{context['kind']}' has: {', '.join(known)}"
    return f"unknown key {key}{near}"
