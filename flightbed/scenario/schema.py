"""JSON Schema of scenario files."""

from __future__ import annotations

from typing import Any

from flightbed.config.schema import schema_of
from flightbed.scenario.tables import Scenario

_DESCRIPTION = (
    "A scenario of flightbed: one flight. This schema does not state: names of estimators are unique, and control.state_from and "
    "adaptation.estimator name one of them; times lie within the flight, which lasts a whole number of control ticks; plant_hz is a "
    "multiple of control_hz; bounds rise, and poles lie in the left half plane; a pulse lasts at least one tick, and a band lies "
    "below half of control_hz; keys that a setting of another table leaves without effect, such as the sensors of roll and yaw without "
    "lateral.enabled, must be absent; failures of aileron and rudder need lateral.enabled; the aircraft must support every setting. "
    "`flightbed run` checks all of it."
)


def scenario_schema() -> dict[str, Any]:
    """Return the JSON Schema of a scenario file."""
    return schema_of(Scenario, "flightbed scenario", _DESCRIPTION)
