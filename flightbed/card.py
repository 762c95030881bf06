"""The run card and the event log of a flight: what flew, what failed, what came of it, in words."""

from __future__ import annotations

from typing import Any

import numpy as np

from flightbed.aircraft import Actuator
from flightbed.scenario import Scenario
from flightbed.trace import Trace
from flightbed.units import DEG


def run_card(scenario: Scenario, summary: dict[str, Any]) -> str:
    """Return the run card, Markdown."""
    trim, condition = summary["trim"], scenario.condition
    estimators = "".join(
        f"| {name} | {_show(m['median_abs_error_post'], '.3f')} | {_show(m['rms_error_smoothed_post'], '.3f')} "
        f"| {_show(m['first_within_20pct_s'], '.2f')} | {_show(m['nis_mean'], '.2f')} |\n"
        for name, m in summary["estimators"].items()
    )
    failures = (
        "\n".join(f"- {f.at_s:g} s: {f.surface} keeps {f.to:.0%} of its effect" for f in scenario.failures) or "- none"
    )
    adapts = f"1/K from `{scenario.adaptation.estimator}`" if scenario.adaptation.enabled else "off"
    outcome = (
        f"**departed at {summary['departed_at_s']:.2f} s**"
        if summary["departed"]
        else f"flown to {summary['flown_s']:g} s"
    )
    return (
        f"# {scenario.name}\n\n{scenario.description}\n\n"
        f"**{scenario.aircraft.model}**, Mach {condition.mach:g}, {condition.altitude_ft:,.0f} ft, seed {scenario.seed}: {outcome}\n\n"
        f"- trim: alpha {trim['alpha_deg']:.3f} deg, elevator {trim['elevator_deg']:.3f} deg\n"
        f"- law: {scenario.control.law}; adaptation: {adapts}\n"
        f"- tracking RMS: {_show(summary['tracking_rms_pre_deg_s'], '.2f')} deg/s before, "
        f"{_show(summary['tracking_rms_post_deg_s'], '.2f')} deg/s after the failure\n\n"
        f"Failures\n{failures}\n\n"
        f"| estimator | median abs. error | smoothed RMS error "
        f"| within 20 % after, s | mean NIS (2) |\n|---|---|---|---|---|\n{estimators}\n"
        f"flightbed {summary['versions']['flightbed']}, JSBSim {summary['versions']['jsbsim']}\n"
    )


def events(
    scenario: Scenario, trace: Trace, summary: dict[str, Any], actuator: Actuator
) -> list[tuple[float, str, bool]]:
    """Return (time in s, text, severe) of what happened, in order of time."""
    happened = [
        (f.at_s, f"FAILURE: {f.surface} keeps {f.to:.0%} of its effect", True)
        for f in scenario.failures
        if f.at_s <= trace["t_s"][-1]
    ]
    failed_at = summary["failed_at_s"]
    for name, m in summary["estimators"].items():
        if m["first_within_20pct_s"] is not None:
            happened.append((failed_at + m["first_within_20pct_s"], f"K of '{name}' within 20 % of the truth", False))
    command = trace["elevator_cmd_deg"] * DEG
    at_stop = (command <= actuator.min_rad + 1e-9) | (command >= actuator.max_rad - 1e-9)
    rising = np.flatnonzero(at_stop & ~np.concatenate([[False], at_stop[:-1]]))
    happened += [(float(trace["t_s"][i]), "elevator command at its stop", False) for i in rising]
    if summary["departed"]:
        happened.append((summary["departed_at_s"], "DEPARTED: alpha more than 25 deg from trim", True))
    return sorted(happened)


def _show(value: float | None, spec: str) -> str:
    return "-" if value is None else format(value, spec)
