"""What a worker of a campaign does: flies a few flights of a programme; each leaves a row, and adds to the histories."""

from __future__ import annotations

import traceback
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from flightbed.blame import line_of
from flightbed.campaign_table import Row, failed_row, row
from flightbed.consistency import estimates
from flightbed.engine import DEATHS
from flightbed.errors import FlightbedError
from flightbed.extension import Extension, Packed, carried, named_by
from flightbed.flight_result import fly_plan
from flightbed.percentiles import SAMPLE, Part, add_all
from flightbed.plan import Plan, plan
from flightbed.programme import Flight, Programme, flight_hash, scenario_of, versions
from flightbed.settings import Scenario
from flightbed.trace import true_share

CHUNK = 10  # flights of a job: so many are done before progress and disk are told of them, and two workers share twenty
HISTORIES = (
    "q_deg_s",
    "q_ref_deg_s",
    "alpha_deg",
    "elevator_deg",
)  # and of every estimate the smoothed K, and of its surface the true one
KILLS = f"the process that flew it died, at least {DEATHS} times; it runs out of memory, or compiled code that it uses crashes"


@dataclass(frozen=True)
class Chunk:
    """Flights that are flown by one worker, one after the other.

    Attributes:
        number: of the chunk.
        raw: base scenario, nested plain values.
        flights: in order of their indices.
        columns: of the trace, whose histories are added up.
        remembered: indices of the flights whose histories are.
        sampled: indices of those whose histories are held for percentiles, too.
        estimators: names of the estimates.
        extensions: code of the user's own that flies.

    """

    number: int
    raw: Mapping[str, Any]
    flights: tuple[Flight, ...]
    columns: tuple[str, ...]
    remembered: frozenset[int]
    sampled: frozenset[int]
    estimators: tuple[str, ...]
    extensions: tuple[Extension | Packed, ...] = ()


@dataclass(frozen=True)
class Flown:
    """What comes back: a row a flight, in order; point -> histories of those that flew; what they were flown with."""

    rows: list[Row]
    parts: Mapping[int, Part]
    versions: dict[str, str]


def chunk_of(programme: Programme, number: int) -> Chunk:
    """Return chunk ``number`` of a programme: it depends on the programme alone, not on what has been flown."""
    indices = range(number * CHUNK, min((number + 1) * CHUNK, len(programme)))
    names = estimates(programme.scenario)
    truths = dict.fromkeys(map(true_share, ("", *names)))
    columns = (*HISTORIES, *truths, *(f"{name}.effectiveness_smoothed" for name in names))
    remembered = frozenset(i for i in indices if i // programme.runs in programme.remembered)
    sampled = frozenset(i for i in remembered if i % programme.runs < SAMPLE)
    flights = tuple(map(programme.flight, indices))
    return Chunk(
        number, dict(programme.raw), flights, columns, remembered, sampled, names, programme.extensions
    )  # fmt: skip


def single_flights(chunk: Chunk) -> list[Chunk]:
    """Return a chunk as chunks of one flight each."""
    return [replace(chunk, flights=(flight,)) for flight in chunk.flights]


def joined(flown: Sequence[Flown]) -> Flown:
    """Return what came of the flights of a chunk, each flown as a chunk of its own; the same as of them together."""
    parts: dict[int, Part] = {}
    for one in flown:
        add_all(parts, one.parts)
    return Flown([row for one in flown for row in one.rows], parts, flown[0].versions)


def killed(chunk: Chunk) -> Flown:
    """Return what there is of a chunk of one flight that kills its process: a row with this error."""
    (flight,) = chunk.flights
    with carried(chunk.extensions):
        scenario = scenario_of(chunk.raw, flight)
        # Planning it might kill us. What a plan adds is the aircraft; where that is bound already, nothing that decides.
        known = flight_hash(scenario, named_by(scenario)) if scenario.aircraft.sha256 else None
    return Flown([failed_row(flight, known, KILLS, chunk.estimators)], {}, dict(versions()))


def fly_chunk(chunk: Chunk) -> Flown:
    """Fly a chunk. What a flight raises is in its row, and the next is flown."""
    rows: list[Row] = []
    parts: dict[int, Part] = {}
    planned: Plan | None = None
    with carried(chunk.extensions):
        for flight in chunk.flights:
            known: str | None = None
            try:
                scenario = scenario_of(chunk.raw, flight)
                planned = _planned(scenario, planned)
                known = flight_hash(planned.scenario, named_by(scenario))
                trace, metrics = fly_plan(planned)
                there = row(flight, known, metrics, ticks=len(trace), scenario=planned.scenario)
                if flight.index in chunk.remembered:
                    columns = {name: trace[name] for name in chunk.columns}
                    add_all(parts, {flight.point: Part.of(columns, sampled=flight.index in chunk.sampled)})
                rows.append(there)
            except Exception as error:
                rows.append(failed_row(flight, known, _said(error), chunk.estimators))
    return Flown(rows, parts, dict(versions()))


def _planned(scenario: Scenario, earlier: Plan | None) -> Plan:
    """Return the plan of a scenario: the earlier one, if that differs by the seed alone."""
    if earlier is not None:
        bound = scenario.with_aircraft(earlier.scenario.aircraft.model, earlier.scenario.aircraft.sha256)
        same_aircraft = scenario.aircraft.sha256 == earlier.scenario.aircraft.sha256
        if same_aircraft and bound == earlier.scenario.with_seed(scenario.seed):
            return replace(earlier, scenario=bound)
    return plan(scenario)


def _said(error: Exception) -> str:
    """Return what went wrong on one line: flightbed's own words, or the place, the kind and the message."""
    if isinstance(error, FlightbedError):
        return "; ".join(str(error).splitlines())
    frames = traceback.extract_tb(error.__traceback__)
    return f"{Path(frames[-1].filename).name}:{frames[-1].lineno}: {line_of(error)}" if frames else line_of(error)
