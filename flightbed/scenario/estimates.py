"""Names of the estimates of a scenario, and of those with a test for a change."""

from __future__ import annotations

from flightbed.config.kinds import EstimatorSettings
from flightbed.core.estimate_names import estimate_name
from flightbed.core.signals import SURFACES
from flightbed.scenario.tables import Scenario


def estimates(scenario: Scenario) -> tuple[str, ...]:
    """Return the names of a flight's estimates, in order (``core/estimate_names.py``)."""
    return tuple(name for e in scenario.estimators for name in _estimates_of(e, lateral=scenario.lateral.enabled))


def _estimates_of(estimator: EstimatorSettings, *, lateral: bool) -> list[str]:
    surfaces = SURFACES if lateral and estimator.kind == "two-stage" else SURFACES[:1]
    return [estimate_name(estimator.name, surface) for surface in surfaces]


def detectors(scenario: Scenario) -> tuple[str, ...]:
    """Return the names of the estimates with a change test; external estimators are not listed, their alarms are known only in flight."""
    return tuple(
        name
        for e in scenario.estimators
        if e.kind == "two-stage" or (e.kind == "loop-gain" and e.memory == "window" and e.alarm_threshold > 0.0)
        for name in _estimates_of(e, lateral=scenario.lateral.enabled)
    )
