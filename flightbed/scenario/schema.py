"""JSON Schema of scenario files."""

from __future__ import annotations

from typing import Any

from flightbed.config.schema import schema_of
from flightbed.scenario.tables import Scenario

_DESCRIPTION = (
    "A scenario of flightbed: one flight. This schema does not state: a kind that it does not list is an installed kind or own code; names "
    "of estimators are unique, and control.state_from and adaptation.estimator name one of them; times lie within the flight, which lasts "
    "a whole number of control ticks; plant_hz is a multiple of control_hz; bounds rise, and of two limits the lower one is below the "
    "higher one; poles lie in the left half plane, in conjugate pairs, three of a law in g, and without gains; a pulse lasts at least one "
    "tick, a frequency lies below half of control_hz, and a band holds 1 to 100 multiples of 1/period_s; input = 'deviation' needs "
    "model = 'short-period'; lateral.enabled needs the scheduled model of 'two-stage'; adaptation needs an estimator of the elevator's K "
    "and a law that does not identify its own model; method = 'redesign' needs the law 'lq' and an estimator with alarms, without oracle; "
    "failures of aileron and rudder need lateral.enabled; keys that a setting of another table leaves without effect, such as the sensors "
    "of roll and yaw without lateral.enabled, must be absent; numbers are finite, and whole numbers have no decimal point; the aircraft "
    "must support every setting. `flightbed run` checks all of it."
)


def scenario_schema() -> dict[str, Any]:
    """Return the JSON Schema of a scenario file."""
    return schema_of(Scenario, "flightbed scenario", _DESCRIPTION)
