"""Base classes and value types of the scenario and campaign tables: frozen, strict, each value with its range."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, get_args

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    GetCoreSchemaHandler,
    GetPydanticSchema,
    SerializerFunctionWrapHandler,
    model_serializer,
)  # fmt: skip
from pydantic import Field as Field
from pydantic import ValidationError as ValidationError
from pydantic import model_validator as model_validator
from pydantic_core import CoreSchema, core_schema
from pydantic_core import PydanticCustomError as PydanticCustomError

from flightbed.config import families
from flightbed.config.options import Options, is_option
from flightbed.core.errors import did_you_mean


def between(low: float, high: float, *, open_low: bool = False) -> AfterValidator:
    """Return a validator that accepts low <= value <= high, or low < value <= high with ``open_low``."""
    text = f"must be above {low} and at most {high}" if open_low else f"must be between {low} and {high}"

    def check(value: float) -> float:
        if not (low < value if open_low else low <= value) or value > high:
            raise PydanticCustomError("range", "{text}", {"text": text})
        return value

    return AfterValidator(check)


def registered(family: str) -> AfterValidator:
    """Return a validator that accepts the registered names of a family, such as "estimators"."""

    def check(value: str) -> str:
        known = families.names(family)
        if value not in known:
            if problem := families.permission_problem(value):
                raise PydanticCustomError("outside", "{problem}", {"problem": problem})
            kind, near = family.removesuffix("s"), did_you_mean(value, known)
            raise PydanticCustomError(
                "registered",
                "unknown {kind}{near}; known: {known}",
                {"kind": kind, "near": near, "known": ", ".join(known)},
            )
        return value

    return AfterValidator(check)


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
Identifier = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]*$")]


class Settings(BaseModel):
    """Base class of a table: frozen, strict, without unknown keys and without infinite numbers."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False, populate_by_name=True)


class OwnSettings(Settings):
    """Base class of a table that names code; external code reads its own keys from ``options``."""

    options: OwnOptions = Options()

    @model_serializer(mode="wrap")
    def _without_empty_options(self, write: SerializerFunctionWrapHandler) -> dict[str, Any]:
        written: dict[str, Any] = write(self)
        return {key: value for key, value in written.items() if key != "options" or value}


def known_keys(model: Any, loc: Sequence[int | str]) -> list[str]:
    """Return the keys of the table at location ``loc`` of a scenario or campaign; ``model`` is the class of the whole file."""
    for part in loc:
        if isinstance(part, int):
            continue
        field = next(f for n, f in model.model_fields.items() if part in (n, f.alias))
        inner = [
            a
            for a in (field.annotation, *get_args(field.annotation))
            if isinstance(a, type) and issubclass(a, BaseModel)
        ]
        model = inner[0]
    return [f.alias or n for n, f in model.model_fields.items()]
