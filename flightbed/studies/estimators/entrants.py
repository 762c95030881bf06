"""The estimators that are compared, one row each: settings and assumptions."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
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


def _entrants() -> tuple[Entrant, ...]:
    file = Path(__file__).with_suffix(".toml")
    return tuple(Entrant(**row) for row in tomllib.loads(file.read_text(encoding="utf-8"))["entrants"])


ENTRANTS = _entrants()


def inline(value: object) -> str:
    """Return plain values as TOML on one line."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key} = {inline(each)}" for key, each in value.items()) + "}"
    if isinstance(value, Sequence) and not isinstance(value, str):
        return "[" + ", ".join(map(inline, value)) + "]"
    return json.dumps(value)
