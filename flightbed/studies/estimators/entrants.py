"""The estimators that are compared, one row each: settings and assumptions."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

TRUE_K = "true K"  # no estimator: the law divides by the true K
FIXED = "not corrected"
HEALTHY = "nothing fails"


@dataclass(frozen=True)
class Entrant:
    """An estimator as it is flown.

    Attributes:
        name: its name in the scenarios and in the tables.
        settings: keys of its ``[[estimators]]`` table without the name; all other keys have their defaults.
        known: quantities that it assumes.
        unknown: quantities that it estimates.
        noise: its model of noise and disturbances.
        alarm: meaning of its alarms; "" for an estimator without a test, ``UNDECLARED`` where only flights can show whether it has one.

    """

    name: str
    settings: Mapping[str, Any]
    known: str
    unknown: str
    noise: str
    alarm: str = ""

    def table(self) -> dict[str, Any]:
        """Return its ``[[estimators]]`` table."""
        return {"name": self.name, **self.settings}


CHANGED = "K has changed"
UNEXPLAINED = "no K explains it"
UNDECLARED = "alarms, if any"  # of code outside flightbed; ``measures`` replaces it by CHANGED or ""
_SENSORS = "white noise of known size on alpha and q"

ENTRANTS: tuple[Entrant, ...] = (
    Entrant(
        "scheduled",
        {"kind": "loop-gain", "model": "scheduled", "memory": "window", "window": 30},
        "pitch motion over Mach number and alpha, for a healthy aircraft",
        "K, constant over the window; that it has changed",
        f"{_SENSORS}; disturbances of alpha and q as large as the readings show",
        CHANGED,
    ),
    Entrant(
        "short-period",
        {"kind": "loop-gain", "model": "short-period", "memory": "window", "window": 30},
        "two-state linear model at the trim point",
        "K, constant over the window",
        f"{_SENSORS}; white disturbances of fixed size",
    ),
    Entrant(
        "expanding",
        {"kind": "loop-gain", "model": "short-period", "memory": "expanding"},
        "two-state linear model at the trim point",
        "K, constant for the whole flight",
        f"{_SENSORS}; white disturbances of fixed size",
    ),
    Entrant(
        "differentiated-rls",
        {"kind": "differentiated-rls"},
        "pitch motion over Mach number and alpha, for a healthy aircraft",
        "K, drifting as fast as residuals ask for",
        "none in the regressor; filtered pitch acceleration with white residuals of the size that the noise of q gives",
    ),
    Entrant(
        "two-stage",
        {"kind": "two-stage", "memory": "variable", "window": 3},
        "pitch motion over Mach number and alpha, for a healthy aircraft",
        "K, a slow random walk; that it is not 1",
        f"{_SENSORS}; disturbances of alpha and q as large as the readings show",
        CHANGED,
    ),
    Entrant(
        "plid",
        {"kind": "plid"},
        "second-order transfer function from elevator to pitch rate of the same model, of the healthy aircraft",
        "its four coefficients, drifting; K is the ratio of the numerators",
        "q behind a band pass, white process noise as large as what is left of the noise of q",
    ),
    Entrant(
        "retrospective-cost",
        {"kind": "retrospective-cost"},
        "pitch motion over Mach number and alpha, for a healthy aircraft, without the elevator's share",
        "the acting deflection, of any cause; K and an offset by regression on the measured one; whether K explains it",
        "none in the reconstruction; in the regression the noise of alpha and q, raised to what the readings show",
        UNEXPLAINED,
    ),
    Entrant(
        "input-kalman",
        {"kind": "input-kalman"},
        "pitch motion over Mach number and alpha, for a healthy aircraft, without the elevator's share",
        "the deflection that acts, a random walk; K and an offset by regression on the measured one; whether K explains it",
        f"{_SENSORS}, white disturbances of fixed size; in the regression raised to what the readings show",
        UNEXPLAINED,
    ),
)


def inline(value: object) -> str:
    """Return plain values as TOML on one line."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key} = {inline(each)}" for key, each in value.items()) + "}"
    if isinstance(value, Sequence) and not isinstance(value, str):
        return "[" + ", ".join(map(inline, value)) + "]"
    return json.dumps(value)
