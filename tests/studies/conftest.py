"""Flights shared by the tests of the studies, flown once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import pytest

from flightbed.analysis.seeds import Flown, fly_jobs
from flightbed.document.document import Section
from flightbed.studies.base import Part, distinct_jobs
from flightbed.studies.sillence import printed, setup, tables
from flightbed.studies.sillence.claims import claims
from flightbed.studies.sillence.figures import figures

FEW, MANY = (12, 10), (60, 25)  # noise draws of the claims and of the search, seeds from 0 on


@dataclass(frozen=True)
class Flights:
    """Sections of the study, and the flights of Tables 4 and 5 by K_1."""

    runs: int
    claims: Section
    search: Section
    glance: Section
    figures: Section
    by_gain: dict[float, list[Flown]]


@pytest.fixture(scope="session", params=[FEW, pytest.param(MANY, marks=pytest.mark.long)], ids=["few", "many"])
def flown(request: pytest.FixtureRequest) -> Flights:
    return _fly(*request.param)


@cache
def _fly(runs: int, search_runs: int) -> Flights:
    parts: dict[str, Part] = {
        "claims": claims(runs),
        "search": setup.search(search_runs),
        "glance": tables.glance(runs),
        "figures": figures(),
    }
    jobs = distinct_jobs(list(parts.values()))
    flights = dict(zip((job.scenario for job in jobs), fly_jobs(jobs), strict=True))
    built = {n: p.build([flights[job.scenario][: job.runs] for job in p.jobs]) for n, p in parts.items()}
    by_gain = {left: flights[tables.flight(left)][:runs] for left in printed.GAINS_LEFT}
    return Flights(runs, **built, by_gain=by_gain)
