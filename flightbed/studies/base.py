"""Structure and execution of a study: its parts, each with the flights or trials that it needs and the section built from them."""

from __future__ import annotations

import time
from collections.abc import Callable, Hashable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path
from textwrap import shorten
from typing import Any, Self, TypeVar

from flightbed.analysis.seeds import Flown, Job, fly_jobs, run_jobs
from flightbed.config.families import factory, in_use, names
from flightbed.core.errors import InputError
from flightbed.core.sources import source_sha256
from flightbed.core.versions import versions
from flightbed.document.document import Document, Section
from flightbed.parallel.executor import Opener

Key = TypeVar("Key")
Flights = list[list[Flown]]
Results = list[list[Any]]  # per job: its flights, or the return values of its trials
Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Trials:
    """Monte Carlo runs of a simulation other than a scenario: ``simulate(seed, *arguments)`` with seeds 0, 1, ...

    Attributes:
        simulate: function that worker processes can import; its result depends on its arguments alone.
        arguments: positional arguments after the seed.
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
    """A section of the report, and the runs that it needs.

    Attributes:
        jobs: flights and trials to run.
        build: maps the results, one list per job in the order of ``jobs``, to the section.

    """

    jobs: Sequence[Job | Trials]
    build: Callable[[Results], Section]


@dataclass(frozen=True)
class Study:
    """A published study.

    Attributes:
        name: name on the command line.
        title: title of the report: the publication.
        runs: default number of flights or trials per case.
        parts: maps the number of runs per case to the parts, in the order of the report.
        options: further options of the command that reproduces the study, each after a space.
        with_own: maps names of permitted code and files of its settings to the same study with that code; None for a study without.

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
        use: names of the code, which must be permitted here (``own_code.using``).
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


def keyed_part(jobs: Mapping[Key, Job | Trials], build: Callable[[Mapping[Key, list[Any]]], Section]) -> Part:
    """Return a part whose ``build`` receives its results as a mapping with the keys of ``jobs``."""
    return Part(list(jobs.values()), lambda results: build(dict(zip(jobs, results, strict=True))))


def distinct_jobs(parts: Sequence[Part]) -> list[Job | Trials]:
    """Return the jobs of all parts without duplicates: a shared job has the largest ``runs``, a shared flight the union of the columns."""
    merged: dict[Hashable, Job | Trials] = {}
    for job in (job for part in parts for job in part.jobs):
        earlier = merged.setdefault(_job_key(job), job)
        runs = max(earlier.runs, job.runs)
        if isinstance(job, Job) and isinstance(earlier, Job):
            columns = tuple(dict.fromkeys((*earlier.columns, *job.columns)))
            merged[_job_key(job)] = replace(earlier, runs=runs, columns=columns)
        else:
            merged[_job_key(job)] = replace(earlier, runs=runs)
    return list(merged.values())


def _job_key(job: Job | Trials) -> Hashable:
    return job.scenario if isinstance(job, Job) else (job.simulate, job.arguments, job.first_seed)


def _run_chunk(trials: Trials) -> list[Any]:
    first = trials.first_seed
    return [trials.simulate(seed, *trials.arguments) for seed in range(first, first + trials.runs)]


def run_trials(
    trials: Sequence[Trials], *, executor: Executor | Opener | None, progress: Callable[[int], None]
) -> list[list[Any]]:
    """Run all trials and return their results: one list per element of ``trials``, in the order of the seeds.

    Args:
        trials: simulations to run.
        executor: as in ``seeds.fly_jobs``; None runs them in this process.
        progress: called with the number of runs just completed.

    """
    return run_jobs(trials, _run_chunk, executor=executor, progress=progress, label=_label)


def _label(trials: Trials) -> str:
    name = f"{trials.simulate.__module__}.{trials.simulate.__qualname__}"
    return shorten(f"{name} with the arguments {trials.arguments}", 300, placeholder=" ...")


def reproduce(
    study: Study, runs: int, *, executor: Executor | Opener | None = None, progress: Progress | None = None
) -> Document:
    """Run the jobs of all parts of a study, each distinct job once, and return the report.

    If a worker process dies, its runs are repeated (``executor.results``).

    Args:
        study: the study.
        runs: flights or trials per case.
        executor: an executor, or a function that opens one (``executor.opener``); None runs in this process.
        progress: called after each chunk of runs with the numbers of completed runs and of all runs.

    Raises:
        InputError: as ``seeds.run_jobs``.

    """
    began, done = time.perf_counter(), 0
    parts = study.parts(runs)
    jobs = distinct_jobs(parts)
    total = sum(job.runs for job in jobs)

    def report_progress(flights: int) -> None:
        nonlocal done
        done += flights
        if progress is not None:
            progress(done, total)

    flights = [job for job in jobs if isinstance(job, Job)]
    trials = [job for job in jobs if isinstance(job, Trials)]
    flight_results = {
        _job_key(j): r
        for j, r in zip(flights, fly_jobs(flights, executor=executor, progress=report_progress), strict=True)
    }
    trial_results = run_trials(trials, executor=executor, progress=report_progress)
    results: dict[Hashable, list[Any]] = {
        **flight_results,
        **{_job_key(j): r for j, r in zip(trials, trial_results, strict=True)},
    }
    sections = [part.build([results[_job_key(job)][: job.runs] for job in part.jobs]) for part in parts]
    facts = {
        "again": f"flightbed reproduce {study.name} --runs {runs}{study.options}",
        "flights": total,
        "runs_of_each_case": runs,
        "seeds": "of each case from 0 on",
        "wall_time_s": round(time.perf_counter() - began, 1),
        "versions": dict(versions()),
        "source_sha256": source_sha256(),
        **({"extensions": {own.name: own.sha256 for own in in_use().values()}} if in_use() else {}),
    }
    return Document(study.title, sections, facts)
