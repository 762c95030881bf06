"""All keys of a file, from its settings classes: kind, unit, range, default and description of each."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, get_args

from flightbed.config import families
from flightbed.config.family import Family
from flightbed.config.table import (
    BaseModel,
    PydanticUndefined,
    Range,
    Settings,
    condition_of,
    description_of,
    inner_table,
)
from flightbed.core.units import unit_of


@dataclass(frozen=True)
class Key:
    """A key of a file.

    Attributes:
        path: dotted key; a list of tables has no index, as in "estimators.window".
        kinds: kinds that have it, with these properties; empty for a table without kinds.
        unit: its unit; empty for a number without one and for text.
        values: its range or its permitted values, as text.
        default: its default as TOML; empty if the key is required or absent by default.
        required: whether its table must have it.
        condition: other keys of its table with which it has an effect; empty if it always has one.
        example: a value as TOML for a file to start from; the default if the key has no example.
        description: a sentence.

    """

    path: str
    kinds: tuple[str, ...]
    unit: str
    values: str
    default: str
    required: bool
    condition: str
    example: str
    description: str


def catalogue(model: type[Settings]) -> tuple[Key, ...]:
    """Return all keys of a file, in the order of its classes; a key that several kinds share appears once if they agree on it."""
    merged: dict[Key, list[str]] = {}
    for key in _keys(model, "", ()):
        merged.setdefault(replace(key, kinds=()), []).extend(key.kinds)
    return tuple(replace(key, kinds=tuple(dict.fromkeys(kinds))) for key, kinds in merged.items())


def _keys(
    model: type[BaseModel], place: str, kinds: tuple[str, ...], without: frozenset[str] = frozenset()
) -> Iterator[Key]:
    for name, field in model.model_fields.items():
        if name in without:
            continue
        path = f"{place}{field.alias or name}"
        if family := _family(field):
            names = families.built_in(family.name)
            yield _selector(family, path, names)
            for kind in names:
                yield from _keys(family.of(kind), f"{path}.", (kind,), family.without | {family.key})
        elif (table := inner_table(field)) is not None:
            only = f"a table {name}" if field.default is None else ""
            yield from (replace(key, condition=key.condition or only) for key in _keys(table, f"{path}.", kinds))
        elif name != "options":
            yield _key(model, name, path, kinds)


def _family(field: Any) -> Family | None:
    """Return the family whose kinds a field holds, as a table or a list of tables."""
    inside = [item for argument in get_args(field.annotation) for item in getattr(argument, "__metadata__", ())]
    return next((item for item in (*field.metadata, *inside) if isinstance(item, Family)), None)


def _selector(family: Family, place: str, names: Sequence[str]) -> Key:
    """Return the key that names the kind."""
    text = f"{description_of(family.base, family.key)} Installed kinds and own code have other names."
    default = json.dumps(family.default)
    return Key(f"{place}.{family.key}", (), "", ", ".join(names), default, False, "", default, text)


def _key(model: type[BaseModel], name: str, path: str, kinds: tuple[str, ...]) -> Key:
    field = model.model_fields[name]
    unit = unit_of(name)
    default = "" if field.default in (None, PydanticUndefined) else json.dumps(_plain(field.default))
    return Key(
        path,
        kinds,
        "" if unit == "1" else unit,
        _values(field),
        default,
        field.is_required(),
        condition_of(field),
        json.dumps(field.examples[0]) if field.examples else default,
        description_of(model, name) or "",
    )


def _plain(value: Any) -> Any:
    return list(map(_plain, value)) if isinstance(value, tuple) else value


def _values(field: Any) -> str:
    """Return the permitted values of a field as text."""
    for item in field.metadata:
        if isinstance(item, Range):
            return str(item)
    kinds = {bool: "true or false", int: "a whole number", float: "a number", str: "text"}
    if field.annotation in kinds:
        return kinds[field.annotation]
    arguments = [a for a in get_args(field.annotation) if a is not type(None)]
    if arguments and all(isinstance(a, str | int) for a in arguments):
        return ", ".join(map(str, arguments))
    return "a list"
