"""Flights of a campaign: a base scenario, the points of its axes, and ``runs`` flights per point; each flight by its index."""

from __future__ import annotations

import hashlib
import json
import shlex
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from math import prod
from types import MappingProxyType
from typing import Any

import numpy as np

from flightbed.campaigns.settings import AxisSettings, CampaignSettings
from flightbed.config.overrides import replace_at, setting
from flightbed.config.own_code import Extension
from flightbed.core.sources import source_sha256
from flightbed.core.versions import versions
from flightbed.scenario.own_code import named_plug_ins
from flightbed.scenario.reading import Reading, settle
from flightbed.scenario.tables import Scenario

Values = Mapping[str, Any]  # key of the scenario -> value

MOST_REMEMBERED = 100  # most points that all keep histories, about 0.6 MB each
SHOWN = 12  # most points with histories in the report
_SEED_BITS = 53  # every reader of JSON represents such a seed exactly


@dataclass(frozen=True)
class Flight:
    """One flight of a programme.

    Attributes:
        index: number of the flight, from 0.
        point: number of its point, from 0.
        seed: seed of all random numbers of the flight.
        values: key of the scenario -> value in this flight, of all axes, drawn ones included.

    """

    index: int
    point: int
    seed: int
    values: Values


@dataclass(frozen=True)
class Programme:
    """All flights of a campaign; flight ``index`` depends only on the programme and its index.

    Attributes:
        scenario: the base scenario, complete.
        raw: the base scenario as in its file, with its aircraft's path and fingerprint; flights replace keys in it.
        runs: flights per point.
        points: values of the axes that are not drawn, in order; {} for a programme without such axes.
        settings: the campaign file; None for a plain scenario, whose flights have successive seeds from its own on.
        extensions: own code that the flights use.
        aircraft: fingerprints of all aircraft.
        notes: on the settings, one line each.

    """

    scenario: Scenario
    raw: Mapping[str, Any]
    runs: int
    points: Sequence[Values] = (MappingProxyType({}),)
    settings: CampaignSettings | None = None
    extensions: tuple[Extension, ...] = ()
    aircraft: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        """Return the number of flights."""
        return self.runs * len(self.points)

    @property
    def name(self) -> str:
        """Name of the campaign file or the scenario."""
        return self.scenario.name if self.settings is None else self.settings.name

    @property
    def description(self) -> str:
        """Description of the campaign file or the scenario."""
        return self.scenario.description if self.settings is None else self.settings.description

    @property
    def axes(self) -> tuple[AxisSettings, ...]:
        """Varied keys."""
        return () if self.settings is None else self.settings.axes

    def flight(self, index: int) -> Flight:
        """Return a flight by its number."""
        point = index // self.runs
        if self.settings is None:
            return Flight(index, point, self.scenario.seed + index, {})
        state = np.random.SeedSequence(self.settings.seed, spawn_key=(index,)).generate_state(1, np.uint64)
        drawn = {a.key: draw(a, self.settings.seed, index) for a in self.axes if a.is_drawn}
        values = {**self.points[point], **drawn}
        return Flight(index, point, int(state[0]) >> (64 - _SEED_BITS), {a.key: values[a.key] for a in self.axes})

    def at(self, point: int) -> Scenario:
        """Return the complete scenario of the first flight of a point."""
        return scenario_of(self.raw, self.flight(point * self.runs))

    def overrides(self, flight: Flight) -> str:
        """Return the options of ``flightbed run`` that turn the base scenario into this flight; values without effect are left out."""
        dropped = _reading(self.raw, flight).dropped
        texts = [setting(key, value) for key, value in flight.values.items() if key not in dropped]
        return "".join(f" --set {shlex.quote(text)}" for text in (*texts, f"seed={flight.seed}"))

    @property
    def seed(self) -> int:
        """Seed of the campaign file, or of the first flight of a plain scenario."""
        return self.scenario.seed if self.settings is None else self.settings.seed

    @cached_property
    def history_points(self) -> frozenset[int]:
        """Points that keep histories: the chosen ones, else all, or ``SHOWN`` of them if there are more than ``MOST_REMEMBERED``."""
        count = len(self.points)
        if self.settings is None or (self.settings.histories.keep == "auto" and count <= MOST_REMEMBERED):
            return frozenset(range(count))
        if self.settings.histories.keep == "auto":
            return frozenset(select_points(self.settings, range(count), SHOWN))
        return frozenset(self.settings.histories.points)

    @cached_property
    def fingerprint(self) -> str:
        """SHA-256 of all that determines the table: scenario, axes, criteria, runs, seed, aircraft, versions, sources, own code."""
        return _sha256(
            {
                "scenario": self.raw,
                "campaign": None if self.settings is None else self.settings.to_dict(),
                "runs": self.runs,
                "aircraft": self.aircraft,
                "versions": dict(versions()),
                **self.sources,
            }
        )

    @property
    def sources(self) -> Mapping[str, Any]:
        """Hashes of the sources that fly: of flightbed, of own code, of the kinds of installed packages."""
        return _sources(self.scenario, self.extensions)


def _sources(scenario: Scenario, extensions: Sequence[Extension]) -> Mapping[str, Any]:
    return {
        "source_sha256": source_sha256(),
        "extensions": {extension.name: extension.identity for extension in extensions},
        "plug_ins": named_plug_ins(scenario),
    }


def scenario_of(raw: Mapping[str, Any], flight: Flight) -> Scenario:
    """Return the scenario of a flight; values without effect at its point are left out. Raises ScenarioError."""
    return _reading(raw, flight).scenario


def _reading(raw: Mapping[str, Any], flight: Flight) -> Reading:
    values, place = {**flight.values, "seed": flight.seed}, f"flight {flight.index}"
    return settle(with_values(raw, values, place), place, {})


def with_values(raw: Mapping[str, Any], values: Values, place: str) -> Mapping[str, Any]:
    """Return nested values with some replaced. Raises ScenarioError, with the place, for a key without a parent."""
    for key, value in values.items():
        raw = replace_at(raw, key.split("."), value, f"{place}: {key}")
    return raw


def flight_hash(scenario: Scenario, extensions: Sequence[Extension]) -> str:
    """Return the SHA-256 of everything that determines a flight: complete scenario with aircraft and seed, versions, sources, own code.

    Name, description and the path of the aircraft are left out; the aircraft's fingerprint is part of the scenario.
    """
    decides = scenario.model_dump(
        mode="json", by_alias=True, exclude={"name": True, "description": True, "aircraft": {"model"}}
    )
    return _sha256({"scenario": decides, "versions": dict(versions()), **_sources(scenario, extensions)})


def _sha256(values: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(values, sort_keys=True, default=dict).encode()).hexdigest()


def grid(settings: CampaignSettings) -> list[Values]:
    """Return the points: all combinations of the axes' values, the last axis fastest, or, if paired, the n-th value of each axis."""
    axes = {axis.key: values_of(axis) for axis in settings.axes if not axis.is_drawn}
    if not axes:
        return [{}]
    combined = product(*axes.values()) if settings.combine == "crossed" else zip(*axes.values(), strict=True)
    return [dict(zip(axes, values, strict=True)) for values in combined]


def select_points(settings: CampaignSettings | None, points: Sequence[int], most: int) -> list[int]:
    """Return at most ``most`` of some points: of a complete crossed grid a coarser grid with its corners, else evenly spaced points."""
    axes = [] if settings is None else [len(values_of(axis)) for axis in settings.axes if not axis.is_drawn]
    crossed = settings is not None and settings.combine == "crossed"
    if len(points) <= most:
        return list(points)
    if not crossed or prod(axes) != len(points):
        return [points[i] for i in _evenly_spaced(len(points), most)]
    kept = list(axes)
    while prod(kept) > most:
        kept[kept.index(max(kept))] -= 1
    strides = [prod(axes[i + 1 :]) for i in range(len(axes))]
    ways = product(*(_evenly_spaced(length, count) for length, count in zip(axes, kept, strict=True)))
    return [points[sum(i * stride for i, stride in zip(way, strides, strict=True))] for way in ways]


def _evenly_spaced(length: int, count: int) -> list[int]:
    """Return ``count`` integers in [0, length), both ends included; for count 1 the middle."""
    if count == 1:
        return [length // 2]
    return [round(i * (length - 1) / (count - 1)) for i in range(count)]


def values_of(axis: AxisSettings) -> Sequence[Any]:
    """Return the values of an axis that is not drawn; a range of integers with integer steps has integer values."""
    if axis.values is not None:
        return axis.values
    assert axis.start is not None
    assert axis.to is not None
    assert axis.count is not None
    values = [round(v, 12) for v in np.linspace(axis.start, axis.to, axis.count).tolist()]
    whole = isinstance(axis.start, int) and isinstance(axis.to, int) and all(v.is_integer() for v in values)
    return [int(v) for v in values] if whole else values


def draw(axis: AxisSettings, seed: int, index: int) -> float:
    """Return the drawn value of an axis in a flight; it depends only on the campaign seed, the index and the key."""
    from scipy.special import ndtr, ndtri  # slow to import

    source = np.random.SeedSequence(seed, spawn_key=(index, zlib.crc32(axis.key.encode())))
    u = float(np.random.Generator(np.random.PCG64(source)).random())
    low = -np.inf if axis.low is None else float(axis.low)
    high = np.inf if axis.high is None else float(axis.high)
    if axis.distribution == "uniform":
        return low + (high - low) * u
    mean, std = float(axis.mean or 0.0), float(axis.std or 0.0)
    below, above = float(ndtr((low - mean) / std)), float(ndtr((high - mean) / std))
    return float(min(max(mean + std * ndtri(below + (above - below) * u), low), high))
