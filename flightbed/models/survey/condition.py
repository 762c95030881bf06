"""Trim points and linear models at the user's conditions: a single one, or a sweep."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np

from flightbed.aircraft.overlay import Aircraft, load_aircraft
from flightbed.avionics.short_period import ShortPeriod
from flightbed.core import data
from flightbed.core.errors import InputError, NoTrimError, UnknownNameError
from flightbed.core.units import DEG, FT, KT
from flightbed.fdm.jsbsim import stock_aircraft, stock_names
from flightbed.fdm.stock import StockAircraft
from flightbed.models.authority import Authority, authority
from flightbed.models.linearize import LinearModel, linearize
from flightbed.models.modes import FlyingQualities, flying_qualities
from flightbed.models.reduce import short_period
from flightbed.models.trim import TrimPoint, trim
from flightbed.plant.airframe import Engine, JsbsimAirframe

MOST = 100_000  # conditions of one sweep
STOCK = "jsbsim:"  # prefix that selects the stock aircraft where an overlay has the same name
_SPEEDS = {"mach": ("mach", 1.0), "tas_fps": ("tas_m_s", FT), "cas_kt": ("cas_m_s", KT)}


@dataclass(frozen=True)
class Query:
    """A flight condition, in the user's units, with exactly one speed."""

    altitude_ft: float
    mach: float | None = None
    tas_fps: float | None = None
    cas_kt: float | None = None
    gamma_deg: float = 0.0
    load_factor: float | None = None
    bank_deg: float = 0.0
    cg_shift_cbar: float = 0.0
    effectiveness: float = 1.0
    engine: Engine = "steady"

    @property
    def speed(self) -> tuple[str, float]:
        """Name and value of the given speed. Raises InputError unless exactly one is given."""
        given = [(name, value) for name in _SPEEDS if (value := getattr(self, name)) is not None]
        if len(given) != 1:
            raise InputError("give exactly one of --mach, --tas-fps and --cas-kt")
        return given[0]

    def __str__(self) -> str:
        """Describe the condition, for messages."""
        name, value = self.speed
        words = {
            "mach": f"Mach {value:.2f}" if round(value, 2) == value else f"Mach {value:g}",
            "tas_fps": f"{value:g} ft/s true",
            "cas_kt": f"{value:g} kt calibrated",
        }[name]
        more = "" if self.load_factor is None else f", load factor {self.load_factor:g}"
        more += f", bank {self.bank_deg:g} deg" if self.bank_deg else ""
        return f"{words}, {self.altitude_ft:.0f} ft{more}"


@dataclass(frozen=True)
class Point:
    """A trimmed condition and its linear model (all ten states)."""

    query: Query
    airframe: JsbsimAirframe
    trim: TrimPoint
    model: LinearModel
    design: ShortPeriod
    qualities: FlyingQualities
    authority: Authority


def find_aircraft(name: str) -> Aircraft | StockAircraft:
    """Read a shipped overlay, a folder or a stock JSBSim aircraft. Raises UnknownNameError, AircraftError."""
    if name.startswith(STOCK):
        return stock_aircraft(name.removeprefix(STOCK))
    if name in data.names("aircraft"):
        return load_aircraft(name)
    if name in stock_names():
        return stock_aircraft(name)
    try:
        return load_aircraft(name)
    except UnknownNameError:
        known = {*data.names("aircraft"), *stock_names()}
        raise UnknownNameError("aircraft", name, known, also=", and no such folder") from None


def axis(text: str, option: str) -> tuple[float, ...]:
    """Parse a number, a list ``0.6,0.8``, or a range ``0.6:0.9:0.1`` that includes its end. Raises InputError."""
    try:
        parts = [float(part) for part in text.split(":" if ":" in text else ",")]
    except ValueError:
        parts = []
    if parts and np.isfinite(parts).all():
        if ":" not in text:
            return tuple(parts)
        if len(parts) == 3 and parts[2] != 0.0:
            count = int(np.floor((parts[1] - parts[0]) / parts[2] + 1e-9)) + 1
            if 1 <= count <= MOST:
                return tuple(round(parts[0] + i * parts[2], 12) for i in range(count))
    raise InputError(f"{option}: must be a number, a list like 0.6,0.8 or a range like 0.6:0.9:0.1 (got '{text}')")


def queries(altitudes_ft: tuple[float, ...], speed: str, values: tuple[float, ...], **fixed: Any) -> Iterator[Query]:
    """Yield every combination of altitude and speed."""
    for altitude_ft, value in product(altitudes_ft, values):
        given: dict[str, Any] = {speed: value}
        yield Query(altitude_ft=altitude_ft, **given, **fixed)


def airframe_at(aircraft: Aircraft | StockAircraft, query: Query) -> JsbsimAirframe:
    """Build the equations of motion at a condition. Raises InputError for a value out of range."""
    name, value = query.speed
    if not value > 0.0:
        raise InputError(f"--{name.replace('_', '-')}: must be above 0 (got {value:g})")
    if not 0.0 <= query.altitude_ft <= 100_000.0:
        raise InputError(f"--altitude-ft: must be between 0 and 100000 (got {query.altitude_ft:g})")
    if not 0.0 < query.effectiveness <= 1.0:
        raise InputError(f"--effectiveness: must be above 0 and at most 1 (got {query.effectiveness:g})")
    if not abs(query.cg_shift_cbar) <= 0.5:
        raise InputError(f"--cg-shift-cbar: must be between -0.5 and 0.5 (got {query.cg_shift_cbar:g})")
    if not abs(query.gamma_deg) <= 60.0:
        raise InputError(f"--gamma-deg: must be between -60 and 60 (got {query.gamma_deg:g})")
    if query.load_factor is not None and not -10.0 <= query.load_factor <= 20.0:
        raise InputError(f"--load-factor: must be between -10 and 20 (got {query.load_factor:g})")
    if not abs(query.bank_deg) <= 85.0:
        raise InputError(f"--bank-deg: must be between -85 and 85 (got {query.bank_deg:g})")
    keyword, factor = _SPEEDS[name]
    speed: dict[str, Any] = {keyword: value * factor}
    return JsbsimAirframe(aircraft, altitude_m=query.altitude_ft * FT, cg_shift_cbar=query.cg_shift_cbar,
                          effectiveness=query.effectiveness, engine=query.engine, **speed)  # fmt: skip


def _trim(airframe: JsbsimAirframe, query: Query) -> TrimPoint:
    gamma, bank = query.gamma_deg * DEG, query.bank_deg * DEG
    return trim(airframe, gamma_rad=gamma, load_factor=query.load_factor, bank_rad=bank)


def trim_at(aircraft: Aircraft | StockAircraft, query: Query) -> tuple[JsbsimAirframe, TrimPoint]:
    """Trim at a condition. Raises InputError, NoTrimError."""
    airframe = airframe_at(aircraft, query)
    try:
        return airframe, _trim(airframe, query)
    except NoTrimError as error:
        problem = airframe.engine_problem()
        error.args = (f"no trim at {query}: {error}{f'; {problem}' if problem else ''}",)
        raise


def nearest_feasible(aircraft: Aircraft | StockAircraft, query: Query) -> dict[str, float]:
    """Find the nearest conditions that can be trimmed, changing one quantity at a time.

    Load factor and bank change toward level flight, altitude downward, speed upward and downward (up to three times and down to a third);
    each in steps of 5 % (1000 ft), followed by bisection to 0.1 % (10 ft).

    Returns:
        name of the quantity (as in Query; ``"..._above"`` and ``"..._below"`` for speeds) -> value; quantities without a trim are absent.

    """

    def feasible(name: str, value: float) -> bool:
        try:
            moved: dict[str, Any] = {name: value}
            there = replace(query, **moved)
            _trim(airframe_at(aircraft, there), there)
        except (NoTrimError, InputError):
            return False
        return True

    def search(name: str, start: float, step: Callable[[float], float], tries: int, fine: float) -> float | None:
        bad, value = start, start
        for _ in range(tries):
            value = step(value)
            if feasible(name, value):
                break
            bad = value
        else:
            return None
        while abs(value - bad) > fine:
            middle = (value + bad) / 2.0
            value, bad = (middle, bad) if feasible(name, middle) else (value, middle)
        return value

    speed, v = query.speed
    looks: dict[str, float | None] = {
        f"{speed}_above": search(speed, v, lambda x: 1.05 * x, 22, 1e-3 * v),
        f"{speed}_below": search(speed, v, lambda x: x / 1.05, 22, 1e-3 * v),
        "altitude_ft": search("altitude_ft", query.altitude_ft, lambda x: x - 1000.0, int(query.altitude_ft / 1000.0), 10.0),
    }  # fmt: skip
    if query.load_factor is not None:
        n = query.load_factor
        looks["load_factor"] = search("load_factor", n, lambda x: x + 0.05 * (1.0 - n), 20, 1e-3 * abs(n - 1.0) + 1e-6)
    if query.bank_deg:
        phi = query.bank_deg
        looks["bank_deg"] = search("bank_deg", phi, lambda x: x - 0.05 * phi, 19, 1e-3 * abs(phi))
    return {name: value for name, value in looks.items() if value is not None}


def linearize_at(aircraft: Aircraft | StockAircraft, query: Query) -> Point:
    """Trim and linearize at a condition. Raises InputError, NoTrimError."""
    airframe, point = trim_at(aircraft, query)
    airframe.freeze(point.motion, point.controls)
    model = linearize(airframe, point)
    lag = aircraft.actuator.lag_rad_s if isinstance(aircraft, Aircraft) else np.inf
    design = short_period(model, actuator_rad_s=lag)
    elevator = airframe.inputs[0]
    enough = authority(design, (elevator.low, elevator.high), effectiveness=query.effectiveness)
    return Point(query, airframe, point, model, design, flying_qualities(model), enough)
