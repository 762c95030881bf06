"""Checks between the keys of a scenario: conflicts, and keys without effect under another setting."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType

from flightbed.config import families
from flightbed.config.kinds import (
    LOAD_FACTOR_LAWS,
    EstimatorSettings,
    Kind,
    Surroundings,
)
from flightbed.config.table import idle_keys, keys_of
from flightbed.core.errors import did_you_mean
from flightbed.scenario import reconstruction_checks
from flightbed.scenario.estimates import detectors
from flightbed.scenario.tables import Scenario

_FIXED_PRIOR = ("first_reading", "alpha_deg", "q_deg_s", "alpha_std_deg", "q_std_deg_s")
_LATERAL_SENSORS = ("beta_std_deg", "p_std_deg_s", "r_std_deg_s", "aileron_std_deg", "rudder_std_deg")
# Keys of the law nz-adaptive alone, and of flights commanded in g alone.
_IDENTIFICATION = (
    "prior", "prior_var", "process_var", "output_var", "block_fade", "form", "precision", "patience", "gain_filter_rad_s",
    "command_filter_rad_s",
)  # fmt: skip
_AUTOTHROTTLE = ("low_norm", "high_norm", "then_fps", "then_at_s")
_PLID_ONLY = ("block_fade", "form", "precision")
_WEIGHTS = ("alpha_deg", "q_deg_s", "elevator_deg")
_LATERAL_DISTURBANCES = ("beta_disturbance_deg_s", "p_disturbance_deg_s2", "r_disturbance_deg_s2")
_LOOP_GAIN_ONLY = ("input", "input_at", "alarm_threshold", "follow_disturbances", "hold_std")
_TWO_STAGE_ONLY = (*_LATERAL_DISTURBANCES, "variance_min", "variance_max", "walk_std", "false_alarm")
_PRIOR = ("prior.state", *(f"prior.{key}" for key in _FIXED_PRIOR))
# Keys that a kind of estimator never uses, whatever its other settings; kinds of installed packages may use any key.
_UNUSED_BY_ESTIMATOR: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "loop-gain": (*_TWO_STAGE_ONLY, *_PLID_ONLY, *reconstruction_checks.KEYS),
        "differentiated-rls": (
            *_LOOP_GAIN_ONLY, *_TWO_STAGE_ONLY, *_PLID_ONLY, *_PRIOR, "memory", "window", "alpha_disturbance_deg_s",
            "q_disturbance_deg_s2", *reconstruction_checks.KEYS,
        ),
        "two-stage": (
            "input", "input_at", "alarm_threshold", "hold_std", *_PRIOR, "prior.effectiveness", *_PLID_ONLY,
            *reconstruction_checks.KEYS,
        ),
        "plid": (
            *_LOOP_GAIN_ONLY, *_TWO_STAGE_ONLY, *_PRIOR, "memory", "window", "forgetting", "alpha_disturbance_deg_s",
            *reconstruction_checks.KEYS,
        ),
    }
)  # fmt: skip
# Values of "memory" for each kind; a kind that is not listed does not use the key.
_MEMORIES: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {"loop-gain": ("window", "expanding", "fading"), "two-stage": ("expanding", "fading", "variable")}
)


def _kinds(scenario: Scenario) -> Iterator[tuple[str, Kind]]:
    """Yield the place and the settings of each kind in a scenario."""
    yield "command", scenario.command
    if scenario.lateral.enabled:
        yield "lateral.roll", scenario.lateral.roll
        yield "lateral.sideslip", scenario.lateral.sideslip
    yield from ((f"failures.{i}", failure) for i, failure in enumerate(scenario.failures))
    yield from ((f"gusts.{i}", gust) for i, gust in enumerate(scenario.gusts))


def _surroundings(scenario: Scenario) -> Surroundings:
    return Surroundings(
        scenario.rates.control_hz, lateral=scenario.lateral.enabled, in_g=scenario.in_g, law=scenario.control.law
    )


def conflicts(scenario: Scenario) -> list[str]:
    """Return the conflicts between keys of a scenario, one message per line: "place: problem (got value); cure"."""
    hz, ticks = scenario.rates.control_hz, scenario.ticks
    problems = []
    if abs(scenario.duration_s * hz - ticks) > 1e-6 or ticks < 1:
        problems.append(f"duration_s: must be a whole number of ticks of 1/{hz} s (got {scenario.duration_s:g})")
    times = {f"failures.{i}.at_s": failure.at_s for i, failure in enumerate(scenario.failures)}
    times |= {f"gusts.{i}.at_s": gust.at_s for i, gust in enumerate(scenario.gusts)}
    if scenario.control.autothrottle.then_fps:
        times["control.autothrottle.then_at_s"] = scenario.control.autothrottle.then_at_s
    problems += [
        f"{key}: must be no later than the last tick, {(ticks - 1) / hz:g} s (got {at_s:g})"
        for key, at_s in times.items()
        if at_s * hz > ticks - 1 + 1e-6
    ]
    around = _surroundings(scenario)
    problems += [line for place, kind in _kinds(scenario) for line in kind.conflicts(place, around)]
    problems += reconstruction_checks.conflicts(scenario)
    names = [estimator.name for estimator in scenario.estimators]
    for i, estimator in enumerate(scenario.estimators):
        if estimator.name in names[:i]:
            problems.append(f"estimators.{i}.name: must be unique (got '{estimator.name}' twice)")
        problems += _estimator_conflicts(f"estimators.{i}", estimator, lateral=scenario.lateral.enabled)
    control, adaptation = scenario.control, scenario.adaptation
    if control.state_from and control.state_from not in names:
        problems.append(_no_estimator("control.state_from", control.state_from, names))
    problems += _redesign_conflicts(scenario)
    problems += _load_factor_conflicts(scenario)
    problems += _options_of_built_ins(scenario)
    if control.gains is not None and control.poles is not None:
        problems.append(
            "control.poles: cannot be combined with control.gains, which replace the design; give one of them"
        )
    if adaptation.enabled and not adaptation.oracle and adaptation.estimator not in names:
        problems.append(_no_estimator("adaptation.estimator", adaptation.estimator, names))
    return problems


def _estimator_conflicts(place: str, estimator: EstimatorSettings, *, lateral: bool) -> list[str]:
    kind, memory, problems = estimator.kind, estimator.memory, []
    if kind == "loop-gain" and estimator.model == "scheduled" and estimator.input == "deviation":
        problems.append(
            f"{place}.input: must be 'absolute' with model = 'scheduled', which has no trim point (got 'deviation')"
        )
    if memory not in (known := _MEMORIES.get(kind, (memory,))):
        choice = f"{', '.join(map(repr, known[:-1]))} or {known[-1]!r}"
        problems.append(f"{place}.memory: must be {choice} with kind = '{kind}' (got '{memory}')")
    if kind == "two-stage" and memory == "variable" and not estimator.variance_min < estimator.variance_max:
        problems.append(
            f"{place}.variance_min: must be below variance_max = {estimator.variance_max:g} (got {estimator.variance_min:g})"
        )
    if kind == "two-stage" and lateral and estimator.model != "scheduled":
        problems.append(
            f"{place}.model: must be 'scheduled' with kind = 'two-stage' and lateral.enabled = true (got '{estimator.model}')"
        )
    return problems


def _redesign_conflicts(scenario: Scenario) -> list[str]:
    adaptation, problems = scenario.adaptation, []
    if not (adaptation.enabled and adaptation.method == "redesign"):
        return []
    if scenario.control.law != "lq":
        problems.append(
            f"control.law: must be 'lq' with adaptation.method = 'redesign', which redesigns it (got '{scenario.control.law}')"
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


def _load_factor_conflicts(scenario: Scenario) -> list[str]:
    control, adaptation, problems = scenario.control, scenario.adaptation, []
    if control.law not in LOAD_FACTOR_LAWS:
        return []
    if control.law == "nz-adaptive" and adaptation.enabled:
        problems.append(
            "adaptation.enabled: must be false with control.law = 'nz-adaptive', which identifies its own model (got true)"
        )
    if control.poles is not None and len(control.poles) != 3:
        problems.append(
            f"control.poles: must be three with control.law = '{control.law}': two states and the integral (got {len(control.poles)})"
        )
    if control.poles is not None:
        pairs = [complex(*pole) for pole in control.poles]
        if any(pairs.count(pole) != pairs.count(pole.conjugate()) for pole in pairs):
            problems.append(
                f"control.poles: complex ones must come in conjugate pairs, [re, im] and [re, -im] (got {[list(p) for p in control.poles]})"
            )
    throttle = control.autothrottle
    if throttle.enabled and not throttle.low_norm < throttle.high_norm:
        problems.append(
            f"control.autothrottle.low_norm: must be below high_norm = {throttle.high_norm:g} (got {throttle.low_norm:g})"
        )
    return problems


def _options_of_built_ins(scenario: Scenario) -> list[str]:
    tables = [
        ("control", "laws", "law", scenario.control.law, scenario.control.options),
        *((f"estimators.{i}", "estimators", "kind", e.kind, e.options) for i, e in enumerate(scenario.estimators)),
    ]
    return [
        f"{place}.options: {key} '{name}' takes no options (got {', '.join(options)}); only external code has them"
        for place, family, key, name, options in tables
        if options and families.is_built_in(family, name)
    ]


def _no_estimator(place: str, name: str, names: Sequence[str]) -> str:
    return f"{place}: no estimator is named '{name}'{did_you_mean(name, names)}; known: {', '.join(names) or 'none'}"


def unused_keys(scenario: Scenario) -> dict[str, str]:
    """Return key without effect -> setting that disables it."""
    lateral, adaptation = scenario.lateral, scenario.adaptation
    keys: dict[str, str] = {}
    if not lateral.enabled:
        own = {*keys_of(lateral, "lateral."), *(f"sensors.{key}" for key in _LATERAL_SENSORS)} - {"lateral.enabled"}
        keys |= dict.fromkeys(sorted(own), "lateral.enabled = false")
    if scenario.control.gains is not None:
        keys["control.integral_pole_rad_s"] = "control.gains"
    if scenario.control.law == "proportional":
        keys |= {f"control.{key}": "control.law = 'proportional'" for key in ("integral_pole_rad_s", "gains.integral")}
    if not adaptation.enabled:
        idle = ("estimator", "method", "floor", "feedback", "caution", "oracle", "limit_command")
        keys |= {f"adaptation.{key}": "adaptation.enabled = false" for key in idle}
    elif adaptation.method == "redesign":
        unused = ("feedback", "caution", "limit_command")
        keys |= {f"adaptation.{key}": "adaptation.method = 'redesign'" for key in unused}
    elif adaptation.oracle:
        keys |= {f"adaptation.{key}": "adaptation.oracle = true" for key in ("estimator", "caution")}
    if scenario.control.law != "lq" and families.is_built_in("laws", scenario.control.law):
        keys |= {f"control.weights.{key}": f"control.law = '{scenario.control.law}'" for key in _WEIGHTS}
    keys |= _unused_in_g(scenario)
    if scenario.control.law == "lq":
        keys |= {f"control.{key}": "control.law = 'lq'" for key in ("poles", "gains", "integral_pole_rad_s")}
    around = _surroundings(scenario)
    keys |= idle_keys(scenario)
    for place, kind in _kinds(scenario):
        keys |= kind.idle(place, around)
    for i, estimator in enumerate(scenario.estimators):
        place = f"estimators.{i}"
        idle_here = _unused_in_estimator(place, estimator, lateral=lateral.enabled)
        keys |= {f"{place}.{key}": why for key, why in idle_here.items()}
    return keys


def _unused_in_estimator(place: str, estimator: EstimatorSettings, *, lateral: bool) -> dict[str, str]:
    kind = estimator.kind
    keys = dict.fromkeys(_UNUSED_BY_ESTIMATOR.get(kind, ()), f"{place}.kind = '{kind}'")
    only_with = {
        "loop-gain": {"window": "window", "alarm_threshold": "window", "forgetting": "fading"},
        "two-stage": {"forgetting": "fading", "variance_min": "variable", "variance_max": "variable"},
    }
    for key, memory in only_with.get(kind, {}).items():
        if estimator.memory != memory:
            keys[key] = f"{place}.memory = '{estimator.memory}'"
    if kind == "two-stage" and not lateral:
        keys |= dict.fromkeys(_LATERAL_DISTURBANCES, "lateral.enabled = false")
    keys |= reconstruction_checks.unused_in_estimator(place, estimator, *_PRIOR, *_PLID_ONLY, *_LATERAL_DISTURBANCES)
    if kind == "loop-gain" and estimator.prior.state == "measurement":
        keys |= {f"prior.{key}": f"{place}.prior.state = 'measurement'" for key in _FIXED_PRIOR}
    return keys


def _unused_in_g(scenario: Scenario) -> dict[str, str]:
    """Return the idle keys that depend on whether the flight is commanded in g -> setting that disables them."""
    law, why = scenario.control.law, f"control.law = '{scenario.control.law}'"
    identification = {f"control.identification.{key}" for key in _IDENTIFICATION}
    idle: set[str] = set()
    if law in LOAD_FACTOR_LAWS:
        idle |= {"control.integral_pole_rad_s", "adaptation.feedback"}
        idle |= {f"control.gains.{key}" for key in ("alpha", "q_s", "elevator", "reference_s", "integral")} | {
            "control.gains"
        }
        idle |= identification if law != "nz-adaptive" else set()
    elif families.is_built_in("laws", law):
        idle |= {*identification, "control.autothrottle.enabled"}
        idle |= {f"control.autothrottle.{key}" for key in _AUTOTHROTTLE}
        if all(families.is_built_in("estimators", estimator.kind) for estimator in scenario.estimators):
            idle.add("sensors.nz_std_g")
    keys = dict.fromkeys(sorted(idle), why)
    throttle = scenario.control.autothrottle
    if law in LOAD_FACTOR_LAWS and not throttle.enabled:
        keys |= {f"control.autothrottle.{key}": "control.autothrottle.enabled = false" for key in _AUTOTHROTTLE}
    elif law in LOAD_FACTOR_LAWS and not throttle.then_fps:
        keys["control.autothrottle.then_at_s"] = "control.autothrottle.then_fps = 0"
    return keys
