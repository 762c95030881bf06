"""What an update of each estimator costs, told the readings of one flight from Python."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial

from measuring import interleaved, seconds

from flightbed.assembly import assemble
from flightbed.estimation.base import Commanded
from flightbed.loop import fly, updater
from flightbed.plan import Plan, plan
from flightbed.settings import Scenario
from flightbed.signals import Sample


def costs_us(scenario: Scenario, rounds: int) -> dict[str, list[float]]:
    """Return microseconds of the processor per update of each estimator of a scenario, one value a round, by its name."""
    planned = plan(scenario)
    samples = list(fly(assemble(planned)))
    ways = {e.name: partial(_update_us, planned, i, samples) for i, e in enumerate(planned.scenario.estimators)}
    return interleaved(ways, rounds)


def _update_us(planned: Plan, index: int, samples: list[Sample]) -> float:
    """Return the time of an update; the estimator is made before, and is that of no flight."""
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
