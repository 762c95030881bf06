"""Plan -> Flight: builds plant, sensors, command, law and estimators from what the scenario says."""

from __future__ import annotations

import dataclasses

import numpy as np

from flightbed import factories, registry
from flightbed.blame import watched
from flightbed.command.base import profile
from flightbed.control.adaptation import Adaptation
from flightbed.control.design import peak_deflection
from flightbed.estimation.base import OnBoard
from flightbed.linear_aircraft import LinearAircraft
from flightbed.loop import Flight
from flightbed.plan import Plan, law_of
from flightbed.plant.base import Plant
from flightbed.plant.linear import LinearPlant
from flightbed.plant.nonlinear import JsbsimPlant, Start
from flightbed.sensors import SensorErrors, SensorNoise, Sensors
from flightbed.settings import ModelError, Scenario
from flightbed.signals import Health
from flightbed.units import DEG, FT, LB

_ROOM_M = 300.0  # flights that begin at sea level may go this far below it: the terrain lies lower still


def assemble(plan: Plan) -> Flight:
    """Build all parts of one flight, on a fresh FDM; every random stream is spawned from the scenario's seed."""
    with watched(plan.scenario.rates.control_hz):
        return _assembled(plan)


def _assembled(plan: Plan) -> Flight:
    scenario, aircraft, point, design = plan.scenario, plan.aircraft, plan.trim, plan.design
    control_hz, ticks = scenario.rates.control_hz, scenario.ticks
    seeds = np.random.SeedSequence(scenario.seed).spawn(3)  # append further consumers, never insert
    sensor_seed, air_seed, process_seed = seeds
    sensors, noise = scenario.sensors, sensor_noise(scenario)
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


def sensor_noise(scenario: Scenario) -> SensorNoise:
    """Return the noise of a scenario's sensors."""
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
