"""Flights per second against workers: ensembles on the linear aircraft and on the F-16, flown and measured as campaigns fly them.

Every worker gets as many flights as a single worker, so that none waits for another's last. One worker is this process, as in
`flightbed.analysis.seeds`; several are fresh processes. Timing starts when each has flown a flight; their start-up time is reported apart.
"""

from __future__ import annotations

import time
from functools import partial
from multiprocessing import get_context
from threading import Barrier

from measuring import Column, Effort, Table, machine

from flightbed.analysis.seeds import Job, fly_chunk, fly_jobs, processes
from flightbed.core.timing import interleaved, ratios, seconds
from flightbed.scenario.reading import Scenario, load_scenario

CASES = {"linear aircraft": "thesis-loss", "F-16": "elevator-loss"}


def workers(cores: int) -> list[int]:
    """Return 1, 2, 4, ... and the number of cores."""
    return sorted({*(2**n for n in range(cores.bit_length()) if 2**n <= cores), cores})


def measure(effort: Effort) -> list[Table]:
    """Return the table of the ensembles."""
    scenarios = {name: load_scenario(scenario, effort.overrides) for name, scenario in CASES.items()}
    counts = workers(machine()["cores"])
    cases = [(name, count) for name in scenarios for count in counts if count == 1 or name in effort.parallel]
    for scenario in scenarios.values():  # compiled code and the schedule are cached from now on
        fly_chunk(Job(scenario, 1))
    ways = {_label(*case): partial(_fly, scenarios[case[0]], case[1], effort) for case in cases}
    taken = interleaved(ways, effort.rounds, warm=0)
    rates, starts = ({way: [t[part] for t in times] for way, times in taken.items()} for part in (0, 1))
    rows = {
        _label(name, count): [
            rates[_label(name, count)],
            [r / count for r in ratios(rates[_label(name, count)], rates[_label(name, 1)])],
            [1e3 * count / r for r in rates[_label(name, count)]],
            starts[_label(name, count)],
        ]
        for name, count in cases
    }
    duration_s = next(iter(scenarios.values())).duration_s
    columns = (
        Column("flights per second", "1", ".1f"),
        Column("efficiency", "1", ".2f"),
        Column("a worker's time for a flight", "ms", ".1f"),
        Column("until all workers have flown one", "s", ".2f"),
    )
    title = f"{effort.chunks * effort.chunk} flights a worker, {duration_s:g} s each, in chunks of {effort.chunk}"
    return [Table(title, columns, rows)]


def _label(name: str, count: int) -> str:
    return f"{name}, {count} worker{'s' * (count > 1)}"


def _fly(scenario: Scenario, count: int, effort: Effort) -> tuple[float, float]:
    """Fly all; returns flights per second, and the start-up time of the workers, s."""
    jobs = [Job(scenario, effort.chunk, first_seed=n * effort.chunk) for n in range(count * effort.chunks)]
    began = time.perf_counter()
    with processes(count) as executor:
        if executor is None:
            fly_chunk(Job(scenario, 1))
        else:
            with get_context("spawn").Manager() as manager:
                barrier = manager.Barrier(count)
                ready = [executor.submit(_begin, Job(scenario, 1), barrier) for _ in range(count)]
                for future in ready:
                    future.result()
        started = time.perf_counter() - began
        taken = seconds(lambda: fly_jobs(jobs, executor=executor))
    return sum(job.runs for job in jobs) / taken, started


def _begin(job: Job, everybody: Barrier) -> None:
    """Fly once, and wait until every worker has flown: a waiting worker cannot take the task of another."""
    fly_chunk(job)
    everybody.wait()
