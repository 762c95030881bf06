"""Worker of a campaign: flies one chunk of a programme; each flight gives a row and adds to the histories of its point."""

from __future__ import annotations

import traceback
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from flightbed.analysis.result import fly_plan
from flightbed.analysis.trace import true_share
from flightbed.campaigns.plan import Flight, Programme, flight_hash, scenario_of
from flightbed.campaigns.table import Row, failed_row, row
from flightbed.config.own_code import Extension, Packed, permit_packed
from flightbed.config.tracebacks import error_line
from flightbed.core.errors import FlightbedError
from flightbed.flight.plan import Plan, plan
from flightbed.parallel.executor import CHUNK, DEATHS
from flightbed.scenario.estimates import estimates
from flightbed.scenario.own_code import named_extensions
from flightbed.scenario.tables import Scenario
from flightbed.statistics.histories import SAMPLE, Part, add_all

HISTORIES = (
    "q_deg_s",
    "q_ref_deg_s",
    "alpha_deg",
    "elevator_deg",
)  # and for every estimate the smoothed K and the true K of its surface
DEATH_ERROR = (
    f"the worker process died at least {DEATHS} times while it flew only this flight; "
    "free memory, or correct the compiled or own code"
)


@dataclass(frozen=True)
class Chunk:
    """Flights that one worker flies in sequence.

    Attributes:
        number: number of the chunk, from 0.
        raw: base scenario, nested plain values.
        flights: flights in order of their indices.
        columns: columns of the trace that the histories hold.
        with_histories: indices of the flights that add to the histories.
        sampled: indices of the flights whose columns are kept for percentiles too.
        estimators: names of the estimates.
        extensions: own code that the flights use.

    """

    number: int
    raw: Mapping[str, Any]
    flights: tuple[Flight, ...]
    columns: tuple[str, ...]
    with_histories: frozenset[int]
    sampled: frozenset[int]
    estimators: tuple[str, ...]
    extensions: tuple[Extension | Packed, ...] = ()


@dataclass(frozen=True)
class ChunkResult:
    """Result of a chunk.

    Attributes:
        rows: one row per flight, in order.
        parts: point -> contribution to its histories by the flights that raised no error.

    """

    rows: list[Row]
    parts: Mapping[int, Part]


def chunk_of(programme: Programme, number: int) -> Chunk:
    """Return chunk ``number`` of a programme; it depends only on the programme."""
    indices = range(number * CHUNK, min((number + 1) * CHUNK, len(programme)))
    names = estimates(programme.scenario)
    truths = dict.fromkeys(map(true_share, ("", *names)))
    columns = (*HISTORIES, *truths, *(f"{name}.effectiveness_smoothed" for name in names))
    with_histories = frozenset(i for i in indices if i // programme.runs in programme.history_points)
    sampled = frozenset(i for i in with_histories if i % programme.runs < SAMPLE)
    flights = tuple(map(programme.flight, indices))
    return Chunk(
        number, dict(programme.raw), flights, columns, with_histories, sampled, names, programme.extensions
    )  # fmt: skip


def single_flights(chunk: Chunk) -> list[Chunk]:
    """Return a chunk as chunks of one flight each."""
    return [replace(chunk, flights=(flight,)) for flight in chunk.flights]


def join_flights(single: Sequence[ChunkResult]) -> ChunkResult:
    """Return the result of a chunk from those of its single flights; it equals that of the whole chunk bit for bit."""
    parts: dict[int, Part] = {}
    for one in single:
        add_all(parts, one.parts)
    return ChunkResult([row for one in single for row in one.rows], parts)


def killed_result(chunk: Chunk) -> ChunkResult:
    """Return the result of a chunk of one flight whose worker process died every time: a row with this error."""
    (flight,) = chunk.flights
    with permit_packed(chunk.extensions):
        scenario = scenario_of(chunk.raw, flight)
        # Planning could end this process too. A plan adds only the aircraft to the hashed scenario; if it is set already, none is needed.
        known = flight_hash(scenario, named_extensions(scenario)) if scenario.aircraft.sha256 else None
    return ChunkResult([failed_row(flight, known, DEATH_ERROR, chunk.estimators)], {})


def fly_chunk(chunk: Chunk) -> ChunkResult:
    """Fly a chunk. An exception of a flight goes into its row, and the next flight follows."""
    rows: list[Row] = []
    parts: dict[int, Part] = {}
    planned: Plan | None = None
    with permit_packed(chunk.extensions):
        for flight in chunk.flights:
            known: str | None = None
            try:
                scenario = scenario_of(chunk.raw, flight)
                planned = _planned(scenario, planned)
                known = flight_hash(planned.scenario, named_extensions(scenario))
                trace, metrics = fly_plan(planned)
                there = row(flight, known, metrics, ticks=len(trace), scenario=planned.scenario)
                if flight.index in chunk.with_histories:
                    columns = {name: trace[name] for name in chunk.columns}
                    add_all(parts, {flight.point: Part.of(columns, sampled=flight.index in chunk.sampled)})
                rows.append(there)
            except Exception as error:
                rows.append(failed_row(flight, known, _error_text(error), chunk.estimators))
    return ChunkResult(rows, parts)


def _planned(scenario: Scenario, earlier: Plan | None) -> Plan:
    """Return the plan of a scenario; the earlier one is reused if only the seed differs."""
    if earlier is not None:
        bound = scenario.with_aircraft(earlier.scenario.aircraft.model, earlier.scenario.aircraft.sha256)
        same_aircraft = scenario.aircraft.sha256 == earlier.scenario.aircraft.sha256
        if same_aircraft and bound == earlier.scenario.with_seed(scenario.seed):
            return replace(earlier, scenario=bound)
    return plan(scenario)


def _error_text(error: Exception) -> str:
    """Return an error on one line: the message of a flightbed error, else file, line, kind and message."""
    if isinstance(error, FlightbedError):
        return "; ".join(str(error).splitlines())
    frames = traceback.extract_tb(error.__traceback__)
    return f"{Path(frames[-1].filename).name}:{frames[-1].lineno}: {error_line(error)}" if frames else error_line(error)
