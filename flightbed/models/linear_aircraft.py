"""Linear aircraft: aircraft/<name>/ with kind = "linear" -> LinearAircraft, a short period and an actuator."""

from __future__ import annotations

import hashlib
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from math import inf, isfinite
from pathlib import Path
from typing import Any

import numpy as np

from flightbed.aircraft.overlay import Aircraft, load_aircraft
from flightbed.aircraft.schema import LINEAR, keys_of, tables_of
from flightbed.avionics.short_period import ShortPeriod
from flightbed.core import data
from flightbed.core.actuator import Actuator
from flightbed.core.atmosphere import standard_air
from flightbed.core.errors import AircraftError, did_you_mean
from flightbed.core.units import FT

_KEYS = {table: keys_of(schema) for table, schema in tables_of(LINEAR).items()}


@dataclass(frozen=True, eq=False)
class LinearAircraft:
    """The short period of an aircraft at one condition, in deviations from trim, and its actuator without limits.

    Attributes:
        name: name of the aircraft.
        description: one line.
        design: short-period model with zero trim.
        mach, altitude_ft: flight condition of the model.
        sha256: SHA-256 of its numbers, hexadecimal.

    """

    name: str
    description: str
    design: ShortPeriod
    mach: float
    altitude_ft: float
    sha256: str

    @property
    def actuator(self) -> Actuator:
        """A first-order lag without limits."""
        return Actuator(self.design.actuator_rad_s, inf, -inf, inf)

    @property
    def airspeed_m_s(self) -> float:
        """True airspeed in the standard atmosphere, m/s."""
        return self.mach * standard_air(self.altitude_ft * FT).sound_m_s


def load_flyable(name: str) -> Aircraft | LinearAircraft:
    """Read the aircraft of a scenario, overlay or linear, by shipped name or folder. Raises UnknownNameError or AircraftError."""
    try:
        linear = "kind" in tomllib.loads(_file(name).read_text(encoding="utf-8"))  # an overlay has no such key
    except (OSError, ValueError, RecursionError):
        linear = False  # load_aircraft reports the problem
    return load_linear_aircraft(name) if linear else load_aircraft(name)


def load_linear_aircraft(name: str) -> LinearAircraft:
    """Read a linear aircraft by shipped name or folder. Raises UnknownNameError or AircraftError."""
    path = _file(name)
    try:
        text = path.read_text(encoding="utf-8")
        raw = tomllib.loads(text)
    except (OSError, ValueError, RecursionError) as error:
        raise AircraftError(f"{path}: {error}") from None
    for table, known in _KEYS.items():
        found = raw if not table else raw.get(table)
        dot = f"{table}." if table else ""
        if not isinstance(found, Mapping):
            raise AircraftError(f"{path}: [{table}] is missing")
        for key in found:
            if key not in known:
                raise AircraftError(f"{path}: unknown key {dot}{key}{did_you_mean(key, known)}")
        for key in known:
            if key not in found:
                raise AircraftError(f"{path}: {dot}{key} is missing")
    for key, only in (("schema", 1), ("kind", "linear")):
        if raw[key] != only or isinstance(raw[key], bool):
            raise AircraftError(f"{path}: {key}: must be {only!r} (got {raw[key]!r})")
    for key in ("name", "description"):
        if not isinstance(raw[key], str) or len(raw[key].splitlines()) != 1:
            raise AircraftError(f"{path}: {key}: must be one line of text (got {raw[key]!r})")
    numbers = {t: {k: _number(raw[t][k], f"{path}: {t}.{k}") for k in _KEYS[t]} for t in _KEYS if t}
    for table, key in (("elevator", "lag_rad_s"), ("condition", "mach")):
        if numbers[table][key] <= 0.0:
            raise AircraftError(f"{path}: {table}.{key}: must be above 0 (got {numbers[table][key]:g})")
    s = numbers["short_period"]
    A = np.array([[s["z_alpha_1_s"], s["z_q"]], [s["m_alpha_1_s2"], s["m_q_1_s"]]])
    design = ShortPeriod(A, np.array([s["z_delta_1_s"], s["m_delta_1_s2"]]), numbers["elevator"]["lag_rad_s"])
    fingerprint = hashlib.sha256(repr(sorted((t, sorted(v.items())) for t, v in numbers.items())).encode()).hexdigest()
    condition = numbers["condition"]
    return LinearAircraft(
        raw["name"], raw["description"], design, condition["mach"], condition["altitude_ft"], fingerprint
    )


def _file(name: str) -> Path:
    return data.find("aircraft", name) / "aircraft.toml"


def _number(value: Any, place: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not isfinite(value):
        raise AircraftError(f"{place}: must be a number (got {value!r})")
    return float(value)
