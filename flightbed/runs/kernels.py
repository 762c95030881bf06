"""Compile the kernels that the shipped scenarios need, into the user's cache folder."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import as_completed

from flightbed.core import data
from flightbed.parallel.processes import local_processes
from flightbed.runs.run import run
from flightbed.scenario.reading import load_scenario
from flightbed.scenario.tables import Scenario


def compile_shipped(progress: Callable[[int, int], None], workers: int | None = None) -> int:
    """Fly every shipped scenario, without a folder: the kernels that the cache lacks are compiled, for later processes too.

    Args:
        progress: called with the numbers of flown and of all scenarios, after each.
        workers: number of local processes; None: one per core.

    Returns: number of scenarios.

    """
    names = _in_order({name: load_scenario(name) for name in data.names("scenario")})
    with local_processes(workers) as executor:
        flights = [executor.submit(_fly, name) for name in names]
        for done, flight in enumerate(as_completed(flights), start=1):
            flight.result()
            progress(done, len(names))
    return len(names)


def _in_order(scenarios: dict[str, Scenario]) -> list[str]:
    """Return the names: first one scenario of each set of parts, the large sets before, so that processes share the work.

    Processes that need the same kernel at the same time both compile it. So a set of estimators that is part of an earlier one comes later.
    """
    first: dict[str, tuple[tuple[object, ...], frozenset[str]]] = {}
    for name in sorted(scenarios, key=lambda name: -_size(scenarios[name])):
        scenario, kinds = scenarios[name], _kinds(scenarios[name])
        parts = (scenario.control.law, scenario.lateral.enabled, scenario.adaptation.method)
        if not any(parts == known and kinds <= more for known, more in first.values()):
            first[name] = parts, kinds
    return [*first, *(name for name in scenarios if name not in first)]


def _kinds(scenario: Scenario) -> frozenset[str]:
    return frozenset(estimator.kind for estimator in scenario.estimators)


def _size(scenario: Scenario) -> int:
    """Return about how much a scenario compiles: kinds of estimators; one of three surfaces is as large as two of one."""
    return len(_kinds(scenario)) + 2 * scenario.lateral.enabled


def _fly(name: str) -> None:
    run(load_scenario(name), rerun=False, report=False)
