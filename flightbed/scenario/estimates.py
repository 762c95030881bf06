"""Names of the estimates of a scenario, and of those with a test for a change."""

from __future__ import annotations

from collections.abc import Iterable

from flightbed.config.kinds import EstimatorSettings
from flightbed.core.estimate_names import estimate_name
from flightbed.scenario.tables import Scenario


def estimates(scenario: Scenario) -> tuple[str, ...]:
    """Return the names of a flight's estimates, in order (``core/estimate_names.py``)."""
    return _names(scenario.estimators, lateral=scenario.lateral.enabled)


def detectors(scenario: Scenario) -> tuple[str, ...]:
    """Return the names of the estimates with a change test; external estimators are not listed, their alarms are known only in flight."""
    return _names((e for e in scenario.estimators if e.detects_changes), lateral=scenario.lateral.enabled)


def _names(estimators: Iterable[EstimatorSettings], *, lateral: bool) -> tuple[str, ...]:
    return tuple(estimate_name(e.name, surface) for e in estimators for surface in e.estimates(lateral=lateral))
