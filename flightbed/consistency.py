"""How the keys of a scenario hang together: what contradicts, and what another key leaves without effect."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from flightbed.errors import did_you_mean

if TYPE_CHECKING:
    from flightbed.scenario import Scenario

_COMMAND_IDLE = {"none": ("amplitude_deg_s", "period_s", "count", "start_s"), "constant": ("period_s", "count")}
_FIXED_PRIOR = ("first_reading", "alpha_deg", "q_deg_s", "alpha_std_deg", "q_std_deg_s")
_KALMAN_ONLY = (
    "input", "input_at", "memory", "window", "alarm_threshold", "follow_disturbances", "hold_std", "alpha_disturbance_deg_s", "q_disturbance_deg_s2",
)  # fmt: skip


def contradictions(scenario: Scenario) -> list[str]:
    """Return what cannot be flown as it is written, one line each."""
    hz, ticks = scenario.rates.control_hz, scenario.ticks
    problems = []
    if abs(scenario.duration_s * hz - ticks) > 1e-6 or ticks < 1:
        problems.append(f"duration_s: must be a whole number of ticks of 1/{hz} s (got {scenario.duration_s:g})")
    for i, failure in enumerate(scenario.failures):
        if failure.at_s * hz > ticks - 1 + 1e-6:
            problems.append(
                f"failures.{i}.at_s: must be no later than the last tick, {(ticks - 1) / hz:g} s (got {failure.at_s:g})"
            )
    names = [estimator.name for estimator in scenario.estimators]
    for i, estimator in enumerate(scenario.estimators):
        if estimator.name in names[:i]:
            problems.append(f"estimators.{i}.name: must be unique (got '{estimator.name}' twice)")
        if estimator.kind == "loop-gain" and estimator.model == "scheduled" and estimator.input == "deviation":
            problems.append(
                f"estimators.{i}.input: must be 'absolute' with model = 'scheduled', which knows no trim (got 'deviation')"
            )
    control, adaptation = scenario.control, scenario.adaptation
    if control.state_from and control.state_from not in names:
        problems.append(_no_estimator("control.state_from", control.state_from, names))
    if control.gains is not None and control.poles is not None:
        problems.append("control.poles: cannot go with control.gains, which are not designed; give one of them")
    if adaptation.enabled and not adaptation.oracle and adaptation.estimator not in names:
        problems.append(_no_estimator("adaptation.estimator", adaptation.estimator, names))
    return problems


def _no_estimator(place: str, name: str, names: Sequence[str]) -> str:
    return f"{place}: no estimator is named '{name}'{did_you_mean(name, names)}; there is: {', '.join(names) or 'none'}"


def idle_keys(scenario: Scenario) -> dict[str, str]:
    """Return key -> the setting that leaves it without effect."""
    command, adaptation = scenario.command, scenario.adaptation
    keys = {f"command.{key}": f"command.kind = '{command.kind}'" for key in _COMMAND_IDLE.get(command.kind, ())}
    if scenario.control.gains is not None:
        keys["control.integral_pole_rad_s"] = "control.gains"
    if scenario.control.law == "proportional":
        keys |= {f"control.{key}": "control.law = 'proportional'" for key in ("integral_pole_rad_s", "gains.integral")}
    if not adaptation.enabled:
        idle = ("estimator", "floor", "feedback", "caution", "oracle", "limit_command")
        keys |= {f"adaptation.{key}": "adaptation.enabled = false" for key in idle}
    elif adaptation.oracle:
        keys |= {f"adaptation.{key}": "adaptation.oracle = true" for key in ("estimator", "caution")}
    for i, failure in enumerate(scenario.failures):
        if failure.kind != "ramp":
            keys[f"failures.{i}.over_s"] = f"failures.{i}.kind = '{failure.kind}'"
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
