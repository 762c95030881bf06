"""A family of kinds as the type of a table: the table's ``kind`` selects the settings class that reads it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, get_args

from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler, ValidationError
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import CoreSchema, InitErrorDetails, PydanticCustomError, core_schema

from flightbed.config import families
from flightbed.config.table import Settings, description_of, has_key, known_keys, unregistered

_PYDANTIC = frozenset(get_args(core_schema.ErrorType))  # the other error types are our own


class Family:
    """Type of a table with kinds, as in ``Annotated[FailureSettings, FAILURES]``.

    A table is read by the class of its kind, and only that class is imported. An instance of the base class passes unchanged.
    Errors keep the place of the key, ``estimators.0.window``.

    Args:
        name: of the family in ``config/families.py``, such as "estimators".
        base: class of all kinds.
        plain: class that reads the table of own code that is not a settings class.
        default: kind of a table without one.
        key: key that holds the kind.
        without: keys of the kinds that have no meaning in this place.

    """

    def __init__(
        self,
        name: str,
        base: type[Settings],
        plain: type[Settings],
        *,
        default: str,
        key: str = "kind",
        without: Sequence[str] = (),
    ) -> None:
        self.name, self.base, self.plain = name, base, plain
        self.default, self.key, self.without = default, key, frozenset(without)

    def of(self, kind: str) -> type[Settings]:
        """Return the settings class of a kind. Raises UnknownNameError, and ExtensionError for own code that is not permitted."""
        own = families.in_use().get(kind)
        found = families.factory(self.name, kind) if own is None else own.factory
        return found if isinstance(found, type) and issubclass(found, self.base) else self.plain

    def make(self, **values: Any) -> Any:
        """Return the settings of a table. Raises pydantic.ValidationError."""
        return self._settings(values)

    def build(self, settings: Any, *arguments: Any) -> Any:
        """Return the object that settings build; that of own code is checked, and its errors name file and line."""
        own = families.in_use().get(getattr(settings, self.key))
        if own is None or isinstance(settings, self.plain):
            return settings.build(*arguments)
        return own.maker(self.name)(settings, *arguments)

    def have(self, path: Sequence[int | str]) -> list[str]:
        """Return the built-in kinds that have a key, given its path inside the table."""
        if path[0] in self.without:
            return []
        return [kind for kind in families.built_in(self.name) if has_key(self.of(kind), path)]

    def _settings(self, value: Any) -> Settings:
        if isinstance(value, self.base):
            return value
        if not isinstance(value, Mapping):
            raise PydanticCustomError("model_type", "must be a table")
        kind = value.get(self.key, self.default)
        problem = "string_type" if not isinstance(kind, str) else unregistered(self.name, kind)
        if problem:
            raise self._error([{"type": problem, "loc": (self.key,), "input": kind}])
        settings = self.of(kind)
        foreign = [self._foreign(settings, kind, (key,), value[key]) for key in value if key in self.without]
        try:
            made = settings.model_validate(
                {self.key: kind, **{k: v for k, v in value.items() if k not in self.without}}
            )
        except ValidationError as error:
            raise self._error([*foreign, *(self._rewritten(settings, kind, item) for item in error.errors())]) from None
        if foreign:
            raise self._error(foreign)
        return made

    def _error(self, items: list[InitErrorDetails]) -> ValidationError:
        return ValidationError.from_exception_data(self.base.__name__, items)

    def _rewritten(self, settings: type[Settings], kind: str, item: Any) -> InitErrorDetails:
        """Return an error of the kind's class; that of an unknown key says which other kinds have the key."""
        if item["type"] == "extra_forbidden":
            return self._foreign(settings, kind, item["loc"], item["input"])
        problem, context = item["type"], item.get("ctx", {})
        if problem not in _PYDANTIC:
            problem, context = PydanticCustomError(problem, "{text}", {**context, "text": item["msg"]}), {}
        return {"type": problem, "loc": item["loc"], "input": item["input"], "ctx": context}

    def _foreign(self, settings: type[Settings], kind: str, loc: Sequence[int | str], value: Any) -> InitErrorDetails:
        known = [key for key in known_keys(settings, loc[:-1]) if key not in self.without]
        have = [f"'{name}'" for name in self.have(loc)]
        if not have and loc[0] not in self.without and has_key(self.plain, loc):
            have = ["own code"]
        context = {"key": self.key, "kind": kind, "have": have, "known": known}
        return {"type": PydanticCustomError("foreign", "unknown key", context), "loc": tuple(loc), "input": value}

    def __get_pydantic_core_schema__(self, _source: Any, _handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_plain_validator_function(
            self._settings, serialization=core_schema.plain_serializer_function_ser_schema(self._written)
        )

    def _written(self, settings: Settings) -> dict[str, Any]:
        written = settings.model_dump(mode="json", by_alias=True, exclude_none=True)
        return {key: value for key, value in written.items() if key not in self.without}

    def __get_pydantic_json_schema__(self, _core: CoreSchema, _handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        """Return one schema per built-in kind, and an open one for installed kinds and own code."""
        names = families.built_in(self.name)
        kinds = [self._schema_of(kind) for kind in names]
        other = {
            _TITLE: "installed kind or own code",
            "description": "A kind of an installed package, or own code: module:Attribute or path/to/file.py:Attribute.",
            "type": "object",
            "properties": {self.key: {"type": "string", "description": "Its name.", "not": {"enum": list(names)}}},
            "required": [self.key],
        }
        return {"type": "object", "oneOf": [*kinds, other]}

    def _schema_of(self, kind: str) -> JsonSchemaValue:
        schema = json_schema(self.of(kind))
        schema[_TITLE] = kind
        schema["properties"] = {k: v for k, v in schema["properties"].items() if k not in self.without}
        schema["properties"][self.key] = {"const": kind, "description": description_of(self.base, self.key)}
        if kind != self.default:
            schema["required"] = [self.key, *schema.get("required", [])]
        return schema


_TITLE = "x-title"  # a title to keep; those that pydantic makes of names are removed


class _Generator(GenerateJsonSchema):
    ignored_warning_kinds = {"skipped-choice", "non-serializable-default"}  # noqa: RUF012  # empty options of own code


def json_schema(table: type[Settings]) -> JsonSchemaValue:
    """Return the JSON Schema of a table without references to definitions, without generated titles and without null."""
    schema = table.model_json_schema(schema_generator=_Generator)
    definitions = schema.get("$defs", {})

    def walk(node: Any) -> Any:
        if isinstance(node, list):
            return [walk(inner) for inner in node]
        if not isinstance(node, dict):
            return node
        if "$ref" in node:
            found = definitions[node["$ref"].rpartition("/")[2]]
            node = {**found, **{key: value for key, value in node.items() if key != "$ref"}}
        choices = node.get("anyOf", ())
        if {"type": "null"} in choices:  # None stands for an absent key, and TOML has no null
            only = _one_of([choice for choice in choices if choice != {"type": "null"}])
            node = {**only, **{key: value for key, value in node.items() if key not in ("anyOf", "default")}}
            return walk(node)
        if choices:
            node = {**_one_of(choices), **{key: value for key, value in node.items() if key != "anyOf"}}
        kept = {
            "title" if key == _TITLE else key: value
            for key, value in node.items()
            if key != "$defs" and not (key == "title" and isinstance(value, str))
        }
        return {key: walk(value) for key, value in kept.items()}

    return dict(walk(schema))


def _one_of(choices: Sequence[JsonSchemaValue]) -> JsonSchemaValue:
    """Return the schema of a value that has one of several types; a whole number is a number."""
    kinds = [choice for choice in choices if choice != {"type": "integer"} or {"type": "number"} not in choices]
    return kinds[0] if len(kinds) == 1 else {"anyOf": kinds}
