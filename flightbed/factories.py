"""Factories from a scenario's settings to the objects of a flight, one per registered name; they convert the units."""

from __future__ import annotations

from flightbed.config import families
from flightbed.failures.base import HealthHistory, healthy
from flightbed.scenario.tables import Scenario


def health_history(scenario: Scenario) -> HealthHistory:
    """Return the health over time from all failures of a scenario, in order of time; of two at once, the later in the file acts."""
    health: HealthHistory = healthy
    for failure in sorted(scenario.failures, key=lambda f: f.at_s):
        health = families.factory("failures", failure.kind)(failure, health, scenario.rates.control_hz)
    return health
