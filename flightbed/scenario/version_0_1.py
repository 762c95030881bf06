"""Files that version 0.1 resolved: they hold every key of every kind, so keys at their default there say nothing.

Version 0.1 had one table for all kinds of estimators, and likewise for commands, failures, gusts and laws. The file that it wrote beside a
flight holds all their keys. Such a key that the kind does not have, or that has no effect, is left out when the file is read, if it has
the default of version 0.1; any other value was written by somebody who expected an effect.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

from flightbed.config.reading import value_at

# Defaults of version 0.1; of a list, the defaults of each of its tables.
_DEFAULTS: Mapping[str, Any] = MappingProxyType(
    {
        "command": {
            "period_s": 4.5,
            "count": 3,
            "start_s": 0.0,
            "low_hz": 0.2,
            "high_hz": 2.0,
            "switch_s": 0.3,
            "register_bits": 4,
            "seed": 0,
            "filter_rad_s": 3.0,
            "amplitude_deg_s": 5.0,
            "amplitude_g": 1.0,
        },
        "lateral": {
            "roll": {
                "kind": "none",
                "period_s": 4.5,
                "count": 3,
                "start_s": 0.0,
                "low_hz": 0.2,
                "high_hz": 2.0,
                "switch_s": 0.3,
                "register_bits": 4,
                "seed": 0,
                "filter_rad_s": 3.0,
                "amplitude_deg_s": 5.0,
            },
            "sideslip": {
                "kind": "none",
                "period_s": 4.5,
                "count": 3,
                "start_s": 0.0,
                "low_hz": 0.2,
                "high_hz": 2.0,
                "switch_s": 0.3,
                "register_bits": 4,
                "seed": 0,
                "filter_rad_s": 3.0,
                "amplitude_deg": 2.0,
            },
            "beta_deg": 2.0,
            "p_deg_s": 20.0,
            "r_deg_s": 10.0,
            "aileron_deg": 10.0,
            "rudder_deg": 10.0,
        },
        "sensors": {
            "alpha_std_deg": 0.03,
            "q_std_deg_s": 0.1108,
            "elevator_std_deg": 0.0,
            "mach_std": 0.0005,
            "altitude_std_ft": 10.0,
            "theta_std_deg": 0.05,
            "phi_std_deg": 0.05,
            "nz_std_g": 0.0,
            "beta_std_deg": 0.03,
            "p_std_deg_s": 0.1108,
            "r_std_deg_s": 0.1108,
            "aileron_std_deg": 0.0,
            "rudder_std_deg": 0.0,
            "alpha_bias_deg": 0.0,
            "q_bias_deg_s": 0.0,
            "mach_error": 0.0,
        },
        "gusts": {"rise_s": 1.0, "hold_s": 0.0, "frequency_hz": 1.0},
        "failures": {
            "surface": "elevator",
            "to": 1.0,
            "force_to": 1.0,
            "over_s": 2.0,
            "side": "high",
            "bias_deg": 0.0,
            "shift_cbar": 0.0,
        },
        "control": {
            "integral_pole_rad_s": -0.5,
            "gains": {"integral": 0.0},
            "weights": {"alpha_deg": 3.0, "q_deg_s": 3.0, "elevator_deg": 3.0},
            "identification": {
                "prior": "linearization",
                "prior_var": 0.001,
                "process_var": 0.01,
                "output_var": 1e-08,
                "block_fade": 1.001,
                "form": "factored",
                "precision": "double",
                "patience": 0,
                "gain_filter_rad_s": 5.0,
                "command_filter_rad_s": 0.0,
            },
            "autothrottle": {"enabled": False, "low_norm": 0.1, "high_norm": 1.0, "then_fps": 0.0, "then_at_s": 0.0},
            "state_from": "",
        },
        "adaptation": {
            "enabled": False,
            "method": "divide",
            "estimator": "",
            "floor": 0.08,
            "feedback": "effective",
            "caution": 0.0,
            "limit_command": False,
            "oracle": False,
        },
        "estimators": {
            "model": "scheduled",
            "input": "absolute",
            "input_at": "mean",
            "memory": "window",
            "window": 30,
            "forgetting": 0.98,
            "smoothing": 0.9,
            "bounds": [0.0, 1.0],
            "alarm_threshold": 30.0,
            "follow_disturbances": True,
            "hold_std": 0.3,
            "alpha_disturbance_deg_s": 0.05,
            "q_disturbance_deg_s2": 0.3,
            "beta_disturbance_deg_s": 0.05,
            "p_disturbance_deg_s2": 1.0,
            "r_disturbance_deg_s2": 0.3,
            "variance_min": 2e-05,
            "variance_max": 1.0,
            "walk_std": 0.0001,
            "false_alarm": 1e-06,
            "block_fade": 1.01,
            "form": "factored",
            "precision": "double",
            "unknown": "elevator",
            "order": 4,
            "horizon": 6,
            "regularization": 1.0,
            "initial_covariance": 0.01,
            "input_forgetting": 1.0,
            "saturation_deg": 30.0,
            "input_step_deg": 0.1,
            "offset_deg": 0.3,
            "prior": {
                "state": "measurement",
                "first_reading": "left-out",
                "alpha_deg": 0.0,
                "q_deg_s": 0.0,
                "alpha_std_deg": 1.0,
                "q_std_deg_s": 1.0,
                "effectiveness": 1.0,
                "effectiveness_std": 0.63,
            },
        },
    }
)
_BY_KIND: Mapping[str, Mapping[str, Any]] = MappingProxyType(
    {
        "two-stage": {"memory": "variable", "window": 3},
        "retrospective-cost": {"window": 45},
        "input-kalman": {"window": 45},
    }
)
_ON_THE_SHORT_PERIOD: Mapping[str, Any] = MappingProxyType(
    {
        "alarm_threshold": 0.0,
        "follow_disturbances": False,
        "hold_std": 0.0,
        "alpha_disturbance_deg_s": 0.6,
        "q_disturbance_deg_s2": 6.0,
    }
)
_ESTIMATOR_KEYS = frozenset(_DEFAULTS["estimators"])


def is_resolved(raw: Mapping[str, Any]) -> bool:
    """Return whether version 0.1 resolved a file: it names the aircraft by hash, and holds keys of all laws, commands and estimators."""
    aircraft, control, command = (
        set(table) if isinstance(table := raw.get(key), Mapping) else set()
        for key in ("aircraft", "control", "command")
    )
    estimators = raw.get("estimators", ())
    return (
        "sha256" in aircraft
        and {"weights", "identification", "autothrottle"} <= control
        and {"register_bits", "switch_s", "low_hz"} <= command
        and isinstance(estimators, Sequence)
        and all(isinstance(table, Mapping) and set(table) >= _ESTIMATOR_KEYS for table in estimators)
    )


def at_default(raw: Mapping[str, Any], key: str) -> bool:
    """Return whether a key, such as "estimators.0.window", has the default of version 0.1."""
    path = key.split(".")
    return _same(value_at(raw, path), _default(raw, path))


def _default(raw: Mapping[str, Any], path: Sequence[str]) -> Any:
    """Return the default of a key in version 0.1, given the other keys of its table; None for a key that it did not have."""
    *_, key = path
    if path[0] == "estimators" and len(path) == 3:
        table = value_at(raw, path[:2])
        special = {
            **(_ON_THE_SHORT_PERIOD if table.get("model") == "short-period" else {}),
            **_BY_KIND.get(str(table.get("kind")), {}),
        }
        if key in special:
            return special[key]
    if key == "amplitude_deg_s" and value_at(raw, [*path[:-1], "kind"]) == "dither":
        return 0.5
    default: Any = _DEFAULTS
    for part in path:
        if not part.isdecimal():
            default = default.get(part) if isinstance(default, Mapping) else None
    return default


def _same(value: Any, default: Any) -> bool:
    if isinstance(default, Mapping):
        return isinstance(value, Mapping) and all(key in default and _same(value[key], default[key]) for key in value)
    return isinstance(value, bool) == isinstance(default, bool) and bool(value == default)
