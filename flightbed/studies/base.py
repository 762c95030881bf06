"""What a study is made of: parts, each the flights and trials that it needs and the section that it makes of them."""

from __future__ import annotations

import platform
import time
from collections.abc import Callable, Hashable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeVar

from flightbed.document import Document, Section
from flightbed.ensemble import CHUNK, Flown, Job, fly_jobs, spread
from flightbed.errors import InputError
from flightbed.registry import factory, in_use, names

Key = TypeVar("Key")
Flights = list[list[Flown]]
Results = list[list[Any]]  # of each job its flights, or what its trials returned
Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Trials:
    """Runs of a simulation that is no flight of a scenario: ``simulate(seed, *arguments)`` with the seeds 0, 1, ...

    Attributes:
        simulate: a function that other processes can import; its result depends on its arguments alone.
        arguments: after the seed.
        runs: how often.
        first_seed: seed of the first run.

    """

    simulate: Callable[..., Any]
    arguments: tuple[Hashable, ...]
    runs: int
    first_seed: int = 0


@dataclass(frozen=True)
class Part:
    """A section and the runs behind it.

    Attributes:
        jobs: what has to be flown or tried.
        build: the results of each job, in order -> the section.

    """

    jobs: Sequence[Job | Trials]
    build: Callable[[Results], Section]


@dataclass(frozen=True)
class Study:
    """A published study.

    Attributes:
        name: its name on the command line.
        title: what it reproduces.
        runs: flights of each case if nothing else is asked for.
        parts: flights of each case -> its parts, in the order of the report.
        options: of the command that reproduces it, after the number of runs, each after a space.
        with_own: names of permitted code, files of its settings -> the same study with it; None for a study that takes none.

    """

    name: str
    title: str
    runs: int
    parts: Callable[[int], Sequence[Part]]
    options: str = ""
    with_own: Callable[[Sequence[str], Sequence[Path]], Study] | None = None


def with_own(study: Study, use: Sequence[str], settings: Sequence[Path]) -> Study:
    """Return a study with estimators of the user's own; the study itself where neither code nor settings are given.

    Args:
        study: the study.
        use: names of the code, which must be permitted here (``extension.using``).
        settings: TOML files with their settings.

    Raises:
        InputError: the study takes none, or cannot use these.

    """
    if not use and not settings:
        return study
    if study.with_own is None:
        option = f"--use {use[0]}" if use else f"--settings {settings[0]}"
        able = [name for name in names("studies") if name not in in_use() and factory("studies", name)().with_own]
        raise InputError(
            f"{option}: the study {study.name} takes no code or settings of your own; leave it out, or reproduce {' or '.join(able)}"
        )
    return study.with_own(use, settings)


def keyed(jobs: Mapping[Key, Job | Trials], build: Callable[[Mapping[Key, list[Any]]], Section]) -> Part:
    """Return a part whose results are found by the keys of its jobs."""
    return Part(list(jobs.values()), lambda results: build(dict(zip(jobs, results, strict=True))))


def distinct_jobs(parts: Sequence[Part]) -> list[Job | Trials]:
    """Return what all parts together have to run; what several of them need is run once, flights with all the columns."""
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


def _try(trials: Trials) -> list[Any]:
    first = trials.first_seed
    return [trials.simulate(seed, *trials.arguments) for seed in range(first, first + trials.runs)]


def run_trials(
    trials: Sequence[Trials], *, executor: Executor | None, progress: Callable[[int], None]
) -> list[list[Any]]:
    """Run all trials; returns the results of each, in order of their seeds. As ``ensemble.fly_jobs`` otherwise."""
    chunks = [
        (index, replace(one, runs=min(CHUNK, one.runs - start), first_seed=one.first_seed + start))
        for index, one in enumerate(trials)
        for start in range(0, one.runs, CHUNK)
    ]
    parts = spread([chunk for _, chunk in chunks], _try, executor=executor, done=lambda chunk: progress(chunk.runs))
    results: list[list[Any]] = [[] for _ in trials]
    for (index, _), part in zip(chunks, parts, strict=True):
        results[index] += part
    return results


def reproduce(
    study: Study, runs: int, *, executor: Executor | None = None, progress: Progress | None = None
) -> Document:
    """Run what all parts of a study need, together, and make its report.

    Args:
        study: which.
        runs: flights or trials of each case.
        executor: where they are run; None runs them here and now.
        progress: called with the numbers of runs that are done, and of all, whenever some are done.

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

    flights = [job for job in jobs if isinstance(job, Job)]
    trials = [job for job in jobs if isinstance(job, Trials)]
    done_by = {_what(j): r for j, r in zip(flights, fly_jobs(flights, executor=executor, progress=tell), strict=True)}
    tried = run_trials(trials, executor=executor, progress=tell)
    results: dict[Hashable, list[Any]] = {**done_by, **{_what(j): r for j, r in zip(trials, tried, strict=True)}}
    sections = [part.build([results[_what(job)][: job.runs] for job in part.jobs]) for part in parts]
    facts = {
        "again": f"flightbed reproduce {study.name} --runs {runs}{study.options}",
        "flights": total,
        "runs_of_each_case": runs,
        "seeds": "of each case from 0 on",
        "wall_time_s": round(time.perf_counter() - began, 1),
        "versions": versions(),
        **({"extensions": {own.name: own.sha256 for own in in_use().values()}} if in_use() else {}),
    }
    return Document(study.title, sections, facts)


def versions() -> dict[str, str]:
    """Return the versions that the numbers of a study depend on."""
    return {
        "flightbed": version("flightbed"),
        "python": platform.python_version(),
        **{package: version(package) for package in ("jsbsim", "numpy", "scipy", "numba")},
    }
