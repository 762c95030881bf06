"""Scenario -> Flight -> folder: puts the parts together, flies them, and writes what came of it, whole or not at all."""

from __future__ import annotations

import dataclasses
import platform
import time
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from flightbed import factories, registry
from flightbed.bound import bound, design_models, schedule_models
from flightbed.command.base import profile
from flightbed.control.adaptation import Adaptation
from flightbed.control.design import peak_deflection
from flightbed.estimation.base import OnBoard
from flightbed.folder import check_target, write_run
from flightbed.linear_aircraft import LinearAircraft
from flightbed.loop import Flight
from flightbed.loop import fly as _fly
from flightbed.metrics import Metrics, at_stop, measure, snr_db
from flightbed.plan import Plan, law_of, plan
from flightbed.plant.base import Plant
from flightbed.plant.jsbsim import JsbsimPlant, Start
from flightbed.plant.linear import LinearPlant
from flightbed.sensors import SensorErrors, SensorNoise, Sensors
from flightbed.settings import ModelError, Scenario
from flightbed.signals import Health, Sample
from flightbed.trace import Trace, collect
from flightbed.units import DEG, FT, LB

__all__ = ["Plan", "Result", "assemble", "fly", "plan", "run"]

_ROOM_M = 300.0  # flights that begin at sea level may go this far below it: the terrain lies lower still


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


def assemble(plan: Plan) -> Flight:
    """Build all parts of one flight, on a fresh FDM; every random stream is spawned from the scenario's seed."""
    scenario, aircraft, point, design = plan.scenario, plan.aircraft, plan.trim, plan.design
    control_hz, ticks = scenario.rates.control_hz, scenario.ticks
    seeds = np.random.SeedSequence(scenario.seed).spawn(3)  # append further consumers, never insert
    sensor_seed, air_seed, process_seed = seeds
    sensors, noise = scenario.sensors, _noise(scenario)
    errors = SensorErrors(sensors.alpha_bias_deg * DEG, sensors.q_bias_deg_s * DEG, sensors.mach_error)
    onboard = _mistaken(OnBoard(design, noise, control_hz, plan.schedule), scenario.model_error)
    health = factories.failing(scenario)
    names = [estimator.name for estimator in scenario.estimators]
    adaptation = scenario.adaptation
    return Flight(
        plant=_plant(plan, health(0), air_seed, process_seed),
        sensors=Sensors(noise, ticks=ticks, seed=sensor_seed, errors=errors),
        profile=profile(
            registry.factory("commands", scenario.command.kind)(scenario.command),
            ticks=ticks,
            control_hz=control_hz,
            filter_rad_s=scenario.command.filter_rad_s,
        ),
        health=health,
        law=law_of(scenario, design),
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
        state_from=names.index(scenario.control.state_from) if scenario.control.state_from else None,
    )


def _plant(plan: Plan, health: Health, air_seed: np.random.SeedSequence, process_seed: np.random.SeedSequence) -> Plant:
    scenario, aircraft, point = plan.scenario, plan.aircraft, plan.trim
    if isinstance(aircraft, LinearAircraft):
        noise = scenario.process_noise
        return LinearPlant(
            aircraft.design,
            control_hz=scenario.rates.control_hz,
            airspeed_m_s=aircraft.airspeed_m_s,
            mach=aircraft.mach,
            altitude_m=aircraft.altitude_ft * FT,
            gusts=factories.gusts(scenario.gusts),
            process_noise=(noise.alpha_std_deg_s * DEG, noise.q_std_deg_s2 * DEG),
            seed=process_seed,
        )
    start = Start(
        scenario.condition.altitude_ft * FT,
        point.airspeed_m_s,
        point.alpha_rad,
        point.theta_rad,
        point.elevator_rad,
        point.throttle_norm,
    )
    return JsbsimPlant(
        aircraft,
        start,
        control_hz=scenario.rates.control_hz,
        plant_hz=scenario.rates.plant_hz,
        cg_shift_cbar=scenario.aircraft.cg_shift_cbar + scenario.model_error.cg_shift_cbar,
        fuel_kg=scenario.model_error.fuel_lbs * LB,
        turbulence=scenario.atmosphere.turbulence,
        seed=int(air_seed.generate_state(1)[0] >> 1),
        health=health,
        gusts=factories.gusts(scenario.gusts),
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


def run(scenario: Scenario, out: str | Path | None = None, *, rerun: bool = True, replace: bool = True) -> Result:
    """Fly a scenario; with ``out``, leave a folder with scenario, trace, metrics and recording.

    Nothing is left behind when the flight is interrupted.

    Args:
        scenario: what to fly.
        out: folder to write; None writes nothing.
        rerun: whether the folder gets a Rerun recording.
        replace: an ``out`` that holds an earlier run is replaced, whole, once the flight is done, and any other folder
            that is not empty is refused; if false, the first free one of OUT, OUT-2, OUT-3, ... is taken instead.

    Raises:
        InputError, NotComputableError, as the parts do; OutputError when the folder cannot be written.

    """
    target = None if out is None else check_target(Path(out), replace=replace)
    planned = plan(scenario)
    began = time.perf_counter()
    trace, metrics = fly_plan(planned)
    wall = time.perf_counter() - began
    result = Result(planned, trace, metrics, _summary(planned, trace, metrics, wall))
    if target is None:
        return result
    return dataclasses.replace(result, folder=write_run(result, target, rerun=rerun, replace=replace))


def fly_plan(plan: Plan) -> tuple[Trace, Metrics]:
    """Fly what is planned, once, and measure it."""
    scenario = plan.scenario
    samples = _fly(assemble(plan))
    trace = collect(samples, estimators=[e.name for e in scenario.estimators], control_hz=scenario.rates.control_hz)
    trace = _with_bound(plan, trace)
    alpha_trim_deg = plan.trim.alpha_rad / DEG
    return trace, measure(trace, alpha_trim_deg=alpha_trim_deg, failed_at_s=_failed_at_s(scenario, trace))


def _failed_at_s(scenario: Scenario, trace: Trace) -> float | None:
    """Return the time of the first failure that the flight reached."""
    failed_at = first_failure_s(scenario)
    return failed_at if failed_at is not None and failed_at <= trace["t_s"][-1] else None


def _with_bound(plan: Plan, trace: Trace) -> Trace:
    """Add the Cramer-Rao bound of K, where there is a true model to compute it from."""
    hz, estimators = plan.scenario.rates.control_hz, plan.scenario.estimators
    if isinstance(plan.aircraft, LinearAircraft):
        models = design_models(trace, plan.aircraft.design, control_hz=hz)
    elif plan.schedule is not None:
        models = schedule_models(trace, plan.schedule, control_hz=hz)
    else:
        return trace
    window = next((e.window for e in estimators if e.memory == "window"), None)
    return trace.with_column("effectiveness_bound", bound(trace, models, _noise(plan.scenario), window=window))


def first_failure_s(scenario: Scenario) -> float | None:
    """Return the time of the tick at which the first failure acts, or None."""
    ticks = [factories.failure_tick(failure, scenario.rates.control_hz) for failure in scenario.failures]
    return min(ticks) / scenario.rates.control_hz if ticks else None


def _summary(plan: Plan, trace: Trace, metrics: Metrics, wall_s: float) -> dict[str, Any]:
    scenario, design = plan.scenario, plan.design
    failed_at = _failed_at_s(scenario, trace)
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
        "versions": {
            "flightbed": version("flightbed"),
            "python": platform.python_version(),
            **{p: version(p) for p in ("jsbsim", "numpy", "scipy", "numba", "rerun-sdk")},
        },
    }
