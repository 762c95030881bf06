"""Processor time of one update of each estimator, called from Python with the readings of one flight."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial

from flightbed.config.own_code import Extension, Packed, permit_packed
from flightbed.core.signals import Sample
from flightbed.core.timing import interleaved, seconds
from flightbed.estimation.base import Commanded
from flightbed.flight.assembly import assemble
from flightbed.flight.composed import updater
from flightbed.flight.loop import fly
from flightbed.flight.plan import Plan, plan
from flightbed.scenario.tables import Scenario


def costs_us(scenario: Scenario, rounds: int) -> dict[str, list[float]]:
    """Return the processor time per update of each estimator of a scenario, us, one value per round, by name."""
    return interleaved(_ways(scenario), rounds)


def round_us(number: int, scenario: Scenario, extensions: tuple[Extension | Packed, ...]) -> dict[str, float]:
    """Return the processor time per update of each estimator of a scenario in one round, us, by name.

    One round of ``costs_us``, as a trial that any process can run; a round without timing goes before it.

    Args:
        number: of the round; odd rounds take the estimators in reverse order.
        scenario: a scenario with all of them.
        extensions: code of the user's own that the scenario names.

    """
    with permit_packed(extensions):
        ways = _ways(scenario)
        ordered = dict(list(ways.items())[:: -1 if number % 2 else 1])
        return {name: figures[0] for name, figures in interleaved(ordered, 1).items()}


def _ways(scenario: Scenario) -> dict[str, Callable[[], float]]:
    planned = plan(scenario)
    samples = list(fly(assemble(planned)))
    return {e.name: partial(_update_us, planned, i, samples) for i, e in enumerate(planned.scenario.estimators)}


def _update_us(planned: Plan, index: int, samples: list[Sample]) -> float:
    """Return the time of one update, us; of a new estimator, built before the time is taken."""
    estimator = assemble(planned).estimators[index]
    update: Callable[..., object] = updater(estimator)
    hears: Callable[[float], object] | None = estimator.commanded if isinstance(estimator, Commanded) else None
    given = [(s.measurement, s.lateral and s.lateral.measurement, s.elevator_cmd_rad) for s in samples]

    def feed() -> None:
        for pitch, lateral, command in given:
            update(pitch, lateral)
            if hears is not None:
                hears(command)

    return 1e6 * seconds(feed, clock=time.thread_time) / len(samples)
