"""Base classes and value types of the scenario and campaign tables: frozen, strict, each value with its range."""

from __future__ import annotations

import ast
import inspect
import json
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import Annotated, Any, Literal, get_args

from pydantic import (
    AfterValidator,
    BeforeValidator,
    ConfigDict,
    GetCoreSchemaHandler,
    GetPydanticSchema,
    SerializerFunctionWrapHandler,
    model_serializer,
)  # fmt: skip
from pydantic import BaseModel as BaseModel
from pydantic import Field as Field
from pydantic import GetJsonSchemaHandler as GetJsonSchemaHandler
from pydantic import ValidationError as ValidationError
from pydantic import model_validator as model_validator
from pydantic.fields import FieldInfo
from pydantic.functional_validators import ModelWrapValidatorHandler as ModelWrapValidatorHandler
from pydantic_core import CoreSchema as CoreSchema
from pydantic_core import PydanticCustomError as PydanticCustomError
from pydantic_core import PydanticUndefined as PydanticUndefined
from pydantic_core import core_schema

from flightbed.config import families
from flightbed.config.options import Options, is_option
from flightbed.core.errors import did_you_mean


@dataclass(frozen=True)
class Range:
    """Range of a number: low <= value <= high, or low < value <= high with ``open_low``."""

    low: float
    high: float
    open_low: bool = False

    def __str__(self) -> str:
        return f"above {self.low} and at most {self.high}" if self.open_low else f"between {self.low} and {self.high}"

    def check(self, value: float) -> float:
        """Return the value. Raises PydanticCustomError for a value outside."""
        if not (self.low < value if self.open_low else self.low <= value) or value > self.high:
            raise PydanticCustomError("range", "must be {text}", {"text": str(self)})
        return value

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_after_validator_function(self.check, handler(source))

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        lowest = "exclusiveMinimum" if self.open_low else "minimum"
        return {**handler(schema), lowest: self.low, "maximum": self.high}


def example(value: Any) -> FieldInfo:
    """Return field metadata: a value for a file to start from, of a key without a default."""
    found: FieldInfo = Field(examples=[value])
    return found


def between(low: float, high: float, *, open_low: bool = False) -> Range:
    """Return the range low <= value <= high, or low < value <= high with ``open_low``."""
    return Range(low, high, open_low)


@dataclass(frozen=True)
class Above:
    """Condition of ``only_with``: another key has a value above ``limit``."""

    limit: float


@dataclass(frozen=True)
class OnlyWith:
    """Conditions under which a key has an effect: another key of the same table -> its value, or a tuple of values, or Above."""

    conditions: Mapping[str, Any]

    def broken(self, table: BaseModel) -> str | None:
        """Return the first key whose value leaves the field without effect; None if the field has an effect."""
        return next((key for key, wanted in self.conditions.items() if not _holds(getattr(table, key), wanted)), None)


def only_with(**conditions: Any) -> OnlyWith:
    """Return field metadata: the key has an effect only if these other keys of its table have these values."""
    return OnlyWith(conditions)


def _holds(value: Any, wanted: Any) -> bool:
    if isinstance(wanted, Above):
        return bool(value > wanted.limit)
    return value in wanted if isinstance(wanted, tuple) else bool(value == wanted)


@cache
def _docstrings(table: type[BaseModel]) -> Mapping[str, str]:
    """Return field -> the text under it in the class. It is read from the source when it is asked for: a flight needs none."""
    try:
        source = textwrap.dedent(inspect.getsource(table))
    except (OSError, TypeError):  # a class that no file holds
        return {}
    statement = ast.parse(source).body[0]
    found = {}
    for pair in pairwise(statement.body if isinstance(statement, ast.ClassDef) else []):
        match pair:
            case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(value=ast.Constant(value=str(text))):
                found[name] = text
    return found


def description_of(table: type[BaseModel], name: str) -> str | None:
    """Return the description of a field in one line: its own, or that of the class from which it is derived."""
    for base in table.__mro__:
        field = base.model_fields.get(name) if issubclass(base, BaseModel) else None
        if field is not None and (text := field.description or _docstrings(base).get(name)):
            return " ".join(text.split()).replace("``", "`")
    return None


def condition_of(field: FieldInfo) -> str:
    """Return the conditions under which a key has an effect, as in 'memory = "window"'; empty if it always has one."""
    conditions = (item.conditions for item in field.metadata if isinstance(item, OnlyWith))
    return " and ".join(_in_words(key, wanted) for each in conditions for key, wanted in each.items())


def _in_words(key: str, wanted: Any) -> str:
    if isinstance(wanted, Above):
        return f"{key} above {wanted.limit:g}"
    if wanted is None:
        return f"{key} absent"
    values = wanted if isinstance(wanted, tuple) else (wanted,)
    return f"{key} = {' or '.join(json.dumps(value) for value in values)}"


def _rules(table: type[BaseModel], name: str, field: FieldInfo) -> Iterator[dict[str, Any]]:
    """Yield the conditions of a key as JSON Schema: where one does not hold, the key must be absent."""
    for item in field.metadata:
        if isinstance(item, OnlyWith):
            for other, wanted in item.conditions.items():
                default = table.model_fields[other].default
                if wanted is None:
                    yield {"if": {"required": [other]}, "then": {"properties": {name: False}}}
                    continue
                values = list(wanted) if isinstance(wanted, tuple) else [wanted]
                right = {"exclusiveMinimum": wanted.limit} if isinstance(wanted, Above) else {"enum": values}
                given = [] if _holds(default, wanted) else [other]  # absent, the other key has its default
                yield {
                    "if": {"properties": {other: right}, "required": given},
                    "else": {"properties": {name: False}},
                }


def idle_keys(table: BaseModel, place: str = "") -> dict[str, str]:
    """Return key without effect -> the setting that disables it, for a table and the tables inside it; ``place`` ends in a dot."""
    found: dict[str, str] = {}
    for name, field in type(table).model_fields.items():
        key, value = f"{place}{field.alias or name}", getattr(table, name)
        conditions = [item for item in field.metadata if isinstance(item, OnlyWith)]
        disabled_by = next((other for item in conditions if (other := item.broken(table))), None)
        inside = list(_tables_of(key, value))
        if disabled_by is None:
            for where, inner in inside:
                found |= idle_keys(inner, f"{where}.")
        else:
            why = f"{place}{disabled_by}{_equals(getattr(table, disabled_by))}"
            found |= dict.fromkeys([key, *(k for where, inner in inside for k in keys_of(inner, f"{where}."))], why)
    return found


def keys_of(table: BaseModel, place: str = "") -> Iterator[str]:
    """Yield the keys of a table and of the tables inside it; ``place`` ends in a dot."""
    for name, field in type(table).model_fields.items():
        key = f"{place}{field.alias or name}"
        yield key
        for where, inner in _tables_of(key, getattr(table, name)):
            yield from keys_of(inner, f"{where}.")


def _tables_of(key: str, value: Any) -> Iterator[tuple[str, BaseModel]]:
    if isinstance(value, BaseModel):
        yield key, value
    elif isinstance(value, tuple):
        yield from ((f"{key}.{i}", inner) for i, inner in enumerate(value) if isinstance(inner, BaseModel))


def _equals(value: Any) -> str:
    """Return " = value" as TOML has it; nothing for a table."""
    if isinstance(value, BaseModel):
        return ""
    return f" = {value!r}" if isinstance(value, str) else f" = {json.dumps(value)}"


def unregistered(family: str, name: str) -> PydanticCustomError | None:
    """Return the error of a name that is not registered in a family, such as "estimators"; None for a registered name."""
    known = families.names(family)
    if name in known:
        return None
    if problem := families.permission_problem(name):
        return PydanticCustomError("outside", "{problem}", {"problem": problem})
    return PydanticCustomError(
        "registered",
        "unknown {kind}{near}; known: {known}",
        {"kind": family.removesuffix("s"), "near": did_you_mean(name, known), "known": ", ".join(known)},
    )


def registered(family: str) -> AfterValidator:
    """Return a validator that accepts the registered names of a family, such as "estimators"."""

    def check(value: str) -> str:
        if problem := unregistered(family, value):
            raise problem
        return value

    return AfterValidator(check)


def _number(value: Any) -> Any:
    if isinstance(value, bool):  # equal to 1 in Python
        raise PydanticCustomError("version", "must be 1")
    return value


def _option(value: Any) -> Any:
    if not is_option(value):
        text = "must be text, a finite number, true or false, or a list of these"
        raise PydanticCustomError("option", "{text}", {"text": text})
    return value


def _options(_kind: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
    table = handler.generate_schema(dict[str, OptionValue])
    plain = core_schema.no_info_before_validator_function(lambda v: dict(v) if isinstance(v, Options) else v, table)
    written = core_schema.plain_serializer_function_ser_schema(dict)
    return core_schema.no_info_after_validator_function(Options, plain, serialization=written)


Positive = Annotated[float, between(0, 1000000, open_low=True)]
NonNegative = Annotated[float, between(0, 1000000)]
Share = Annotated[float, between(0, 1)]
OptionValue = Annotated[Any, AfterValidator(_option)]
OwnOptions = Annotated[Options, GetPydanticSchema(_options)]
FormatVersion = Annotated[Literal[1], BeforeValidator(_number)]
Identifier = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]*$")]


class Settings(BaseModel):
    """Base class of a table: frozen, strict, without unknown keys and without infinite numbers.

    The text under a key is its description.
    """

    model_config = ConfigDict(
        frozen=True,
        extra="forbid",
        strict=True,
        allow_inf_nan=False,
        populate_by_name=True,
    )

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        """Return the JSON Schema of the table, with ``only_with`` as if-else."""
        schema = handler.resolve_ref_schema(handler(core))
        for name, field in cls.model_fields.items():
            if text := description_of(cls, name):
                schema["properties"][field.alias or name]["description"] = text
        if rules := [rule for name, field in cls.model_fields.items() for rule in _rules(cls, name, field)]:
            schema["allOf"] = rules
        return schema


class OwnSettings(Settings):
    """Base class of a table that names code; external code reads its own keys from ``options``."""

    options: OwnOptions = Options()
    """Keys of the external code."""

    @model_serializer(mode="wrap")
    def _without_empty_options(self, write: SerializerFunctionWrapHandler) -> dict[str, Any]:
        written: dict[str, Any] = write(self)
        return {key: value for key, value in written.items() if key != "options" or value}


def known_keys(model: Any, loc: Sequence[int | str]) -> list[str]:
    """Return the keys of the table at location ``loc`` of a table; ``model`` is the class of the outer table."""
    for part in loc:
        if isinstance(part, str):
            field = next(f for n, f in model.model_fields.items() if part in (n, f.alias))
            model = inner_table(field)
    return [f.alias or n for n, f in model.model_fields.items()]


def has_key(model: type[BaseModel], path: Sequence[int | str]) -> bool:
    """Return whether a table has a key, given as the path inside it."""
    inside: type[BaseModel] | None = model
    for part in path:
        if isinstance(part, int):
            continue
        fields = {} if inside is None else inside.model_fields
        field = next((f for n, f in fields.items() if part in (n, f.alias)), None)
        if field is None:
            return False
        inside = inner_table(field)
    return True


def inner_table(field: Any) -> type[BaseModel] | None:
    """Return the class of the table, or of the tables, that a field holds."""
    classes = [field.annotation, *get_args(field.annotation)]
    return next((c for c in classes if isinstance(c, type) and issubclass(c, BaseModel)), None)
