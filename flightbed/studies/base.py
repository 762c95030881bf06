"""What a study is made of: parts, each the flights that it needs and the section that it makes of them."""

from __future__ import annotations

import platform
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from importlib.metadata import version
from typing import TypeVar

from flightbed.document import Document, Section
from flightbed.ensemble import Flown, Job, fly_jobs
from flightbed.settings import Scenario

Key = TypeVar("Key")
Flights = list[list[Flown]]
Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Part:
    """A section and the flights behind it.

    Attributes:
        jobs: what has to be flown.
        build: the flights of each job, in order -> the section.

    """

    jobs: Sequence[Job]
    build: Callable[[Flights], Section]


@dataclass(frozen=True)
class Study:
    """A published study.

    Attributes:
        name: its name on the command line.
        title: what it reproduces.
        runs: flights of each case if nothing else is asked for.
        parts: flights of each case -> its parts, in the order of the report.

    """

    name: str
    title: str
    runs: int
    parts: Callable[[int], Sequence[Part]]


def keyed(jobs: Mapping[Key, Job], build: Callable[[Mapping[Key, list[Flown]]], Section]) -> Part:
    """Return a part whose flights are found by the keys of its jobs."""
    return Part(list(jobs.values()), lambda flights: build(dict(zip(jobs, flights, strict=True))))


def distinct_jobs(parts: Sequence[Part]) -> list[Job]:
    """Return what all parts together have to fly; flights that several of them need are flown once, with all the columns."""
    merged: dict[Scenario, Job] = {}
    for job in (job for part in parts for job in part.jobs):
        had = merged.setdefault(job.scenario, job)
        columns = tuple(dict.fromkeys((*had.columns, *job.columns)))
        merged[job.scenario] = replace(had, runs=max(had.runs, job.runs), columns=columns)
    return list(merged.values())


def reproduce(
    study: Study, runs: int, *, executor: Executor | None = None, progress: Progress | None = None
) -> Document:
    """Fly what all parts of a study need, together, and make its report.

    Args:
        study: which.
        runs: flights of each case.
        executor: where they are flown; None flies here and now.
        progress: called with the numbers of flights that are done, and of all, whenever some are done.

    """
    began, done = time.perf_counter(), 0
    parts = study.parts(runs)
    jobs = distinct_jobs(parts)
    total = sum(job.runs for job in jobs)

    def tell(flights: int) -> None:
        nonlocal done
        done += flights
        if progress is not None:
            progress(done, total)

    flown = dict(zip((job.scenario for job in jobs), fly_jobs(jobs, executor=executor, progress=tell), strict=True))
    sections = [part.build([flown[job.scenario][: job.runs] for job in part.jobs]) for part in parts]
    facts = {
        "again": f"flightbed reproduce {study.name} --runs {runs}",
        "flights": total,
        "runs_of_each_case": runs,
        "seeds": "of each case from 0 on",
        "wall_time_s": round(time.perf_counter() - began, 1),
        "versions": versions(),
    }
    return Document(study.title, sections, facts)


def versions() -> dict[str, str]:
    """Return the versions that the numbers of a study depend on."""
    return {
        "flightbed": version("flightbed"),
        "python": platform.python_version(),
        **{package: version(package) for package in ("jsbsim", "numpy", "scipy", "numba")},
    }
