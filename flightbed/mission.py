"""Scenario -> Flight -> folder: puts the parts together, flies them, and writes what came of it, whole or not at all."""

from __future__ import annotations

import dataclasses
import platform
import time
from array import array
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from flightbed import factories, registry
from flightbed.aircraft import Aircraft, load_aircraft, load_path
from flightbed.bound import bound
from flightbed.command.base import profile
from flightbed.control.adaptation import Adaptation
from flightbed.control.base import Gains, Law
from flightbed.control.design import peak_deflection
from flightbed.errors import AircraftError, DesignError, NoTrimError
from flightbed.estimation.base import OnBoard
from flightbed.failures.effector import healthy
from flightbed.folder import check_target, write_run
from flightbed.linearize import LinearModel, linearize
from flightbed.loop import Flight
from flightbed.loop import fly as _fly
from flightbed.metrics import Metrics, at_stop, measure, snr_db
from flightbed.pacing import Clock, paced, punctuality, with_timings
from flightbed.plant.airframe import JsbsimAirframe
from flightbed.plant.jsbsim import JsbsimPlant, Start
from flightbed.scenario import ModelError, Scenario
from flightbed.schedule import Schedule, load_schedule
from flightbed.sensors import SensorErrors, SensorNoise, Sensors
from flightbed.short_period import ShortPeriod, short_period
from flightbed.signals import Sample
from flightbed.trace import Trace, collect
from flightbed.trim import TrimPoint, trim
from flightbed.units import DEG, FT, LB

_ROOM_M = 300.0  # flights that begin at sea level may go this far below it: the terrain lies lower still


@dataclass(frozen=True)
class Plan:
    """What is known before take-off: the trimmed aircraft and the design that rests on it."""

    scenario: Scenario
    aircraft: Aircraft
    trim: TrimPoint
    model: LinearModel
    design: ShortPeriod
    gains: Gains | None  # None for a law that does not tell
    schedule: Schedule | None  # None if no estimator asks for it


@dataclass(frozen=True)
class Result:
    """A flown scenario.

    Attributes:
        folder: where it was written; None when it was not.
        summary: what metrics.json holds.

    """

    plan: Plan
    trace: Trace
    metrics: Metrics
    summary: dict[str, Any]
    folder: Path | None = None


def plan(scenario: Scenario) -> Plan:
    """Trim, linearize and design; the plan's scenario names the very aircraft. Raises AircraftError, NoTrimError, DesignError."""
    aircraft = load_aircraft(scenario.aircraft.model)
    if scenario.aircraft.sha256 not in ("", aircraft.sha256):
        raise AircraftError(
            f"aircraft {scenario.aircraft.model} is not the one that this scenario was flown with (aircraft.sha256 differs); "
            'clear the key, --set aircraft.sha256="", to fly it all the same'
        )
    scenario = scenario.with_aircraft(load_path(scenario.aircraft.model), aircraft.sha256)
    condition = scenario.condition
    airframe = JsbsimAirframe(
        aircraft,
        mach=condition.mach,
        altitude_m=condition.altitude_ft * FT,
        cg_shift_cbar=scenario.aircraft.cg_shift_cbar,
    )
    try:
        point = trim(airframe, gamma_rad=condition.gamma_deg * DEG)
    except NoTrimError as error:
        error.args = (f"no trim at Mach {condition.mach:.2f}, {condition.altitude_ft:.0f} ft: {error}",)
        raise
    model = linearize(airframe, point)
    design = short_period(model, actuator_rad_s=aircraft.actuator.lag_rad_s)
    law = _law(scenario, design)
    if scenario.adaptation.limit_command and getattr(law, "gains", None) is None:
        raise DesignError(
            f"adaptation.limit_command: the law '{scenario.control.law}' does not tell its gains, set it to false"
        )
    schedule = None
    if any(estimator.model == "scheduled" for estimator in scenario.estimators):
        fingerprint = (aircraft.sha256, repr(scenario.aircraft.cg_shift_cbar), version("jsbsim"), version("flightbed"))
        schedule = load_schedule(airframe, throttle=point.throttle_norm, fingerprint=fingerprint)
    return Plan(scenario, aircraft, point, model, design, getattr(law, "gains", None), schedule)


def _law(scenario: Scenario, design: ShortPeriod) -> Law:
    law: Law = registry.factory("laws", scenario.control.law)(scenario.control, design, scenario.rates.control_hz)
    return law


def assemble(plan: Plan) -> Flight:
    """Build all parts of one flight, on a fresh FDM; every random stream is spawned from the scenario's seed."""
    scenario, aircraft, point, design = plan.scenario, plan.aircraft, plan.trim, plan.design
    control_hz, ticks = scenario.rates.control_hz, scenario.ticks
    sensor_seed, air_seed = np.random.SeedSequence(scenario.seed).spawn(2)  # append further consumers, never insert
    sensors, noise = scenario.sensors, _noise(scenario)
    errors = SensorErrors(sensors.alpha_bias_deg * DEG, sensors.q_bias_deg_s * DEG, sensors.mach_error)
    onboard = _mistaken(OnBoard(design, noise, control_hz, plan.schedule), scenario.model_error)
    effectiveness = healthy
    for failure in sorted(scenario.failures, key=lambda f: f.at_s):  # of two at once the later in the file acts
        effectiveness = registry.factory("failures", failure.kind)(failure, effectiveness, control_hz)
    names = [estimator.name for estimator in scenario.estimators]
    adaptation = scenario.adaptation
    start = Start(
        scenario.condition.altitude_ft * FT,
        point.airspeed_m_s,
        point.alpha_rad,
        point.theta_rad,
        point.elevator_rad,
        point.throttle_norm,
    )
    return Flight(
        plant=JsbsimPlant(
            aircraft,
            start,
            control_hz=control_hz,
            plant_hz=scenario.rates.plant_hz,
            cg_shift_cbar=scenario.aircraft.cg_shift_cbar + scenario.model_error.cg_shift_cbar,
            fuel_kg=scenario.model_error.fuel_lbs * LB,
            turbulence=scenario.atmosphere.turbulence,
            seed=int(air_seed.generate_state(1)[0] >> 1),
            effectiveness=effectiveness(0),
        ),
        sensors=Sensors(noise, ticks=ticks, seed=sensor_seed, errors=errors),
        profile=profile(
            registry.factory("commands", scenario.command.kind)(scenario.command),
            ticks=ticks,
            control_hz=control_hz,
            filter_rad_s=scenario.command.filter_rad_s,
        ),
        effectiveness=effectiveness,
        law=_law(scenario, design),
        adaptation=Adaptation(
            enabled=adaptation.enabled,
            estimator=names.index(adaptation.estimator) if adaptation.enabled and not adaptation.oracle else 0,
            floor=adaptation.floor,
            feedback=adaptation.feedback,
            min_rad=aircraft.actuator.min_rad,
            max_rad=aircraft.actuator.max_rad,
            caution=adaptation.caution,
            oracle=adaptation.enabled and adaptation.oracle,
            trim_rad=point.elevator_rad,
            peak_per_reference=2.0 * peak_deflection(design, plan.gains, scenario.command.filter_rad_s)
            if adaptation.limit_command and plan.gains
            else None,
        ),
        estimators=[registry.factory("estimators", e.kind)(e, onboard) for e in scenario.estimators],
        alpha_trim_rad=point.alpha_rad,
        floor_m=min(0.0, scenario.condition.altitude_ft * FT - _ROOM_M),
        delay_ticks=scenario.rates.delay_ticks,
    )


def _noise(scenario: Scenario) -> SensorNoise:
    sensors = scenario.sensors
    return SensorNoise(
        sensors.alpha_std_deg * DEG,
        sensors.q_std_deg_s * DEG,
        sensors.elevator_std_deg * DEG,
        sensors.mach_std,
        sensors.altitude_std_ft * FT,
        sensors.theta_std_deg * DEG,
        sensors.phi_std_deg * DEG,
    )


def _mistaken(onboard: OnBoard, error: ModelError) -> OnBoard:
    """Return what is on board with the scenario's errors in the pitching moment."""
    design, schedule = onboard.design, onboard.schedule
    if (error.cm_alpha, error.cm_q, error.cm_delta) == (1.0, 1.0, 1.0):
        return onboard
    A, b = design.A.copy(), design.b.copy()
    A[1] *= error.cm_alpha, error.cm_q
    b[1] *= error.cm_delta
    if schedule:
        schedule = schedule.scaled(
            cm_alpha=error.cm_alpha, cm_q=error.cm_q, cm_delta=error.cm_delta, about_rad=design.alpha_trim_rad
        )
    return dataclasses.replace(onboard, design=dataclasses.replace(design, A=A, b=b), schedule=schedule)


def fly(scenario: Scenario) -> Iterator[Sample]:
    """Trim, design and fly a scenario, yielding one Sample per control tick."""
    return _fly(assemble(plan(scenario)))


def run(
    scenario: Scenario,
    out: str | Path | None = None,
    *,
    rerun: bool = True,
    replace: bool = True,
    pace: Clock | None = None,
) -> Result:
    """Fly a scenario; with ``out``, leave a folder with scenario, trace, metrics and recording.

    Nothing is left behind when the flight is interrupted.

    Args:
        scenario: what to fly.
        out: folder to write; None writes nothing.
        rerun: whether the folder gets a Rerun recording.
        replace: an ``out`` that holds an earlier run is replaced, whole, once the flight is done, and any other folder
            that is not empty is refused; if false, the first free one of OUT, OUT-2, OUT-3, ... is taken instead.
        pace: clock that the ticks keep to, ``flightbed.WallClock()`` for real time; the trace then has the columns of
            ``pacing.with_timings``, and the same others. None flies as fast as it can.

    Raises:
        InputError, NotComputableError, as the parts do; OutputError when the folder cannot be written.

    """
    target = None if out is None else check_target(Path(out), replace=replace)
    planned = plan(scenario)
    flight = assemble(planned)
    samples, control_hz, timings = _fly(flight), scenario.rates.control_hz, array("q")
    if pace is not None:
        samples = paced(samples, control_hz=control_hz, clock=pace, record=timings.extend)
    began = time.perf_counter()
    trace = collect(samples, estimators=[e.name for e in scenario.estimators], control_hz=control_hz)
    wall = time.perf_counter() - began
    if pace is not None:
        trace = with_timings(trace, timings)
    if planned.schedule is not None:
        window = next((e.window for e in scenario.estimators if e.memory == "window"), None)
        at_best = bound(trace, planned.schedule, _noise(scenario), control_hz=control_hz, window=window)
        trace = trace.with_column("effectiveness_bound", at_best)
    failed_at = first_failure_s(scenario)
    if failed_at is not None and failed_at > trace["t_s"][-1]:
        failed_at = None  # the flight ended before it
    metrics = measure(trace, alpha_trim_deg=planned.trim.alpha_rad / DEG, failed_at_s=failed_at)
    result = Result(planned, trace, metrics, _summary(planned, trace, metrics, failed_at, wall))
    if target is None:
        return result
    return dataclasses.replace(result, folder=write_run(result, target, rerun=rerun, replace=replace))


def first_failure_s(scenario: Scenario) -> float | None:
    """Return the time of the tick at which the first failure acts, or None."""
    ticks = [factories.failure_tick(failure, scenario.rates.control_hz) for failure in scenario.failures]
    return min(ticks) / scenario.rates.control_hz if ticks else None


def _summary(plan: Plan, trace: Trace, metrics: Metrics, failed_at: float | None, wall_s: float) -> dict[str, Any]:
    scenario, design = plan.scenario, plan.design
    kept = punctuality(trace, control_hz=scenario.rates.control_hz)
    flown_s = len(trace) / scenario.rates.control_hz
    alpha = np.abs(trace["alpha_deg"] - plan.trim.alpha_rad / DEG)
    before = trace["t_s"] < (failed_at or np.inf)  # a failure at 0 leaves no "before": then all of it
    q_max, alpha_max = (float(np.max(v[before])) for v in (np.abs(trace["q_deg_s"]), alpha))
    return {
        "scenario": scenario.name,
        "seed": scenario.seed,
        **metrics.to_dict(),
        "snr_db": snr_db(
            alpha_max=alpha_max,
            q_max=q_max,
            alpha_std=scenario.sensors.alpha_std_deg,
            q_std=scenario.sensors.q_std_deg_s,
            poles=design.poles,
        ),
        "ended": "departed" if metrics.departed else "time" if len(trace) == scenario.ticks else "ground",
        "failed_at_s": failed_at,
        "flown_s": flown_s,
        "elevator_at_stop_share": float(np.mean(at_stop(trace, plan.aircraft.actuator))),
        "bank_max_deg": float(np.max(np.abs(trace["phi_deg"]))),
        "trim": {
            "alpha_deg": plan.trim.alpha_rad / DEG,
            "elevator_deg": plan.trim.elevator_rad / DEG,
            "throttle_norm": plan.trim.throttle_norm,
            "residual": plan.trim.residual,
        },
        "short_period": {
            "A": design.A.tolist(),
            "b": design.b.tolist(),
            "poles_rad_s": [[p.real, p.imag] for p in design.poles.tolist()],
        },
        "gains": {} if plan.gains is None else vars(plan.gains),
        "aircraft_sha256": plan.aircraft.sha256,
        "wall_time_s": wall_s,
        "real_time_factor": flown_s / wall_s,
        "realtime": None if kept is None else dataclasses.asdict(kept),
        "versions": {
            "flightbed": version("flightbed"),
            "python": platform.python_version(),
            **{p: version(p) for p in ("jsbsim", "numpy", "scipy", "numba", "rerun-sdk")},
        },
    }
