"""Keys of estimators that reconstruct an unknown input: conflicts and keys without effect; part of ``checks``."""

from __future__ import annotations

from flightbed.config.kinds import EstimatorSettings
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


def conflicts(scenario: Scenario) -> list[str]:
    """Return the conflicts in a scenario, one line each."""
    problems = []
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
