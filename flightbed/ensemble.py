"""Many flights of one plan, each with its own seed, on any executor; the results do not depend on how many work."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from flightbed.extension import Extension, Packed, carried, named_by
from flightbed.flight_result import fly_plan
from flightbed.metrics import Metrics
from flightbed.moments import Moments, total
from flightbed.plan import Plan, plan
from flightbed.processes import apart
from flightbed.scenario import Scenario

Vector = npt.NDArray[np.float64]
Progress = Callable[[int], None]
T = TypeVar("T")
R = TypeVar("R")

CHUNK = 25  # flights of one plan that a worker does at a time


@dataclass(frozen=True)
class Flown:
    """What is kept of one flight: its metrics, and the columns that were asked for (as long as it flew)."""

    seed: int
    metrics: Metrics
    columns: dict[str, Vector]


@dataclass(frozen=True)
class Job:
    """Flights of one scenario with seeds ``first_seed``, ``first_seed`` + 1, ...

    Attributes:
        scenario: what to fly.
        runs: how often.
        columns: columns of the trace to keep.
        first_seed: seed of the first flight.
        extensions: code of the user's own that the scenario names; ``fly_jobs`` puts in what is permitted where it is called.

    """

    scenario: Scenario
    runs: int
    columns: tuple[str, ...] = ()
    first_seed: int = 0
    extensions: tuple[Extension | Packed, ...] = ()


def _ignore(_flights: int) -> None:
    pass


def fly_jobs(
    jobs: Sequence[Job], *, executor: Executor | None = None, progress: Progress = _ignore
) -> list[list[Flown]]:
    """Fly all jobs; returns the flights of each, in order of their seeds.

    Code of the user's own that is permitted here (``flightbed.using``) is permitted where the jobs are flown: another process imports
    it again, a class at hand must be importable there.

    Args:
        jobs: what to fly.
        executor: where; None flies here and now.
        progress: called with the number of flights that were done since it was called last.

    """
    jobs = [replace(job, extensions=job.extensions or named_by(job.scenario)) for job in jobs]
    chunks = [
        (index, replace(job, runs=min(CHUNK, job.runs - start), first_seed=job.first_seed + start))
        for index, job in enumerate(jobs)
        for start in range(0, job.runs, CHUNK)
    ]
    parts = spread(
        [chunk for _, chunk in chunks], fly_chunk, executor=executor, done=lambda chunk: progress(chunk.runs)
    )
    flown: list[list[Flown]] = [[] for _ in jobs]
    for (index, _), flights in zip(chunks, parts, strict=True):
        flown[index] += flights
    return flown


def spread(
    tasks: Sequence[T], work: Callable[[T], R], *, executor: Executor | None, done: Callable[[T], object]
) -> list[R]:
    """Return what a function makes of every task, in the order of the tasks.

    Args:
        tasks: what to do.
        work: a function that other processes can import.
        executor: where; None works here and now.
        done: called with each task as it is done.

    """
    if executor is None:
        results = []
        for task in tasks:
            results.append(work(task))
            done(task)
        return results
    futures = {executor.submit(work, task): task for task in tasks}
    try:
        for future in as_completed(futures):
            future.result()
            done(futures[future])
    except BaseException:
        for future in futures:
            future.cancel()
        raise
    return [future.result() for future in futures]


def fly_chunk(job: Job) -> list[Flown]:
    """Plan once, fly every seed; what a worker does."""
    with carried(job.extensions):
        planned = plan(job.scenario)
        return [_fly_one(planned, seed, job.columns) for seed in range(job.first_seed, job.first_seed + job.runs)]


def _fly_one(planned: Plan, seed: int, columns: tuple[str, ...]) -> Flown:
    trace, metrics = fly_plan(replace(planned, scenario=planned.scenario.with_seed(seed)))
    return Flown(seed, metrics, {name: trace[name] for name in columns})


@contextmanager
def processes(workers: int | None = None) -> Iterator[Executor | None]:
    """Give an executor of so many fresh local processes, all cores if None; one worker is none: fly here."""
    count = workers or os.cpu_count() or 1
    if count == 1:
        yield None
        return
    with apart(count) as executor:
        yield executor


def histories(flights: Sequence[Flown], column: str) -> tuple[Vector, Vector, npt.NDArray[np.int64]]:
    """Return mean, standard deviation and number of the flights still flying at every tick, of a column that was kept.

    The standard deviation is that of the flights (n - 1 in the divisor); 0 where one flies, nan where the mean is infinite.
    """
    whole = total([Moments.of({column: flown.columns[column]}) for flown in flights])
    return whole.mean[column], whole.std(column), whole.flying
