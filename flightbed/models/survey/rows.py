"""Trim points and linear models -> plain values: the JSON document, and one row of a sweep's table."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from flightbed.aircraft.overlay import Aircraft
from flightbed.avionics.short_period import zero_order_hold
from flightbed.core.errors import InputError
from flightbed.core.units import DEG
from flightbed.fdm.jsbsim import version
from flightbed.models.linearize import LinearModel
from flightbed.models.modes import modes
from flightbed.models.survey.condition import Point, Query
from flightbed.models.trim import TrimPoint
from flightbed.models.validate import validate
from flightbed.plant.airframe import JsbsimAirframe


def trim_document(query: Query, airframe: JsbsimAirframe, point: TrimPoint) -> dict[str, Any]:
    """Return a trim point as plain values, the output of ``trim --format json``."""
    motion = point.motion
    position = airframe.elevator_position_rad(motion, point.controls)
    trim = {
        "alpha_deg": point.alpha_rad / DEG,
        "elevator_deg": None if position is None else position / DEG,  # as reported by JSBSim
        "throttle_norm": point.throttle_norm if airframe.powered else None,
        "theta_deg": point.theta_rad / DEG,
        "residual": point.residual,
        "beta_deg": motion.beta_rad / DEG,
        "p_deg_s": motion.p_rad_s / DEG,
        "q_deg_s": motion.q_rad_s / DEG,
        "r_deg_s": motion.r_rad_s / DEG,
    }
    for control, value in zip(airframe.inputs, point.controls, strict=True):
        if control.unit == "rad":
            trim[f"{control.name}_deg"] = value / DEG
        elif control.name != "throttle":
            trim[f"{control.name}_cmd_norm"] = value
    return {
        "aircraft": airframe.name,
        "condition": {
            "mach": airframe.mach,
            "airspeed_m_s": point.airspeed_m_s,
            "altitude_m": airframe.altitude_m,
            "gamma_rad": point.gamma_rad,
            "load_factor": query.load_factor,
            "bank_rad": query.bank_deg * DEG,
            "cg_shift_cbar": query.cg_shift_cbar,
            "effectiveness": query.effectiveness,
        },
        "trim": trim,
    }


def select_model(point: Point, *, part: str = "full", actuator: bool = False) -> LinearModel:
    """Return the requested part of the model, with the elevator's actuator as a state if ``actuator``. Raises InputError."""
    model = point.model if part == "full" else point.model.subset(part)
    if not actuator:
        return model
    aircraft = point.airframe.aircraft
    if not isinstance(aircraft, Aircraft):
        raise InputError(f"--actuator: stock aircraft {aircraft.name} has no actuator data; use an overlay aircraft")
    if part == "lateral":
        raise InputError("--actuator: adds the actuator of the elevator, which is no input of the lateral model")
    return model.with_actuator("elevator", aircraft.actuator.lag_rad_s)


def document(
    point: Point, *, control_hz: float = 100.0, validated: bool = False, part: str = "full", actuator: bool = False
) -> dict[str, Any]:
    """Return a linear model as plain values, the output of ``linearize --format json``; SI and radians except in ``trim``."""
    model, design, qualities = select_model(point, part=part, actuator=actuator), point.design, point.qualities
    held = zero_order_hold(model.A, model.B, 1.0 / control_hz)
    inputs = [name for name, _ in model.inputs]
    sources = {k: v for k, v in point.airframe.notes.items() if k in (*inputs, "engine", "control_system", "absent")}
    if actuator:
        sources["elevator_cmd"] = "command; the actuator's first-order lag is a state, the model has no rate limit"
    return {
        **({"validation": [asdict(r) for r in validate(point.airframe, point.model)]} if validated else {}),
        **trim_document(point.query, point.airframe, point.trim),
        "part": part,
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
            for mode in modes(model)
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
        "discrete": {"control_hz": control_hz, "A": held.A.tolist(), "B": held.b.tolist()},
        "authority": {
            "effectiveness_min_trim": point.authority.trim,
            "effectiveness_min_hold": point.authority.hold,
            "hold_from_alpha_rad": point.authority.alpha_rad,
        },
        "step_error": model.step_error,
        "drift": model.drift,
        "kinks": [str(kink) for kink in model.kinks],
        "sources": {**sources, "jsbsim": version(), "aircraft_sha256": point.airframe.aircraft.sha256},
    }


def row(point: Point) -> dict[str, Any]:
    """Return one row of a sweep's table; the keys contain the units."""
    model, design, trimmed = point.model, point.design, point.trim
    trim = trim_document(point.query, point.airframe, trimmed)["trim"]
    controls = {k: v for k, v in trim.items() if k not in ("alpha_deg", "theta_deg", "residual")}
    by_name = {mode.name: mode for mode in modes(model.subset("lateral"))}
    dutch = by_name.get("Dutch roll")
    return {
        "mach": point.airframe.mach,
        "altitude_ft": point.query.altitude_ft,
        "airspeed_m_s": trimmed.airspeed_m_s,
        "alpha_deg": trim["alpha_deg"],
        **{k: controls[k] for k in ("elevator_deg", "throttle_norm")},
        "residual": trimmed.residual,
        **dict(
            zip(("Z_alpha", "Z_q", "M_alpha", "M_q", "Z_delta", "M_delta"), [*design.A.ravel(), *design.b], strict=True)
        ),
        "fastest_unstable_rad_s": float(max(design.poles.real)),
        "n_alpha_g_rad": point.qualities.n_alpha_g_rad,
        "cap": point.qualities.cap,
        "level": point.qualities.level,
        "dutch_roll_omega_n_rad_s": dutch and dutch.omega_n_rad_s,
        "dutch_roll_zeta": dutch and dutch.zeta,
        "roll_time_constant_s": by_name["roll"].time_constant_s if "roll" in by_name else None,
        "spiral_rad_s": by_name["spiral"].eigenvalue.real if "spiral" in by_name else None,
        "effectiveness_min_trim": point.authority.trim,
        "effectiveness_min_hold": point.authority.hold,
        "kinks": len(model.kinks),
        "kinks_short_period": sum(
            k.row in ("alpha'", "q'") and k.column in ("alpha", "q", "elevator") for k in model.kinks
        ),
        **{k: v for k, v in controls.items() if k not in ("elevator_deg", "throttle_norm")},
        "no_trim": "",
    }
