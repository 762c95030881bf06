"""Tables and keys of a campaign file: frozen, each key with its type and range."""

from __future__ import annotations

from collections import Counter
from typing import Annotated, Any, Literal

import tomli_w

from flightbed.config.table import (
    Field,
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


def _problem(text: str) -> PydanticCustomError:
    return PydanticCustomError("consistency", "{text}", {"text": text})


class AxisSettings(Settings):
    """A scenario key and its values: a list, an evenly spaced range, or one random draw per flight."""

    key: str
    values: Annotated[tuple[OptionValue, ...], Field(min_length=1)] | None = None
    start: Number | None = Field(None, alias="from")
    to: Number | None = None
    count: Annotated[int, between(2, 100_000)] | None = None
    distribution: Literal["uniform", "normal"] | None = None
    low: Number | None = None
    high: Number | None = None
    mean: Number | None = None
    std: Annotated[Number, between(0, 1_000_000, open_low=True)] | None = None

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
        needs, may = _KINDS[kind], {"low", "high"} if kind == "normal" else set()
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
    equals: str | bool | int | float | None = None
    min: Number | None = None
    max: Number | None = None

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
    indices: tuple[Annotated[int, between(0, 10_000_000)], ...] = ()

    @model_validator(mode="after")
    def _chosen(self) -> Traces:
        if (self.keep == "chosen") != bool(self.indices):
            raise _problem("indices and keep = 'chosen' need each other; give both or neither")
        return self


class Histories(Settings):
    """Selection of the points whose histories are kept: automatic (all, or twelve that span the grid), none, or chosen numbers."""

    keep: Literal["auto", "none", "chosen"] = "auto"
    points: Annotated[tuple[Annotated[int, between(0, 100_000)], ...], Field(max_length=100)] = ()

    @model_validator(mode="after")
    def _chosen(self) -> Histories:
        if (self.keep == "chosen") != bool(self.points):
            raise _problem("points and keep = 'chosen' need each other; give both or neither")
        return self


class CampaignSettings(Settings):
    """A campaign: base scenario, varied keys, flights per point, pass criteria."""

    schema_version: Literal[1] = Field(alias="schema")
    name: Identifier
    description: str = ""
    base: str
    runs: Count
    seed: Annotated[int, between(0, 2**63 - 1)] = 0
    combine: Literal["crossed", "paired"] = "crossed"
    axes: tuple[AxisSettings, ...] = ()
    criteria: tuple[Criterion, ...] = ()
    traces: Traces = Traces()
    histories: Histories = Histories()

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
