"""Keys of gusts and of estimators that reconstruct an unknown input: conflicts and keys without effect; part of ``checks``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType

from flightbed.config.kinds import EstimatorSettings, GustSettings
from flightbed.scenario.tables import Scenario

KINDS = ("retrospective-cost", "input-kalman")
_RETROSPECTIVE = ("order", "horizon", "regularization", "initial_covariance", "input_forgetting", "saturation_deg")
_WALK = ("input_step_deg",)
KEYS = ("unknown", "offset_deg", *_RETROSPECTIVE, *_WALK)  # used by these kinds only
_WITHOUT_EFFECT = (
    "input",
    "input_at",
    "alarm_threshold",
    "hold_std",
    "memory",
    "variance_min",
    "variance_max",
    "walk_std",
)
# Keys of the elevator's effectiveness and its test, without effect when the unknown is a gust.
_ELEVATOR = (
    "window", "forgetting", "smoothing", "bounds", "follow_disturbances", "false_alarm", "offset_deg", "prior.effectiveness",
    "prior.effectiveness_std",
)  # fmt: skip
_DISTURBANCES = ("alpha_disturbance_deg_s", "q_disturbance_deg_s2")
_SHORTEST = 6  # ticks, shortest window of the test
_GUST_NEEDS: Mapping[str, str] = MappingProxyType({"1-cos": "rise_s", "sine": "frequency_hz"})
_UNUSED_BY_GUST: Mapping[str, Sequence[str]] = MappingProxyType(
    {"1-cos": ("frequency_hz",), "sine": ("rise_s", "hold_s")},
)


def conflicts(scenario: Scenario) -> list[str]:
    """Return the conflicts in a scenario, one line each."""
    problems = [
        f"gusts.{i}.{needed}: is missing; a gust of shape '{gust.shape}' needs it"
        for i, gust in enumerate(scenario.gusts)
        if (needed := _GUST_NEEDS[gust.shape]) not in gust.model_fields_set
    ]
    hz = scenario.rates.control_hz
    problems += [
        f"gusts.{i}.frequency_hz: must be below half of rates.control_hz = {hz}, the Nyquist frequency (got {gust.frequency_hz:g})"
        for i, gust in enumerate(scenario.gusts)
        if gust.shape == "sine" and not gust.frequency_hz < hz / 2
    ]
    adaptation = scenario.adaptation
    corrects = adaptation.estimator if adaptation.enabled and not adaptation.oracle else None
    for i, estimator in enumerate(scenario.estimators):
        if estimator.kind not in KINDS:
            continue
        if estimator.unknown == "elevator" and estimator.window < _SHORTEST:
            problems.append(
                f"estimators.{i}.window: must be at least {_SHORTEST} with kind = '{estimator.kind}' (got {estimator.window})"
            )
        if estimator.unknown == "gust" and estimator.name == corrects:
            problems.append(
                f"adaptation.estimator: must estimate the elevator (got '{corrects}', whose unknown is the gust)"
            )
    return problems


def unused_in_gust(place: str, gust: GustSettings) -> dict[str, str]:
    """Return key -> the setting that leaves it without effect."""
    return {f"{place}.{key}": f"{place}.shape = '{gust.shape}'" for key in _UNUSED_BY_GUST[gust.shape]}


def unused_in_estimator(place: str, estimator: EstimatorSettings, *others: str) -> dict[str, str]:
    """Return key, without its place, -> the setting that leaves it without effect; ``others`` are keys of other kinds."""
    kind = estimator.kind
    if kind not in KINDS:
        return {}
    of_the_other = _WALK if kind == "retrospective-cost" else _RETROSPECTIVE
    keys = dict.fromkeys((*others, *_WITHOUT_EFFECT, *of_the_other), f"{place}.kind = '{kind}'")
    if estimator.unknown == "gust":
        # The retrospective cost ignores the noise; the elevator's test uses it.
        more = _DISTURBANCES if kind == "retrospective-cost" else ()
        keys |= dict.fromkeys((*_ELEVATOR, *more), f"{place}.unknown = 'gust'")
    return keys
