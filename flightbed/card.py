"""The run card and the event log of a flight: what flew, what failed, what came of it, in words."""

from __future__ import annotations

from typing import Any

import numpy as np

from flightbed import registry
from flightbed.aircraft import Actuator
from flightbed.consistency import idle_keys
from flightbed.metrics import at_stop
from flightbed.pacing import Spell, late_spells
from flightbed.settings import Failure, GustSettings, Scenario
from flightbed.trace import Trace
from flightbed.units import unit_of

_MANY = 10  # spells of late ticks that the event log tells one by one


def run_card(scenario: Scenario, summary: dict[str, Any]) -> str:
    """Return the run card, Markdown."""
    trim, condition = summary["trim"], scenario.condition
    pace = f"- real time: {kept_pace(summary)}\n" if summary["realtime"] else ""
    estimators = "".join(
        f"| {name} | {_show(m['median_abs_error_post'], '.3f')} | {_show(m['rms_error_smoothed_post'], '.3f')} "
        f"| {_show(m['first_within_20pct_s'], '.2f')} | {_show(m['nis_mean'], '.2f')} | {_show(m['nis_expected'], 'g')} |\n"
        for name, m in summary["estimators"].items()
    )
    before, after = (_show(summary[f"tracking_rms_{when}_deg_s"], ".2f") for when in ("pre", "post"))
    tracking = f"{before} deg/s before, {after} deg/s from 0.3 s after the failure"
    own = "; ".join(f"{code['name']}, SHA-256 {(code['sha256'] or 'unknown')[:12]}" for code in summary["extensions"])
    own_line = f"- own code: {own}\n" if own else ""
    table = (
        f"| estimator | median abs. error | smoothed RMS error | first within 20 %, s | mean NIS | NIS if right |\n"
        f"|---|---|---|---|---|---|\n{estimators}\n"
    )
    return (
        f"# {scenario.name}\n\n{scenario.description}\n\n"
        f"**{scenario.aircraft.model}**, Mach {condition.mach:g}, {condition.altitude_ft:,.0f} ft, seed {scenario.seed}: "
        f"**{outcome(summary)}**\n\n"
        f"- trim: alpha {trim['alpha_deg']:.3f} deg, elevator {trim['elevator_deg']:.3f} deg\n"
        f"- law: {scenario.control.law}; {correction(scenario)}\n"
        f"- tracking RMS: {f'{before} deg/s' if summary['failed_at_s'] is None else tracking}\n{pace}"
        f"{_happening(scenario)}{own_line}\n"
        f"{table if estimators else ''}"
        f"flightbed {summary['versions']['flightbed']}, JSBSim {summary['versions']['jsbsim']}\n"
    )


def _happening(scenario: Scenario) -> str:
    """Return the lines of a card on what happens to the aircraft."""
    return (
        f"- failures: {'; '.join(failures(scenario)) or 'none'}\n"
        f"- air: turbulence {scenario.atmosphere.turbulence}; gusts {'; '.join(gusts(scenario)) or 'none'}\n"
    )


def plan_card(scenario: Scenario) -> str:
    """Return the card of a flight that has not been flown, Markdown."""
    condition = scenario.condition
    return (
        f"# {scenario.name}\n\n{scenario.description}\n\n"
        f"**{scenario.aircraft.model}**, Mach {condition.mach:g}, {condition.altitude_ft:,.0f} ft, seed {scenario.seed}: in flight\n\n"
        f"- law: {scenario.control.law}; {correction(scenario)}\n"
        f"{_happening(scenario)}"
    )


def flown(scenario: Scenario, aircraft: str) -> list[tuple[str, str]]:
    """Return in words what flew: (what, how) of aircraft, condition, command, law, sensors, air and seed.

    Args:
        scenario: what flew.
        aircraft: its name.

    """
    condition, sensors, rates, noise = scenario.condition, scenario.sensors, scenario.rates, scenario.process_noise
    shift = scenario.aircraft.cg_shift_cbar
    climb = f", flight path {condition.gamma_deg:+g} deg" if condition.gamma_deg else ""
    biases = {
        "alpha bias {:g} deg": sensors.alpha_bias_deg,
        "q bias {:g} deg/s": sensors.q_bias_deg_s,
        "Mach error {:.2%}": sensors.mach_error,
    }
    late = f", commands {rates.delay_ticks} ticks late" if rates.delay_ticks else ""
    unknown = {k: v for k, v in scenario.model_error.model_dump().items() if v != (1.0 if k.startswith("cm_") else 0.0)}
    rows = [
        ("aircraft", aircraft + (f", c.g. {shift:+.1%} of the chord, aft positive" if shift else "")),
        ("condition", f"Mach {condition.mach:g}, {condition.altitude_ft:,.0f} ft{climb}"),
        ("command", command(scenario)),
        ("law", f"{scenario.control.law}, {correction(scenario)}"),
        ("rates", f"control {rates.control_hz} Hz, plant {rates.plant_hz} Hz{late}"),
        ("sensors", "; ".join([
            f"white noise of alpha {sensors.alpha_std_deg:g} deg, of q {sensors.q_std_deg_s:g} deg/s",
            *(text.format(value) for text, value in biases.items() if value),
        ])),
        ("air", f"turbulence {scenario.atmosphere.turbulence}; gusts {'; '.join(gusts(scenario)) or 'none'}"),
        ("failures", "; ".join(failures(scenario)) or "none"),
        ("seed", str(scenario.seed)),
    ]  # fmt: skip
    if noise.alpha_std_deg_s or noise.q_std_deg_s2:
        rows.append(("process noise", f"{noise.alpha_std_deg_s:g} deg/s, {noise.q_std_deg_s2:g} deg/s^2"))
    if unknown:
        rows.append(("unknown on board", ", ".join(f"{key} {value:g}" for key, value in unknown.items())))
    return rows


def command(scenario: Scenario) -> str:
    """Return in words what the pilot asks for: the kind and every key that it uses, of code outside flightbed every key that is set."""
    idle, asked = idle_keys(scenario), scenario.command
    used = asked.model_dump(exclude={"kind", "filter_rad_s", "options"})
    if registry.is_built_in("commands", asked.kind):
        used = {k: v for k, v in used.items() if f"command.{k}" not in idle}
    else:
        used = {k: v for k, v in used.items() if k in asked.model_fields_set} | dict(asked.options)
    suffixes = {"deg/s": "_deg_s", "s": "_s", "Hz": "_hz"}
    words = [asked.kind]
    for key, value in used.items():
        unit = unit_of(key) if unit_of(key) in suffixes else ""
        shown = f"{value:g}" if isinstance(value, float) else str(value)
        words.append(f"{key.removesuffix(suffixes.get(unit, '')).replace('_', ' ')} {shown} {unit}".strip())
    return f"{', '.join(words)}; prefilter {asked.filter_rad_s:g} rad/s"


def correction(scenario: Scenario) -> str:
    """Return in words what corrects the law."""
    adaptation = scenario.adaptation
    if not adaptation.enabled:
        return "not corrected"
    return "corrected by 1/K of " + ("the oracle" if adaptation.oracle else f"'{adaptation.estimator}'")


def outcome(summary: dict[str, Any]) -> str:
    """Return in words how a flight ended."""
    failed = summary["failed_at_s"]
    ended = summary["departed_at_s"] if summary["departed"] else summary["flown_s"]
    after = "" if failed is None else f", {ended - failed:.2f} s after the failure"
    if summary["departed"]:
        return f"departed at {ended:.2f} s{after}"
    if summary["ended"] == "ground":
        return f"hit the ground at {ended:.2f} s{after}"
    return f"flown to {summary['flown_s']:g} s"


def kept_pace(summary: dict[str, Any]) -> str:
    """Return in words how well a paced flight kept pace."""
    kept, control_hz = summary["realtime"], summary["realtime"]["ticks"] / summary["flown_s"]
    jitter, compute = ({name: _ms(value) for name, value in kept[key].items()} for key in ("jitter_ms", "compute_ms"))
    late = f" ({kept['late_share']:.2%}), worst by {_ms(kept['worst_overrun_ms'])} ms" if kept["late_ticks"] else ""
    return (
        f"{kept['ticks']} ticks at {control_hz:g} Hz: {kept['late_ticks']} late{late}; "
        f"jitter p95 {jitter['p95']}, max {jitter['max']} ms; compute p50 {compute['p50']}, p99 {compute['p99']} ms"
    )


def failures(scenario: Scenario) -> list[str]:
    """Return the failures of a scenario in words."""
    return [f"at {f.at_s:g} s {_happens(f)}" for f in scenario.failures]


def gusts(scenario: Scenario) -> list[str]:
    """Return the gusts of a scenario in words."""
    return [f"at {g.at_s:g} s {_blows(g)}" for g in scenario.gusts]


def _happens(failure: Failure) -> str:
    if failure.kind == "ramp":
        return f"the {failure.surface} begins to go to {failure.to:.0%} of its effect, over {failure.over_s:g} s"
    if failure.kind == "structural":
        return f"the {failure.surface} keeps {failure.to:.0%} of its moment and {failure.force_to:.0%} of its lift and drag"
    if failure.kind == "cg-shift":
        where = "aft" if failure.shift_cbar >= 0.0 else "ahead"
        return f"the c.g. moves to {abs(failure.shift_cbar):.1%} of the chord {where} of where it was at take-off"
    return f"the {failure.surface} keeps {failure.to:.0%} of its effect"


def _blows(gust: GustSettings) -> str:
    rising = f"rising for {gust.rise_s:g} s" + (f", held for {gust.hold_s:g} s" if gust.hold_s else "")
    return f"a gust of {abs(gust.up_fps):g} ft/s {'up' if gust.up_fps >= 0.0 else 'down'}, {rising}"


def planned_events(scenario: Scenario) -> list[tuple[float, str, bool]]:
    """Return (time in s, text, severe) of what the scenario says will happen, in order of time."""
    planned = [(f.at_s, f"FAILURE: {_happens(f)}", True) for f in scenario.failures]
    return sorted(planned + [(g.at_s, f"gust: {_blows(g)}", False) for g in scenario.gusts])


def seen_events(trace: Trace, actuator: Actuator, *, since: int = 0) -> list[tuple[float, str, bool]]:
    """Return (time in s, text, severe) of what a trace shows from index ``since`` on: declared changes, stops reached."""
    seen = []
    for name in trace.estimators:
        alarms = trace[f"{name}.alarms"]
        seen += [
            (int(i), f"'{name}' declares a change of K, to {trace[f'{name}.effectiveness'][i]:.2f}")
            for i in np.flatnonzero(np.diff(alarms, prepend=0.0) > 0.0)
        ]
    cut = at_stop(trace, actuator)
    rising = np.flatnonzero(cut & ~np.concatenate([[False], cut[:-1]]))
    seen += [(int(i), "elevator command at its stop") for i in rising]
    return [(float(trace["t_s"][i]), text, False) for i, text in seen if i >= since]


def events(
    scenario: Scenario, trace: Trace, summary: dict[str, Any], actuator: Actuator
) -> list[tuple[float, str, bool]]:
    """Return (time in s, text, severe) of what happened, in order of time."""
    happened = [event for event in planned_events(scenario) if event[0] <= trace["t_s"][-1]]
    happened += seen_events(trace, actuator)
    since = summary["estimators_since_s"]
    for name, m in summary["estimators"].items():
        if m["first_within_20pct_s"] is not None:
            happened.append((since + m["first_within_20pct_s"], f"K of '{name}' within 20 % of the truth", False))
    happened += _late(late_spells(trace))
    if summary["ended"] == "ground":
        happened.append((summary["flown_s"], "HIT THE GROUND", True))
    if summary["departed"]:
        happened.append((summary["departed_at_s"], "DEPARTED: alpha more than 25 deg from trim", True))
    return sorted(happened)


def _late(spells: list[Spell]) -> list[tuple[float, str, bool]]:
    """Return the late ticks as events: one a spell, or, of many spells, a single one at the worst."""
    if len(spells) <= _MANY:
        return [
            (spell.t_s, f"{spell.ticks} {'tick' if spell.ticks == 1 else 'ticks'} late, by up to {_ms(spell.worst_overrun_ms)} ms", False)
            for spell in spells
        ]  # fmt: skip
    ticks, worst = sum(spell.ticks for spell in spells), max(spells, key=lambda spell: spell.worst_overrun_ms)
    text = f"{ticks} ticks late in {len(spells)} spells, here the worst, by {_ms(worst.worst_overrun_ms)} ms"
    return [(worst.t_s, text, False)]


def _ms(value: float) -> str:
    return "0" if value < 0.005 else f"{value:.2g}" if value < 10.0 else f"{value:.0f}"


def _show(value: float | None, spec: str) -> str:
    return "-" if value is None else format(value, spec)
