"""Many flights of one plan, each with its own seed, on any executor; the results do not depend on the number of workers."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain
from typing import Any, NoReturn, Protocol, Self, TypeVar

import numpy as np
import numpy.typing as npt

from flightbed.analysis.metrics import Metrics
from flightbed.analysis.result import fly_plan
from flightbed.config.own_code import Extension, Packed, permit_packed
from flightbed.core.errors import InputError
from flightbed.flight.plan import Plan, plan
from flightbed.parallel.executor import CHUNK, DEATHS, Opener, Work, results
from flightbed.parallel.processes import local_processes
from flightbed.scenario.own_code import named_extensions
from flightbed.scenario.reading import Scenario
from flightbed.statistics.moments import Moments, total

Vector = npt.NDArray[np.float64]
Progress = Callable[[int], None]
R = TypeVar("R")
J = TypeVar("J", bound="SeededJob")

_MOST_KEYS = 8  # of a case's settings, in an error


class SeededJob(Protocol):
    """Runs with the seeds ``first_seed``, ``first_seed`` + 1, ..., ``runs`` of them, independent of each other."""

    @property
    def runs(self) -> int:
        """Number of runs."""

    @property
    def first_seed(self) -> int:
        """Seed of the first run."""

    def with_seeds(self, first_seed: int, runs: int) -> Self:
        """Return the same job with other seeds."""


@dataclass(frozen=True)
class Flown:
    """Result of one flight: its metrics, and the requested columns of its trace, up to the last tick that it flew."""

    seed: int
    metrics: Metrics
    columns: dict[str, Vector]


@dataclass(frozen=True)
class Job:
    """Flights of one scenario with seeds ``first_seed``, ``first_seed`` + 1, ...

    Attributes:
        scenario: the scenario; its own seed is replaced.
        runs: number of flights.
        columns: columns of the trace to keep.
        first_seed: seed of the first flight.
        extensions: own code that the scenario names; ``fly_jobs`` fills in the code that is permitted in the calling process.

    """

    scenario: Scenario
    runs: int
    columns: tuple[str, ...] = ()
    first_seed: int = 0
    extensions: tuple[Extension | Packed, ...] = ()

    def with_seeds(self, first_seed: int, runs: int) -> Self:
        """Return the same job with other seeds."""
        return replace(self, first_seed=first_seed, runs=runs)


def _ignore(_flights: int) -> None:
    pass


def fly_jobs(
    jobs: Sequence[Job], *, executor: Executor | Opener | None = None, progress: Progress = _ignore
) -> list[list[Flown]]:
    """Fly all jobs; returns the flights of each job, in order of their seeds.

    Own code that is permitted here (``flightbed.using``) is permitted in the worker processes too: they import it again, so a class
    passed in Python must be importable there. If a worker process dies, its flights are repeated (``executor.results``).

    Args:
        jobs: the flights.
        executor: an executor, or a function that opens one (``executor.opener``); None flies in this process.
        progress: called with the number of flights that finished since the last call.

    Raises:
        InputError: a flight ends its worker process every time; and as ``executor.results``. Errors of a flight propagate.

    """
    jobs = [replace(job, extensions=job.extensions or named_extensions(job.scenario)) for job in jobs]
    return run_jobs(jobs, fly_chunk, executor=executor, progress=progress, label=partial(_label, jobs))


def run_jobs(
    jobs: Sequence[J],
    run: Callable[[J], list[R]],
    *,
    executor: Executor | Opener | None,
    progress: Progress,
    label: Callable[[J], str],
) -> list[list[R]]:
    """Run all jobs, ``CHUNK`` seeds per task; returns the results of each job, in order of their seeds.

    Args:
        jobs: the jobs.
        run: job -> one result per seed; other processes must be able to import it.
        executor: an executor, or a function that opens one (``executor.opener``); None runs in this process.
        progress: called with the number of runs that finished since the last call.
        label: job -> its name in an error.

    Raises:
        InputError: a run ends its worker process every time; and as ``executor.results``. Errors of ``run`` propagate.

    """

    def lost(part: tuple[int, J]) -> NoReturn:
        number, job = part
        raise InputError(
            f"case {number + 1} of {len(jobs)}, {label(job)}, seed {job.first_seed}: the worker process died {DEATHS} times while it "
            "ran only this case and seed; free memory, or correct the compiled or own code that this case uses"
        )

    tasks = [(n, chunk) for n, job in enumerate(jobs) for chunk in _split(job, CHUNK)]
    work: Work[tuple[int, J], list[R]] = Work(
        do=partial(_run, run),
        parts=lambda task: [(task[0], part) for part in _split(task[1], 1)],
        join=lambda parts: list(chain.from_iterable(parts)),
        lost=lost,
    )
    done: dict[tuple[int, int], list[R]] = {}
    with closing(results(tasks, work, executor)) as finished:
        for (number, chunk), found in finished:
            done[number, chunk.first_seed] = found
            progress(chunk.runs)
    by_job: list[list[R]] = [[] for _ in jobs]
    for number, chunk in tasks:
        by_job[number] += done.pop((number, chunk.first_seed))
    return by_job


def _split(job: J, size: int) -> list[J]:
    """Return a job as jobs of at most ``size`` seeds."""
    end = job.first_seed + job.runs
    return [job.with_seeds(first, min(size, end - first)) for first in range(job.first_seed, end, size)]


def _run(run: Callable[[J], list[R]], task: tuple[int, J]) -> list[R]:
    return run(task[1])


def fly_chunk(job: Job) -> list[Flown]:
    """Plan once, then fly every seed."""
    with permit_packed(job.extensions):
        planned = plan(job.scenario)
        return [_fly_one(planned, seed, job.columns) for seed in range(job.first_seed, job.first_seed + job.runs)]


def _fly_one(planned: Plan, seed: int, columns: tuple[str, ...]) -> Flown:
    trace, metrics = fly_plan(replace(planned, scenario=planned.scenario.with_seed(seed)))
    return Flown(seed, metrics, {name: trace[name] for name in columns})


def _label(jobs: Sequence[Job], job: Job) -> str:
    """Return the name of a job's scenario, and the settings in which it differs from other jobs' scenarios."""
    settings = _flat(job.scenario.model_dump(mode="json", by_alias=True))
    others = [_flat(other.scenario.model_dump(mode="json", by_alias=True)) for other in jobs]
    compared = [key for key in settings if key not in ("name", "description")]
    differing = [key for key in compared if any(other.get(key) != settings[key] for other in others)]
    texts = [f"{key} = {settings[key]}" for key in differing[:_MOST_KEYS]]
    more = ["..."] if len(differing) > _MOST_KEYS else []
    return f"scenario '{job.scenario.name}'" + (f" ({', '.join([*texts, *more])})" if texts else "")


def _flat(value: Any, key: str = "") -> dict[str, Any]:
    """Return nested values by their dotted keys."""
    if not isinstance(value, dict | list):
        return {key: value}
    items = value.items() if isinstance(value, dict) else enumerate(value)
    return {k: v for name, inner in items for k, v in _flat(inner, f"{key}.{name}" if key else str(name)).items()}


@contextmanager
def processes(workers: int | None = None) -> Iterator[Executor | None]:
    """Open an executor of fresh local processes, one per core if None; for one worker it is None: fly in this process."""
    count = workers or os.cpu_count() or 1
    if count == 1:
        yield None
        return
    with local_processes(count) as executor:
        yield executor


def histories(flights: Sequence[Flown], column: str) -> tuple[Vector, Vector, npt.NDArray[np.int64]]:
    """Return mean, standard deviation and number of flights at every tick, (n,) each, of a column that was kept.

    A tick counts the flights that have not ended before it. The standard deviation has n - 1 in the divisor; it is 0 for a single
    flight, and nan where the mean is infinite.
    """
    whole = total([Moments.of({column: flown.columns[column]}) for flown in flights])
    return whole.mean[column], whole.std(column), whole.flying
