"""Keys of a scenario that another key leaves without effect: whoever sets one on the command line is told."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from flightbed.scenario import Scenario

_COMMAND_IDLE = {"none": ("amplitude_deg_s", "period_s", "count", "start_s"), "constant": ("period_s", "count")}
_FIXED_PRIOR = ("alpha_deg", "q_deg_s", "alpha_std_deg", "q_std_deg_s")


def idle_keys(scenario: Scenario) -> dict[str, str]:
    """Return key -> the setting that leaves it without effect."""
    command, adaptation = scenario.command, scenario.adaptation
    keys = {f"command.{key}": f"command.kind = '{command.kind}'" for key in _COMMAND_IDLE.get(command.kind, ())}
    if scenario.control.law == "proportional":
        keys["control.integral_pole_rad_s"] = "control.law = 'proportional'"
    if not adaptation.enabled:
        keys |= {f"adaptation.{key}": "adaptation.enabled = false" for key in ("estimator", "floor", "feedback")}
    for i, estimator in enumerate(scenario.estimators):
        place = f"estimators.{i}"
        for key, memory in (("window", "window"), ("forgetting", "fading")):
            if estimator.memory != memory:
                keys[f"{place}.{key}"] = f"{place}.memory = '{estimator.memory}'"
        if estimator.prior.state == "measurement":
            keys |= {f"{place}.prior.{key}": f"{place}.prior.state = 'measurement'" for key in _FIXED_PRIOR}
    return keys
