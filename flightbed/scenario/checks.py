"""Checks between the keys of a scenario: conflicts, and keys without effect under another setting."""

from __future__ import annotations

from flightbed.config import families
from flightbed.config.kinds import (
    LAWS,
    LawSettings,
)
from flightbed.core.errors import did_you_mean
from flightbed.scenario.estimates import detectors
from flightbed.scenario.tables import Scenario


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
