"""A study and its parts: each part names the flights and trials that it needs, and builds a section of the report from them."""

from __future__ import annotations

import time
from collections.abc import Callable, Hashable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from textwrap import shorten
from typing import Any, Self, TypeVar

from flightbed.document import Document, Section
from flightbed.engine import Opener
from flightbed.ensemble import Flown, Job, fly_jobs, run_jobs
from flightbed.versions import versions

Key = TypeVar("Key")
Flights = list[list[Flown]]
Results = list[list[Any]]  # per job: its flights, or the return values of its trials
Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Trials:
    """Runs of a simulation other than the flight of a scenario: ``simulate(seed, *arguments)`` with successive seeds.

    Attributes:
        simulate: a function that other processes can import; its result depends only on its arguments.
        arguments: the arguments after the seed.
        runs: number of runs.
        first_seed: seed of the first run.

    """

    simulate: Callable[..., Any]
    arguments: tuple[Hashable, ...]
    runs: int
    first_seed: int = 0

    def with_seeds(self, first_seed: int, runs: int) -> Self:
        """Return the same trials with other seeds."""
        return replace(self, first_seed=first_seed, runs=runs)


@dataclass(frozen=True)
class Part:
    """A section and its runs.

    Attributes:
        jobs: flights and trials.
        build: the results of each job, in order -> the section.

    """

    jobs: Sequence[Job | Trials]
    build: Callable[[Results], Section]


@dataclass(frozen=True)
class Study:
    """A published study.

    Attributes:
        name: its name on the command line.
        title: title of the report, with the reproduced publication.
        runs: default number of flights per case.
        parts: flights per case -> parts, in the order of the report.

    """

    name: str
    title: str
    runs: int
    parts: Callable[[int], Sequence[Part]]


def keyed(jobs: Mapping[Key, Job | Trials], build: Callable[[Mapping[Key, list[Any]]], Section]) -> Part:
    """Return a part whose ``build`` gets its results by the keys of its jobs."""
    return Part(list(jobs.values()), lambda results: build(dict(zip(jobs, results, strict=True))))


def distinct_jobs(parts: Sequence[Part]) -> list[Job | Trials]:
    """Return the jobs of all parts; a job that several parts share occurs once, with the most runs and all columns."""
    merged: dict[Hashable, Job | Trials] = {}
    for job in (job for part in parts for job in part.jobs):
        had = merged.setdefault(_what(job), job)
        runs = max(had.runs, job.runs)
        if isinstance(job, Job) and isinstance(had, Job):
            columns = tuple(dict.fromkeys((*had.columns, *job.columns)))
            merged[_what(job)] = replace(had, runs=runs, columns=columns)
        else:
            merged[_what(job)] = replace(had, runs=runs)
    return list(merged.values())


def _what(job: Job | Trials) -> Hashable:
    return job.scenario if isinstance(job, Job) else (job.simulate, job.arguments, job.first_seed)


def _simulate(trials: Trials) -> list[Any]:
    first = trials.first_seed
    return [trials.simulate(seed, *trials.arguments) for seed in range(first, first + trials.runs)]


def run_trials(
    trials: Sequence[Trials], *, executor: Executor | Opener | None, progress: Callable[[int], None]
) -> list[list[Any]]:
    """Run all trials; returns the results of each, in order of their seeds. As ``ensemble.fly_jobs`` otherwise."""
    return run_jobs(trials, _simulate, executor=executor, progress=progress, label=_label)


def _label(trials: Trials) -> str:
    name = f"{trials.simulate.__module__}.{trials.simulate.__qualname__}"
    return shorten(f"{name} with the arguments {trials.arguments}", 300, placeholder=" ...")


def reproduce(
    study: Study, runs: int, *, executor: Executor | Opener | None = None, progress: Progress | None = None
) -> Document:
    """Run the jobs of all parts of a study, each once, and return the report.

    If a worker process dies, its runs are repeated (``engine.results``).

    Args:
        study: the study.
        runs: flights or trials per case.
        executor: an executor, or a function that opens one (``engine.opener``); None runs in this process.
        progress: called with the number of finished runs and of all runs, whenever some finish.

    Raises:
        InputError: as ``ensemble.run_jobs``.

    """
    began, done = time.perf_counter(), 0
    parts = study.parts(runs)
    jobs = distinct_jobs(parts)
    total = sum(job.runs for job in jobs)

    def count(flights: int) -> None:
        nonlocal done
        done += flights
        if progress is not None:
            progress(done, total)

    flights = [job for job in jobs if isinstance(job, Job)]
    trials = [job for job in jobs if isinstance(job, Trials)]
    done_by = {_what(j): r for j, r in zip(flights, fly_jobs(flights, executor=executor, progress=count), strict=True)}
    tried = run_trials(trials, executor=executor, progress=count)
    results: dict[Hashable, list[Any]] = {**done_by, **{_what(j): r for j, r in zip(trials, tried, strict=True)}}
    sections = [part.build([results[_what(job)][: job.runs] for job in part.jobs]) for part in parts]
    facts = {
        "again": f"flightbed reproduce {study.name} --runs {runs}",
        "flights": total,
        "runs_of_each_case": runs,
        "seeds": "of each case from 0 on",
        "wall_time_s": round(time.perf_counter() - began, 1),
        "versions": dict(versions()),
    }
    return Document(study.title, sections, facts)
