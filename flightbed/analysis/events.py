"""Event log of a flight: failures, gusts, alarms, stops, late ticks and the end, each with its time, as text."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from flightbed.analysis.metrics import at_stop, since_s
from flightbed.analysis.punctuality import Spell, late_spells
from flightbed.analysis.summary import RunSummary
from flightbed.analysis.trace import Trace, true_share
from flightbed.core.actuator import Actuator
from flightbed.core.units import DEG
from flightbed.estimation.reconstruction.regression_kernels import ACTUATOR
from flightbed.flight.ending import DEPARTURE_RAD
from flightbed.scenario.tables import Scenario

_MANY = 10  # most spells of late ticks that the event log lists separately


def failures(scenario: Scenario) -> list[str]:
    """Return the failures of a scenario in words."""
    return [f"at {f.at_s:g} s {f.in_words()}" for f in scenario.failures]


def gusts(scenario: Scenario) -> list[str]:
    """Return the gusts of a scenario in words."""
    return [f"at {g.at_s:g} s {g.in_words()}" for g in scenario.gusts]


def planned_events(scenario: Scenario) -> list[tuple[float, str, bool]]:
    """Return (time in s, text, severe) of the scenario's failures and gusts, in order of time."""
    planned = [(f.at_s, f"FAILURE: {f.in_words()}", True) for f in scenario.failures]
    return sorted(planned + [(g.at_s, f"gust: {g.in_words()}", False) for g in scenario.gusts])


def trace_events(trace: Trace, actuators: Mapping[str, Actuator], *, since: int = 0) -> list[tuple[float, str, bool]]:
    """Return (time in s, text, severe) of the alarms and the commands at a stop in a trace, from index ``since`` on.

    Args:
        trace: the flight, or a part of it.
        actuators: surface -> actuator, of the commanded surfaces.
        since: index of the first row.

    """
    seen = []
    for name in trace.estimators:
        alarms = trace[f"{name}.alarms"]
        seen += [
            (int(i), f"'{name}' {_verdict_text(trace, name, int(i))}")
            for i in np.flatnonzero(np.diff(alarms, prepend=0.0) > 0.0)
        ]
    for surface, actuator in actuators.items():
        cut = at_stop(trace, actuator, surface)
        rising = np.flatnonzero(cut & ~np.concatenate([[False], cut[:-1]]))
        seen += [(int(i), f"{surface} command at its stop") for i in rising]
    return [(float(trace["t_s"][i]), text, False) for i, text in seen if i >= since]


def _verdict_text(trace: Trace, name: str, tick: int) -> str:
    """Return the verdict of an alarm at a tick, in words."""
    if f"{name}.verdict" not in trace.columns:
        return f"declares a change of K to {trace[f'{name}.effectiveness'][tick]:.2f}"
    if trace[f"{name}.verdict"][tick] == ACTUATOR:
        return "finds that the elevator does not follow its command"
    return f"finds a deflection that no K explains: {trace[f'{name}.offset_deg'][tick]:+.1f} deg beside the measured position"


def events(
    scenario: Scenario, trace: Trace, summary: RunSummary, actuators: Mapping[str, Actuator]
) -> list[tuple[float, str, bool]]:
    """Return (time in s, text, severe) of all events of a flight, in order of time.

    Args:
        scenario: the settings.
        trace, summary: the flight.
        actuators: surface -> actuator, of the commanded surfaces.

    """
    happened = [event for event in planned_events(scenario) if event[0] <= trace["t_s"][-1]]
    happened += trace_events(trace, actuators)
    changed = {name for name in trace.estimators if np.any(trace[true_share(name)] != 1.0)}
    # With three surfaces only the estimates of a changed K have an event of their own.
    listed = set(trace.estimators) if len(actuators) == 1 else changed
    for name, m in summary.metrics.estimators.items():
        since = since_s(trace, name, summary.failed_at_s)
        if since is not None and m.first_within_20pct_s is not None and name in listed:
            happened.append((since + m.first_within_20pct_s, f"K of '{name}' within 20 % of the truth", False))
    happened += _late_events(late_spells(trace))
    if summary.ended == "ground":
        happened.append((summary.flown_s, "HIT THE GROUND", True))
    if summary.metrics.departed:
        happened.append((summary.ended_s, f"DEPARTED: {departure_reason(trace)}", True))
    return sorted(happened)


def departure_reason(trace: Trace) -> str:
    """Return the criterion that a departed flight violated, in words."""
    if "beta_deg" in trace.columns and not abs(trace["beta_deg"][-1]) * DEG <= DEPARTURE_RAD:
        return f"sideslip more than {DEPARTURE_RAD / DEG:g} deg"
    return f"alpha more than {DEPARTURE_RAD / DEG:g} deg from trim"


def _late_events(spells: list[Spell]) -> list[tuple[float, str, bool]]:
    """Return the late ticks as events: one per spell, or, for many spells, a single one at the worst."""
    if len(spells) <= _MANY:
        return [
            (spell.t_s, f"{spell.ticks} tick{'s'[: spell.ticks > 1]} late, by up to {milliseconds(spell.worst_overrun_ms)} ms", False)
            for spell in spells
        ]  # fmt: skip
    ticks, worst = sum(spell.ticks for spell in spells), max(spells, key=lambda spell: spell.worst_overrun_ms)
    text = f"{ticks} ticks late in {len(spells)} spells, here the worst, by {milliseconds(worst.worst_overrun_ms)} ms"
    return [(worst.t_s, text, False)]


def milliseconds(value: float) -> str:
    """Return a time in ms as text, with two digits or whole."""
    return "0" if value < 0.005 else f"{value:.2g}" if value < 10.0 else f"{value:.0f}"
