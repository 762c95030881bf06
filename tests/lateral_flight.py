"""A flight with roll and yaw of its own, in which aileron and rudder fail; what tests of its parts and its pictures fly."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from flightbed.scenario.reading import Scenario, load_scenario

ROLLING: dict[str, Any] = {
    "schema": 1,
    "name": "rolling",
    "description": "aileron and rudder weaken while all three axes are flown",
    "duration_s": 12.0,
    "lateral": {
        "enabled": True,
        "roll": {"kind": "doublet", "amplitude_deg_s": 20.0},
        "sideslip": {"kind": "doublet", "amplitude_deg": 2.0, "start_s": 1.0},
    },
    "failures": [
        {"kind": "effectiveness", "surface": "aileron", "at_s": 4.0, "to": 0.4},
        {"kind": "effectiveness", "surface": "rudder", "at_s": 6.0, "to": 0.5},
    ],
    "estimators": [
        {"name": "surfaces", "kind": "two-stage", "memory": "variable", "window": 3},
        {"name": "pitch"},
    ],
    "adaptation": {"enabled": True, "estimator": "surfaces"},
}
NAMES = ("surfaces", "surfaces.aileron", "surfaces.rudder", "pitch")
SOON = ["duration_s=3", "failures.0.at_s=1", "failures.1.at_s=1.5"]  # the same, in three seconds


def rolling(overrides: Sequence[str] = ()) -> Scenario:
    """Return the scenario of that flight."""
    return load_scenario(ROLLING, overrides)
