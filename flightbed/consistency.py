"""How the keys of a scenario hang together: what contradicts, and what another key leaves without effect."""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING

from flightbed.errors import did_you_mean

if TYPE_CHECKING:
    from flightbed.scenario import Scenario

_COMMAND_IDLE = {"none": ("amplitude_deg_s", "period_s", "count", "start_s"), "constant": ("period_s", "count")}
# What a kind of failure needs besides its time, and what it has no use for. Kinds of installed packages may use any key.
_FAILURE_NEEDS = MappingProxyType(
    {"effectiveness": ("to",), "ramp": ("to",), "structural": ("to", "force_to"), "cg-shift": ("shift_cbar",)}
)
_FAILURE_IDLE = MappingProxyType(
    {
        "effectiveness": ("force_to", "over_s", "shift_cbar"),
        "ramp": ("force_to", "shift_cbar"),
        "structural": ("over_s", "shift_cbar"),
        "cg-shift": ("surface", "to", "force_to", "over_s"),
    }
)
_FIXED_PRIOR = ("alpha_deg", "q_deg_s", "alpha_std_deg", "q_std_deg_s")
_KALMAN_ONLY = (
    "input", "memory", "window", "alarm_threshold", "follow_disturbances", "hold_std", "alpha_disturbance_deg_s", "q_disturbance_deg_s2",
)  # fmt: skip


def contradictions(scenario: Scenario) -> list[str]:
    """Return what cannot be flown as it is written, one line each."""
    hz, ticks = scenario.rates.control_hz, scenario.ticks
    problems = []
    if abs(scenario.duration_s * hz - ticks) > 1e-6 or ticks < 1:
        problems.append(f"duration_s: must be a whole number of ticks of 1/{hz} s (got {scenario.duration_s:g})")
    times = {f"failures.{i}.at_s": failure.at_s for i, failure in enumerate(scenario.failures)}
    times |= {f"gusts.{i}.at_s": gust.at_s for i, gust in enumerate(scenario.gusts)}
    problems += [
        f"{key}: must be no later than the last tick, {(ticks - 1) / hz:g} s (got {at_s:g})"
        for key, at_s in times.items()
        if at_s * hz > ticks - 1 + 1e-6
    ]
    for i, failure in enumerate(scenario.failures):
        problems += [
            f"failures.{i}.{key}: is missing; a failure of kind '{failure.kind}' needs it"
            for key in _FAILURE_NEEDS.get(failure.kind, ())
            if key not in failure.model_fields_set
        ]
    names = [estimator.name for estimator in scenario.estimators]
    for i, estimator in enumerate(scenario.estimators):
        if estimator.name in names[:i]:
            problems.append(f"estimators.{i}.name: must be unique (got '{estimator.name}' twice)")
        if estimator.kind == "loop-gain" and estimator.model == "scheduled" and estimator.input == "deviation":
            problems.append(
                f"estimators.{i}.input: must be 'absolute' with model = 'scheduled', which knows no trim (got 'deviation')"
            )
    adaptation = scenario.adaptation
    if adaptation.enabled and not adaptation.oracle and adaptation.estimator not in names:
        problems.append(
            f"adaptation.estimator: no estimator is named '{adaptation.estimator}'"
            f"{did_you_mean(adaptation.estimator, names)}; there is: {', '.join(names) or 'none'}"
        )
    return problems


def idle_keys(scenario: Scenario) -> dict[str, str]:
    """Return key -> the setting that leaves it without effect."""
    command, adaptation = scenario.command, scenario.adaptation
    keys = {f"command.{key}": f"command.kind = '{command.kind}'" for key in _COMMAND_IDLE.get(command.kind, ())}
    if scenario.control.law == "proportional":
        keys["control.integral_pole_rad_s"] = "control.law = 'proportional'"
    if not adaptation.enabled:
        idle = ("estimator", "floor", "feedback", "caution", "oracle", "limit_command")
        keys |= {f"adaptation.{key}": "adaptation.enabled = false" for key in idle}
    elif adaptation.oracle:
        keys |= {f"adaptation.{key}": "adaptation.oracle = true" for key in ("estimator", "caution")}
    for i, failure in enumerate(scenario.failures):
        useless = _FAILURE_IDLE.get(failure.kind, ())
        keys |= {f"failures.{i}.{key}": f"failures.{i}.kind = '{failure.kind}'" for key in useless}
    for i, estimator in enumerate(scenario.estimators):
        place = f"estimators.{i}"
        if estimator.kind == "differentiated-rls":
            prior = ("prior.state", *(f"prior.{key}" for key in _FIXED_PRIOR))
            keys |= {f"{place}.{key}": f"{place}.kind = 'differentiated-rls'" for key in (*_KALMAN_ONLY, *prior)}
            continue
        for key, memory in (("window", "window"), ("alarm_threshold", "window"), ("forgetting", "fading")):
            if estimator.memory != memory:
                keys[f"{place}.{key}"] = f"{place}.memory = '{estimator.memory}'"
        if estimator.prior.state == "measurement":
            keys |= {f"{place}.prior.{key}": f"{place}.prior.state = 'measurement'" for key in _FIXED_PRIOR}
    return keys
