"""Flights shared by the tests of the studies: flown once, on all cores."""

from __future__ import annotations

from dataclasses import dataclass

import pytest

from flightbed.analysis.seeds import Flown, fly_jobs, processes
from flightbed.document.document import Section
from flightbed.studies.base import Part, distinct_jobs
from flightbed.studies.sillence import printed, setup, tables
from flightbed.studies.sillence.claims import claims
from flightbed.studies.sillence.figures import figures

RUNS = 60  # noise draws, seeds 0 to 59


@dataclass(frozen=True)
class Flights:
    """Sections of the study, and the flights of Tables 4 and 5 by K_1."""

    claims: Section
    search: Section
    glance: Section
    figures: Section
    by_gain: dict[float, list[Flown]]


@pytest.fixture(scope="session")
def flown() -> Flights:
    parts: dict[str, Part] = {
        "claims": claims(RUNS),
        "search": setup.search(),
        "glance": tables.glance(RUNS),
        "figures": figures(),
    }
    jobs = distinct_jobs(list(parts.values()))
    with processes() as executor:
        flights = dict(zip((job.scenario for job in jobs), fly_jobs(jobs, executor=executor), strict=True))
    built = {n: p.build([flights[job.scenario][: job.runs] for job in p.jobs]) for n, p in parts.items()}
    by_gain = {left: flights[tables.flight(left)][:RUNS] for left in printed.GAINS_LEFT}
    return Flights(**built, by_gain=by_gain)
