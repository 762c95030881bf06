"""What a worker of a campaign does: flies a few flights of a programme; each leaves a row, and adds to the histories."""

from __future__ import annotations

import traceback
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from flightbed.blame import line_of
from flightbed.campaign_table import Row, failed_row, row
from flightbed.consistency import estimates
from flightbed.errors import FlightbedError
from flightbed.extension import Extension, Packed, carried, named_by
from flightbed.mission import Plan, fly_plan, plan
from flightbed.moments import Moments, total
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


@dataclass(frozen=True)
class Chunk:
    """Flights that are flown by one worker, one after the other.

    Attributes:
        number: of the chunk.
        raw: base scenario, nested plain values.
        flights: in order of their indices.
        columns: of the trace, whose histories are added up; none of a programme with several points.
        estimators: names of the estimates.
        extensions: code of the user's own that flies.

    """

    number: int
    raw: Mapping[str, Any]
    flights: tuple[Flight, ...]
    columns: tuple[str, ...]
    estimators: tuple[str, ...]
    extensions: tuple[Extension | Packed, ...] = ()


@dataclass(frozen=True)
class Flown:
    """What comes back: a row a flight, in order; histories of those that flew, None if none did; what they were flown with."""

    rows: list[Row]
    moments: Moments | None
    versions: dict[str, str]


def chunk_of(programme: Programme, number: int) -> Chunk:
    """Return chunk ``number`` of a programme: it depends on the programme alone, not on what has been flown."""
    indices = range(number * CHUNK, min((number + 1) * CHUNK, len(programme)))
    names = estimates(programme.scenario)
    truths = dict.fromkeys(map(true_share, ("", *names)))
    columns = (*HISTORIES, *truths, *(f"{name}.effectiveness_smoothed" for name in names))
    return Chunk(
        number,
        dict(programme.raw),
        tuple(map(programme.flight, indices)),
        columns if len(programme.points) == 1 else (),
        names,
        programme.extensions,
    )


def fly_chunk(chunk: Chunk) -> Flown:
    """Fly a chunk. What a flight raises is in its row, and the next is flown."""
    rows, parts = [], []
    planned: Plan | None = None
    with carried(chunk.extensions):
        for flight in chunk.flights:
            known: str | None = None
            try:
                scenario = scenario_of(chunk.raw, flight)
                planned = _planned(scenario, planned)
                known = flight_hash(planned.scenario, named_by(scenario))
                trace, metrics = fly_plan(planned)
                if chunk.columns:
                    parts.append(Moments.of({name: trace[name] for name in chunk.columns}))
                rows.append(row(flight, known, metrics, ticks=len(trace), scenario=planned.scenario))
            except Exception as error:
                rows.append(failed_row(flight, known, _said(error), chunk.estimators))
    return Flown(rows, total(parts) if parts else None, dict(versions()))


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
