"""Trim and linear models at conditions given by the user: one, or a sweep of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from itertools import product
from typing import Any

import numpy as np

from flightbed.aircraft import Aircraft
from flightbed.authority import Authority, authority
from flightbed.errors import InputError, NoTrimError
from flightbed.linearize import LinearModel, linearize
from flightbed.modes import FlyingQualities, flying_qualities, longitudinal_modes
from flightbed.plant.jsbsim import JsbsimAirframe, version
from flightbed.short_period import ShortPeriod, short_period, zero_order_hold
from flightbed.trim import TrimPoint, trim
from flightbed.units import DEG, FT, KT
from flightbed.validate import validate

MOST = 100_000  # conditions of one sweep
_SPEEDS = {"mach": ("mach", 1.0), "tas_fps": ("tas_m_s", FT), "cas_kt": ("cas_m_s", KT)}


@dataclass(frozen=True)
class Query:
    """What the user asks for, in the user's units; exactly one speed."""

    altitude_ft: float
    mach: float | None = None
    tas_fps: float | None = None
    cas_kt: float | None = None
    gamma_deg: float = 0.0
    cg_shift_cbar: float = 0.0
    effectiveness: float = 1.0

    @property
    def speed(self) -> tuple[str, float]:
        """Which speed was given, and its value."""
        given = [(name, value) for name in _SPEEDS if (value := getattr(self, name)) is not None]
        if len(given) != 1:
            raise InputError("give exactly one of --mach, --tas-fps and --cas-kt")
        return given[0]

    def __str__(self) -> str:
        """In words, for messages."""
        name, value = self.speed
        words = {"mach": f"Mach {value:.2f}", "tas_fps": f"{value:g} ft/s true", "cas_kt": f"{value:g} kt calibrated"}[
            name
        ]
        return f"{words}, {self.altitude_ft:.0f} ft"


@dataclass(frozen=True)
class Point:
    """A trimmed condition and its linear model."""

    query: Query
    airframe: JsbsimAirframe
    trim: TrimPoint
    model: LinearModel
    design: ShortPeriod
    qualities: FlyingQualities
    authority: Authority


def axis(text: str, option: str) -> tuple[float, ...]:
    """Read a number, a list ``0.6,0.8``, or a range ``0.6:0.9:0.1`` that includes its end. Raises InputError."""
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


def queries(altitudes_ft: tuple[float, ...], speed: str, values: tuple[float, ...], **fixed: float) -> Iterator[Query]:
    """Yield every combination of altitude and speed."""
    for altitude_ft, value in product(altitudes_ft, values):
        yield Query(altitude_ft=altitude_ft, **{speed: value}, **fixed)


def airframe_at(aircraft: Aircraft, query: Query) -> JsbsimAirframe:
    """Build the equations of motion at a condition. Raises InputError for one that makes no sense."""
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
    keyword, factor = _SPEEDS[name]
    speed: dict[str, Any] = {keyword: value * factor}
    return JsbsimAirframe(aircraft, altitude_m=query.altitude_ft * FT, cg_shift_cbar=query.cg_shift_cbar,
                          effectiveness=query.effectiveness, **speed)  # fmt: skip


def trim_at(aircraft: Aircraft, query: Query) -> tuple[JsbsimAirframe, TrimPoint]:
    """Trim at a condition. Raises InputError, NoTrimError."""
    airframe = airframe_at(aircraft, query)
    try:
        return airframe, trim(airframe, gamma_rad=query.gamma_deg * DEG)
    except NoTrimError as error:
        error.args = (f"no trim at {query}: {error}",)
        raise


def linearize_at(aircraft: Aircraft, query: Query) -> Point:
    """Trim and linearize at a condition. Raises InputError, NoTrimError."""
    airframe, point = trim_at(aircraft, query)
    model = linearize(airframe, point)
    design = short_period(model, actuator_rad_s=aircraft.actuator.lag_rad_s)
    enough = authority(design, aircraft.actuator, effectiveness=query.effectiveness)
    return Point(query, airframe, point, model, design, flying_qualities(model), enough)


def trim_document(aircraft: Aircraft, query: Query, airframe: JsbsimAirframe, point: TrimPoint) -> dict[str, Any]:
    """Return a trim point as plain values, as ``trim --format json`` prints it."""
    return {
        "aircraft": aircraft.name,
        "condition": {
            "mach": airframe.mach,
            "airspeed_m_s": point.airspeed_m_s,
            "altitude_m": airframe.altitude_m,
            "gamma_rad": query.gamma_deg * DEG,
            "cg_shift_cbar": query.cg_shift_cbar,
            "effectiveness": query.effectiveness,
        },
        "trim": {
            "alpha_deg": point.alpha_rad / DEG,
            "elevator_deg": point.elevator_rad / DEG,
            "throttle_norm": point.throttle_norm,
            "theta_deg": point.theta_rad / DEG,
            "residual": point.residual,
        },
    }


def document(aircraft: Aircraft, point: Point, *, control_hz: float, validated: bool = False) -> dict[str, Any]:
    """Return a linear model as plain values, as ``linearize --format json`` prints it; SI and radians but for ``trim``."""
    model, design, qualities = point.model, point.design, point.qualities
    discrete = [zero_order_hold(model.A, model.B[:, i], 1.0 / control_hz) for i in range(model.B.shape[1])]
    query = point.query
    flown = (
        validate(aircraft, model, cg_shift_cbar=query.cg_shift_cbar, effectiveness=query.effectiveness)
        if validated
        else ()
    )
    return {
        **({"validation": [asdict(result) for result in flown]} if validated else {}),
        **trim_document(aircraft, point.query, point.airframe, point.trim),
        "states": [{"name": name, "unit": unit} for name, unit in model.states],
        "inputs": [{"name": name, "unit": unit} for name, unit in model.inputs],
        "outputs": [{"name": name, "unit": unit} for name, unit in model.outputs],
        "A": model.A.tolist(),
        "B": model.B.tolist(),
        "C": model.C.tolist(),
        "D": model.D.tolist(),
        "modes": [
            {
                "name": mode.name,
                "eigenvalue": [mode.eigenvalue.real, mode.eigenvalue.imag],
                "omega_n_rad_s": mode.omega_n_rad_s,
                "zeta": mode.zeta,
                "time_constant_s": mode.time_constant_s if np.isfinite(mode.time_constant_s) else None,
            }
            for mode in longitudinal_modes(model)
        ],
        "short_period": {
            "A": design.A.tolist(),
            "B": design.b[:, None].tolist(),
            "states": ["alpha", "q"],
            "inputs": ["elevator"],
            "eigenvalues": [[p.real, p.imag] for p in design.poles.tolist()],
            "n_alpha_g_rad": qualities.n_alpha_g_rad,
            "cap": qualities.cap,
            "level": qualities.level,
        },
        "discrete": {
            "control_hz": control_hz,
            "A": discrete[0].A.tolist(),
            "B": np.column_stack([d.b for d in discrete]).tolist(),
        },
        "authority": {
            "effectiveness_min_trim": point.authority.trim,
            "effectiveness_min_hold": point.authority.hold,
            "hold_from_alpha_rad": point.authority.alpha_rad,
        },
        "step_error": model.step_error,
        "kinks": [str(kink) for kink in model.kinks],
        "sources": {
            "elevator": "surface position; the actuator is not part of the model",
            "throttle": "normalized; the engine is at its steady state",
            "control_system": "none in pitch; speed and altitude are free",
            "jsbsim": version(),
            "aircraft_sha256": aircraft.sha256,
        },
    }


def row(point: Point) -> dict[str, Any]:
    """Return one line of a sweep's table, units in the names."""
    model, design, trimmed = point.model, point.design, point.trim
    return {
        "mach": point.airframe.mach,
        "altitude_ft": point.query.altitude_ft,
        "airspeed_m_s": trimmed.airspeed_m_s,
        "alpha_deg": trimmed.alpha_rad / DEG,
        "elevator_deg": trimmed.elevator_rad / DEG,
        "throttle_norm": trimmed.throttle_norm,
        "residual": trimmed.residual,
        **dict(
            zip(("Z_alpha", "Z_q", "M_alpha", "M_q", "Z_delta", "M_delta"), [*design.A.ravel(), *design.b], strict=True)
        ),
        "fastest_unstable_rad_s": float(max(design.poles.real)),
        "n_alpha_g_rad": point.qualities.n_alpha_g_rad,
        "cap": point.qualities.cap,
        "level": point.qualities.level,
        "effectiveness_min_trim": point.authority.trim,
        "effectiveness_min_hold": point.authority.hold,
        "kinks": len(model.kinks),
        "kinks_short_period": sum(
            k.row in ("alpha'", "q'") and k.column in ("alpha", "q", "elevator") for k in model.kinks
        ),
        "no_trim": "",
    }
