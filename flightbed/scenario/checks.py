"""Checks between the keys of a scenario: conflicts, and keys without effect under another setting."""

from __future__ import annotations

from flightbed.config import families
from flightbed.config.kinds import (
    LAWS,
    Command,
    LawSettings,
    RollCommand,
    SideslipCommand,
)
from flightbed.core.errors import did_you_mean
from flightbed.core.harmonics import MOST_HARMONICS, harmonics
from flightbed.scenario.estimates import detectors
from flightbed.scenario.tables import Scenario

_PULSES = {"amplitude_deg_s", "start_s", "period_s", "count"}
_BAND = _PULSES | {"low_hz", "high_hz"}
_BINARY = {"switch_s", "register_bits", "seed"}
_COMMAND_KEYS = _BAND | _BINARY  # keys that some kinds do not use
_COMMAND_USES = {
    "none": set[str](),
    "constant": {"amplitude_deg_s", "start_s"},
    "pulse": {"amplitude_deg_s", "start_s", "period_s"},
    "doublet": _PULSES,
    "3-2-1-1": _PULSES,
    "chirp": _BAND,
    "multisine": _BAND,
    "dither": _BAND - {"count"},
    "random": _PULSES - {"period_s"} | _BINARY,
}


def conflicts(scenario: Scenario) -> list[str]:
    """Return the conflicts between keys of a scenario, one message per line: "place: problem (got value); cure"."""
    hz, ticks = scenario.rates.control_hz, scenario.ticks
    problems = []
    if abs(scenario.duration_s * hz - ticks) > 1e-6 or ticks < 1:
        problems.append(f"duration_s: must be a whole number of ticks of 1/{hz} s (got {scenario.duration_s:g})")
    times = {f"failures.{i}.at_s": failure.at_s for i, failure in enumerate(scenario.failures)}
    times |= {f"gusts.{i}.at_s": gust.at_s for i, gust in enumerate(scenario.gusts)}
    times |= {f"control.{key}": at_s for key, at_s in scenario.control.times.items()}
    problems += [
        f"{key}: must be no later than the last tick, {(ticks - 1) / hz:g} s (got {at_s:g})"
        for key, at_s in times.items()
        if at_s * hz > ticks - 1 + 1e-6
    ]
    for place, kind in scenario.kinds():
        problems += kind.conflicts(place, scenario.surroundings)
    problems += _command_conflicts(scenario.command, hz)
    if scenario.lateral.enabled:
        problems += _command_conflicts(scenario.lateral.roll, hz, "lateral.roll")
        problems += _command_conflicts(scenario.lateral.sideslip, hz, "lateral.sideslip")
    names = [estimator.name for estimator in scenario.estimators]
    problems += [
        f"estimators.{i}.name: must be unique (got '{name}' twice)" for i, name in enumerate(names) if name in names[:i]
    ]
    problems += references(scenario).values()
    control = scenario.control
    problems += _redesign_conflicts(scenario)
    if control.identifies and scenario.adaptation.enabled:
        problems.append(
            f"adaptation.enabled: must be false with control.law = '{control.law}', which identifies its own model (got true)"
        )
    problems += _options_of_built_ins(scenario)
    problems += _correction_conflicts(scenario)
    return problems


def references(scenario: Scenario) -> dict[str, str]:
    """Return key -> its problem, for keys that name an estimator which does not exist, even where the key has no effect."""
    adaptation, names = scenario.adaptation, [estimator.name for estimator in scenario.estimators]
    named = {"control.state_from": scenario.control.state_from, "adaptation.estimator": adaptation.estimator}
    corrected = adaptation.enabled and not adaptation.oracle
    return {
        key: f"{key}: no estimator is named '{name}'{did_you_mean(name, names)}; known: {', '.join(names) or 'none'}"
        for key, name in named.items()
        if name not in names and (name or (key == "adaptation.estimator" and corrected))
    }


def _correction_conflicts(scenario: Scenario) -> list[str]:
    adaptation, estimators = scenario.adaptation, {e.name: e for e in scenario.estimators}
    if not adaptation.enabled or adaptation.oracle or adaptation.estimator not in estimators:
        return []
    if not estimators[adaptation.estimator].corrects:
        return [
            f"adaptation.estimator: must estimate the elevator's effectiveness (got '{adaptation.estimator}', which does not)"
        ]
    return []


def _redesign_conflicts(scenario: Scenario) -> list[str]:
    adaptation, problems = scenario.adaptation, []
    if not (adaptation.enabled and adaptation.method == "redesign"):
        return []
    if not scenario.control.can_redesign:
        laws = {name: LAWS.of(name) for name in families.built_in("laws")}
        able = " or ".join(f"'{n}'" for n, law in laws.items() if issubclass(law, LawSettings) and law.can_redesign)
        problems.append(
            f"control.law: must be {able} with adaptation.method = 'redesign', which redesigns it (got '{scenario.control.law}')"
        )
    if adaptation.oracle:
        problems.append(
            "adaptation.oracle: cannot be combined with method = 'redesign', which waits for an estimator's alarm; set one of them"
        )
    elif adaptation.estimator in [e.name for e in scenario.estimators] and adaptation.estimator not in detectors(
        scenario
    ):
        problems.append(
            f"adaptation.estimator: must raise alarms with method = 'redesign' (got '{adaptation.estimator}', which has no alarm test)"
        )
    return problems


def _options_of_built_ins(scenario: Scenario) -> list[str]:
    tables = [
        ("command", "commands", "kind", scenario.command.kind, scenario.command.options),
        ("lateral.roll", "commands", "kind", scenario.lateral.roll.kind, scenario.lateral.roll.options),
        ("lateral.sideslip", "commands", "kind", scenario.lateral.sideslip.kind, scenario.lateral.sideslip.options),
    ]
    return [
        f"{place}.options: {key} '{name}' takes no options (got {', '.join(options)}); only external code has them"
        for place, family, key, name, options in tables
        if options and families.is_built_in(family, name)
    ]


def _command_conflicts(command: Command | RollCommand | SideslipCommand, hz: int, place: str = "command") -> list[str]:
    kind = command.kind
    shortest = {"doublet": ("period_s", 2), "3-2-1-1": ("period_s", 7), "random": ("switch_s", 1)}
    if kind in shortest:
        key, parts = shortest[kind]
        value: float = getattr(command, key)
        if value * hz < parts - 1e-6:
            return [
                f"{place}.{key}: must be at least {parts / hz:g}, so that each pulse lasts at least one tick (got {value:g})"
            ]
    if kind not in ("chirp", "multisine", "dither"):
        return []
    problems = []
    if command.high_hz >= 0.5 * hz:
        problems.append(
            f"{place}.high_hz: must be below {0.5 * hz:g}, half of rates.control_hz (got {command.high_hz:g})"
        )
    if command.low_hz > command.high_hz:
        problems.append(
            f"{place}.low_hz: must be no higher than high_hz = {command.high_hz:g} (got {command.low_hz:g})"
        )
    elif kind != "chirp":
        found = len(harmonics(low_hz=command.low_hz, high_hz=command.high_hz, period_s=command.period_s))
        if not 1 <= found <= MOST_HARMONICS:
            cure = "widen the band or lengthen the period" if found == 0 else "narrow the band or shorten the period"
            problems.append(
                f"{place}.period_s: the band from low_hz to high_hz must hold 1 to {MOST_HARMONICS} multiples of 1/period_s "
                f"(got {found}); {cure}"
            )
    return problems


def _unused_in_command(place: str, command: Command | RollCommand | SideslipCommand) -> dict[str, str]:
    unused = _COMMAND_KEYS - _COMMAND_USES.get(command.kind, _COMMAND_KEYS)
    if "amplitude_deg" in type(command).model_fields:
        unused = {"amplitude_deg" if key == "amplitude_deg_s" else key for key in unused}
    elif "amplitude_deg_s" in unused:
        unused = unused | {"amplitude_g"}
    return {f"{place}.{key}": f"{place}.kind = '{command.kind}'" for key in unused}
