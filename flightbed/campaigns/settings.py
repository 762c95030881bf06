"""Tables and keys of a campaign file: frozen, each key with its type and range."""

from __future__ import annotations

from collections import Counter
from typing import Annotated, Any, Literal

import tomli_w

from flightbed.config.table import (
    CoreSchema,
    Field,
    FormatVersion,
    GetJsonSchemaHandler,
    Identifier,
    OptionValue,
    PydanticCustomError,
    Settings,
    between,
    model_validator,
)

Number = int | float
Count = Annotated[int, between(1, 10_000_000)]

_KINDS = {
    "values": ("values",),
    "from": ("from", "to", "count"),
    "uniform": ("distribution", "low", "high"),
    "normal": ("distribution", "mean", "std"),
}
_MAY = {"normal": {"low", "high"}}


def _problem(text: str) -> PydanticCustomError:
    return PydanticCustomError("consistency", "{text}", {"text": text})


def _with_chosen(schema: dict[str, Any], numbers: str) -> dict[str, Any]:
    """Return the schema of a table in which keep = "chosen" and a list of numbers need each other."""
    chosen = {"properties": {"keep": {"const": "chosen"}}, "required": ["keep"]}
    given = {"properties": {numbers: {"minItems": 1}}, "required": [numbers]}
    return {**schema, "if": chosen, "then": given, "else": {"properties": {numbers: {"maxItems": 0}}}}


class AxisSettings(Settings):
    """A scenario key and its values: a list, an evenly spaced range, or one random draw per flight."""

    key: str
    """Dotted key of the scenario, such as "failures.0.to"; its value is a number, text, true or false, or a list."""
    values: Annotated[tuple[OptionValue, ...], Field(min_length=1)] | None = None
    """List of values."""
    start: Number | None = Field(None, alias="from")
    """First of count values in equal steps; the values are whole numbers if both ends and the step are."""
    to: Number | None = None
    """Last of count values in equal steps, included."""
    count: Annotated[int, between(2, 100_000)] | None = None
    """Number of values from `from` to `to`."""
    distribution: Literal["uniform", "normal"] | None = None
    """Each flight draws its own value: uniform between low and high, or normal, truncated at low and high."""
    low: Number | None = None
    """Least drawn value; a normal distribution may omit it."""
    high: Number | None = None
    """Greatest drawn value; a normal distribution may omit it."""
    mean: Number | None = None
    """Mean of a normal distribution, before truncation."""
    std: Annotated[Number, between(0, 1_000_000, open_low=True)] | None = None
    """Standard deviation of a normal distribution, before truncation."""

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        """Return the JSON Schema: exactly one of the four ways to give values."""
        schema = super().__get_pydantic_json_schema__(core, handler)
        keys = [key for key in schema["properties"] if key != "key"]
        ways = []
        for kind, needs in _KINDS.items():
            foreign = [key for key in keys if key not in needs and key not in _MAY.get(kind, ())]
            properties: dict[str, Any] = dict.fromkeys(foreign, False)
            if "distribution" in needs:
                properties["distribution"] = {"const": kind}
            ways.append({"title": kind, "required": list(needs), "properties": properties})
        return {**schema, "oneOf": ways}

    @property
    def is_drawn(self) -> bool:
        """Whether every flight draws its own value."""
        return self.distribution is not None

    @model_validator(mode="after")
    def _one_kind(self) -> AxisSettings:
        given = {"from" if n == "start" else n for n in self.model_fields_set} - {"key"}
        kind: str | None = self.distribution or next((k for k in ("values", "from") if k in given), None)
        if kind is None:
            raise _problem("needs values, or from, to and count, or distribution")
        needs, may = _KINDS[kind], _MAY.get(kind, set())
        if missing := [key for key in needs if key not in given]:
            raise _problem(f"{'distribution ' if self.is_drawn else ''}'{kind}' needs {' and '.join(missing)} too")
        if extra := sorted(given - set(needs) - may):
            raise _problem(
                f"{', '.join(extra)}: cannot be combined with {'distribution ' if self.is_drawn else ''}'{kind}'"
            )
        if self.low is not None and self.high is not None and self.low >= self.high:
            raise _problem(f"low must be below high (got {self.low:g} and {self.high:g})")
        if self.distribution == "normal" and self.mean is not None:
            low, high = self.low, self.high
            if (low is not None and self.mean < low) or (high is not None and self.mean > high):
                raise _problem(f"mean must lie between low and high (got {self.mean:g})")
        return self


class Criterion(Settings):
    """A condition that a flight must meet to pass: a metric (table column) equals a value, or lies between min and max."""

    metric: str
    """Column of the campaign's table; a metric without a value does not pass."""
    equals: str | bool | int | float | None = None
    """Required value."""
    min: Number | None = None
    """Least value that passes."""
    max: Number | None = None
    """Greatest value that passes."""

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        """Return the JSON Schema: equals, or at least one limit."""
        schema = super().__get_pydantic_json_schema__(core, handler)
        limits = {"properties": {"equals": False}, "anyOf": [{"required": ["min"]}, {"required": ["max"]}]}
        return {**schema, "oneOf": [{"required": ["equals"], "properties": {"min": False, "max": False}}, limits]}

    @model_validator(mode="after")
    def _has_condition(self) -> Criterion:
        if self.equals is None and self.min is None and self.max is None:
            raise _problem("needs equals, min or max")
        if self.equals is not None and (self.min is not None or self.max is not None):
            raise _problem("equals cannot be combined with min or max")
        if self.min is not None and self.max is not None and self.min > self.max:
            raise _problem(f"min must be at most max (got {self.min:g} and {self.max:g})")
        return self


class Traces(Settings):
    """Selection of the traces to keep: none, the worst flight of the campaign, or the flights with these indices."""

    keep: Literal["none", "worst", "chosen"] = "none"
    """none; worst: the trace of the worst flight, in traces/flight-INDEX.parquet; chosen: the traces of indices."""
    indices: tuple[Annotated[int, between(0, 10_000_000)], ...] = ()
    """Flights whose traces are kept, from 0; with keep = "chosen" only, which needs them."""

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        """Return the JSON Schema: indices with keep = "chosen", and only then."""
        return _with_chosen(super().__get_pydantic_json_schema__(core, handler), "indices")

    @model_validator(mode="after")
    def _chosen(self) -> Traces:
        if (self.keep == "chosen") != bool(self.indices):
            raise _problem("indices and keep = 'chosen' need each other; give both or neither")
        return self


class Histories(Settings):
    """Selection of the points whose histories are kept: automatic (all, or twelve that span the grid), none, or chosen numbers."""

    keep: Literal["auto", "none", "chosen"] = "auto"
    """auto: all points, or, with more than 100 of them, twelve that span the grid; none; chosen: those of points."""
    points: Annotated[tuple[Annotated[int, between(0, 100_000)], ...], Field(max_length=100)] = ()
    """Points whose histories are kept, from 0; with keep = "chosen" only, which needs them."""

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        """Return the JSON Schema: points with keep = "chosen", and only then."""
        return _with_chosen(super().__get_pydantic_json_schema__(core, handler), "points")

    @model_validator(mode="after")
    def _chosen(self) -> Histories:
        if (self.keep == "chosen") != bool(self.points):
            raise _problem("points and keep = 'chosen' need each other; give both or neither")
        return self


class CampaignSettings(Settings):
    """A campaign: base scenario, varied keys, flights per point, pass criteria."""

    schema_version: FormatVersion = Field(alias="schema")
    """Version of the file's format."""
    name: Identifier
    """Name of the campaign, and of its default folder: letters, digits, - and _."""
    description: str = ""
    """One sentence about the campaign."""
    base: str
    """Scenario whose keys the axes vary: a shipped name, or a path relative to this file."""
    runs: Count
    """Flights at each point."""
    seed: Annotated[int, between(0, 2**63 - 1)] = 0
    """Seed of the campaign; the seed of a flight follows from it and from the index of the flight."""
    combine: Literal["crossed", "paired"] = "crossed"
    """crossed: all combinations of the axes' values; paired: the n-th values of all axes together. Drawn axes do not count."""
    axes: tuple[AxisSettings, ...] = ()
    """Varied keys."""
    criteria: tuple[Criterion, ...] = ()
    """Conditions of a pass; a flight passes if it meets all."""
    traces: Traces = Traces()
    """Traces to keep."""
    histories: Histories = Histories()
    """Points whose histories are kept: percentiles over their flights."""

    @model_validator(mode="after")
    def _consistent(self) -> CampaignSettings:
        keys = [axis.key for axis in self.axes]
        problems = [f"axes: {key} is varied twice" for key, times in Counter(keys).items() if times > 1]
        problems += [
            f"axes: {inner} lies within {outer}, which is varied too"
            for inner in keys
            for outer in keys
            if inner.startswith(f"{outer}.")
        ]
        lengths = {a.key: len(a.values) if a.values is not None else a.count or 0 for a in self.axes if not a.is_drawn}
        if self.combine == "paired" and len(set(lengths.values())) > 1:
            counts = ", ".join(f"{key} {count}" for key, count in lengths.items())
            problems.append(f"axes: combine = 'paired' needs the same number of values for every key (got {counts})")
        if problems:
            raise _problem("\n".join(problems))
        return self

    def to_toml(self) -> str:
        """Return the campaign as TOML text, without the keys that are None."""
        return tomli_w.dumps(self.to_dict())

    def to_dict(self) -> dict[str, Any]:
        """Return nested plain values, ready for JSON."""
        return self.model_dump(mode="json", by_alias=True, exclude_none=True)
