"""Many flights of one plan, each with its own seed, on any executor; the results do not depend on how many work."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass, replace
from multiprocessing import get_context, parent_process
from multiprocessing.connection import wait
from threading import Thread
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from flightbed.extension import Extension, Packed, carried, named_by
from flightbed.metrics import Metrics
from flightbed.mission import Plan, fly_plan, plan
from flightbed.scenario import Scenario

Vector = npt.NDArray[np.float64]
Progress = Callable[[int], None]
T = TypeVar("T")
R = TypeVar("R")

_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")

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
    """Give an executor of so many fresh local processes, all cores if None; one worker is none: fly here.

    A worker's linear algebra has one thread, unless the environment says otherwise: the matrices are small, and threads that wait for
    more of them by spinning made two workers slower than one.
    """
    count = workers or os.cpu_count() or 1
    if count == 1:
        yield None
        return
    with (
        _environment(dict.fromkeys(_THREADS, "1")),  # read when a worker starts, at the latest with the first chunks
        ProcessPoolExecutor(count, get_context("spawn"), initializer=_begin) as executor,
    ):
        yield executor


def _begin() -> None:
    """Prepare a worker: an interrupt is the parent's to handle, which cancels what has not begun; a killed parent ends it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = parent_process()
    if parent is not None:
        Thread(target=_end_with, args=(parent.sentinel,), daemon=True).start()


def _end_with(sentinel: int) -> None:
    wait([sentinel])
    os._exit(1)  # nobody is there to hear of it, and the queue that the worker waits at would never end


@contextmanager
def _environment(defaults: Mapping[str, str]) -> Iterator[None]:
    """Set variables that are not set, for as long as it lasts."""
    added = {name: value for name, value in defaults.items() if name not in os.environ}
    os.environ.update(added)
    try:
        yield
    finally:
        for name in added:
            os.environ.pop(name, None)


def histories(flights: Sequence[Flown], column: str) -> tuple[Vector, Vector, npt.NDArray[np.int64]]:
    """Return mean, standard deviation and number of the flights still flying at every tick, of a column that was kept.

    The standard deviation is that of the flights (n - 1 in the divisor); 0 where one flies, nan where the mean is infinite.
    """
    values = [flown.columns[column] for flown in flights]
    lengths = np.array([len(v) for v in values])
    aloft = np.arange(lengths.max()) < lengths[:, None]
    table = np.zeros(aloft.shape)
    table[aloft] = np.concatenate(values)
    flying = np.sum(aloft, axis=0)
    mean = np.sum(table, axis=0) / flying
    with np.errstate(invalid="ignore"):
        variance = np.sum((table - mean) ** 2, axis=0, where=aloft) / np.maximum(flying - 1, 1)
    return mean, np.sqrt(variance), flying
