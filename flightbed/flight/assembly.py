"""Plan -> Flight: builds plant, sensors, command, law and estimators as specified by the scenario."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from flightbed.aircraft.overlay import Aircraft
from flightbed.avionics.onboard import OnBoard
from flightbed.command.base import Command, Profile, profile
from flightbed.config.kinds import ESTIMATORS, CommandSettings
from flightbed.config.tracebacks import error_context
from flightbed.control.base import Law
from flightbed.control.correction import Adaptation
from flightbed.control.design import peak_deflection
from flightbed.control.redesign import Redesign, RedesignedPitch
from flightbed.control.roll_yaw import RollYaw, RollYawWeights
from flightbed.core.signals import Health, LateralNoise, SensorNoise
from flightbed.core.units import DEG, FT, LB
from flightbed.estimation.base import Estimator, SurfacesEstimator, estimate_names
from flightbed.failures.base import HealthHistory, healthy
from flightbed.flight.lateral_axes import LateralAxes
from flightbed.flight.load_factor_axis import LoadFactorAxis
from flightbed.flight.parts import Flight
from flightbed.flight.plan import Plan, law_of, load_factor_law_of
from flightbed.models.linear_aircraft import LinearAircraft
from flightbed.plant.base import Plant
from flightbed.plant.gusts import gusts
from flightbed.plant.linear import LinearPlant
from flightbed.plant.nonlinear import JsbsimPlant, Start
from flightbed.plant.sensors import LateralSensors, SensorErrors, Sensors
from flightbed.scenario.tables import ModelError, Scenario

_ROOM_M = 300.0  # a flight that starts at sea level may descend this far below it: the terrain lies lower still


def assemble(plan: Plan) -> Flight:
    """Build all parts of one flight on a new FDM; every random stream is spawned from the scenario's seed."""
    with error_context(plan.scenario.rates.control_hz):
        return _assembled(plan)


def _assembled(plan: Plan) -> Flight:
    scenario, aircraft, point, design = plan.scenario, plan.aircraft, plan.trim, plan.design
    control_hz, ticks = scenario.rates.control_hz, scenario.ticks
    seeds = np.random.SeedSequence(scenario.seed).spawn(4)  # append further consumers, never insert
    sensor_seed, air_seed, process_seed, lateral_seed = seeds
    sensors, noise = scenario.sensors, sensor_noise(scenario)
    errors = SensorErrors(sensors.alpha_bias_deg * DEG, sensors.q_bias_deg_s * DEG, sensors.mach_error)
    lateral_noise = _lateral_noise(scenario) if plan.lateral else None
    onboard = OnBoard(
        design, noise, control_hz, plan.schedule, plan.lateral, lateral_noise, aircraft.actuator, scenario.rates.delay_ticks
    )  # fmt: skip
    onboard = _with_model_errors(onboard, scenario.model_error)
    health = health_history(scenario)
    estimators = [ESTIMATORS.build(e, onboard) for e in scenario.estimators]
    names = names_of(scenario, estimators)
    adaptation = scenario.adaptation
    plant = _plant(plan, health(0), air_seed, process_seed)
    load_factor = _load_factor(plan, plant)
    law = load_factor or law_of(scenario, design)
    lateral = _lateral(plan, plant, names, lateral_seed) if plan.lateral else None
    divides = adaptation.enabled and adaptation.method == "divide"
    return Flight(
        plant=plant,
        sensors=Sensors(noise, ticks=ticks, seed=sensor_seed, errors=errors),
        profile=_profile(scenario, scenario.command.rate(), scenario.command)
        if load_factor is None
        else _no_pitch_rate(ticks),
        health=health,
        law=law,
        adaptation=Adaptation(
            enabled=divides,
            estimator=names.index(adaptation.estimator) if divides and not adaptation.oracle else 0,
            floor=adaptation.floor,
            feedback=adaptation.feedback,
            min_rad=aircraft.actuator.min_rad,
            max_rad=aircraft.actuator.max_rad,
            caution=adaptation.caution,
            oracle=divides and adaptation.oracle,
            trim_rad=point.elevator_rad,
            peak_per_reference=2.0 * peak_deflection(design, plan.gains, scenario.command.filter_rad_s)
            if adaptation.limit_command and plan.gains
            else None,
        ),
        estimators=estimators,
        alpha_trim_rad=point.alpha_rad,
        control_hz=control_hz,
        floor_m=min(0.0, scenario.condition.altitude_ft * FT - _ROOM_M),
        delay_ticks=scenario.rates.delay_ticks,
        state_from=names.index(scenario.control.state_from) if scenario.control.state_from else None,
        redesign=None if divides or not adaptation.enabled else _redesign(scenario, law, lateral, names),
        lateral=lateral,
        load_factor=load_factor,
    )


def _profile(scenario: Scenario, command: Command, settings: CommandSettings) -> Profile:
    """Return a command, built from these settings, sampled over the flight and filtered by their prefilter."""
    return profile(
        command,
        ticks=scenario.ticks,
        control_hz=scenario.rates.control_hz,
        filter_rad_s=settings.filter_rad_s,
    )


def _no_pitch_rate(ticks: int) -> Profile:
    """Return the profile of a flight without a pitch-rate command: nan, because 0 would be a command."""
    return Profile(np.full(ticks, np.nan), np.full(ticks, np.nan))


def _load_factor(plan: Plan, plant: Plant) -> LoadFactorAxis | None:
    """Return the law of a flight commanded in g; None for other flights."""
    if plan.load_factor is None:
        return None
    scenario, hz = plan.scenario, plan.scenario.rates.control_hz
    assert isinstance(plant, JsbsimPlant)
    command = _profile(scenario, scenario.command.load_factor(), scenario.command)
    return LoadFactorAxis(
        plant,
        load_factor_law_of(scenario, plan.load_factor),
        list(zip(command.q_cmd_rad_s.tolist(), command.q_ref_rad_s.tolist(), strict=True)),
        scenario.control.throttle(airspeed_m_s=plan.trim.airspeed_m_s, control_hz=hz),
    )


def _redesign(scenario: Scenario, law: Law, lateral: LateralAxes | None, names: Sequence[str]) -> Redesign:
    assert isinstance(law, RedesignedPitch)
    estimator = scenario.adaptation.estimator
    lateral_names = [f"{estimator}.{surface}" for surface in ("aileron", "rudder")]
    estimated = lateral is not None and all(name in names for name in lateral_names)
    return Redesign(
        (law, names.index(estimator)),
        (lateral.law, (names.index(lateral_names[0]), names.index(lateral_names[1])))
        if lateral is not None and estimated
        else None,
        scenario.adaptation.floor,
    )


def names_of(scenario: Scenario, estimators: Sequence[Estimator | SurfacesEstimator]) -> list[str]:
    """Return the names of a flight's estimates, in order."""
    pairs = zip(scenario.estimators, estimators, strict=True)
    return [name for settings, estimator in pairs for name in estimate_names(settings.name, estimator)]


def _lateral(plan: Plan, plant: Plant, names: Sequence[str], seed: np.random.SeedSequence) -> LateralAxes:
    """Return roll and yaw control; the estimate NAME.SURFACE of the correcting estimator NAME, if any, corrects each surface."""
    scenario, aircraft, settings = plan.scenario, plan.aircraft, plan.scenario.lateral
    assert isinstance(plant, JsbsimPlant)
    assert isinstance(aircraft, Aircraft)
    assert plan.lateral is not None
    hz, ticks = scenario.rates.control_hz, scenario.ticks
    roll = _profile(scenario, settings.roll.rate(), settings.roll)
    sideslip = _profile(scenario, settings.sideslip.angle(), settings.sideslip)
    weights = RollYawWeights(*(getattr(settings, key) * DEG for key in _WEIGHTS))
    adaptation = scenario.adaptation
    corrections = []
    for surface in ("aileron", "rudder"):
        name, actuator = f"{adaptation.estimator}.{surface}", aircraft.lateral[surface]
        corrections.append(
            Adaptation(
                enabled=adaptation.enabled and adaptation.method == "divide" and (adaptation.oracle or name in names),
                estimator=names.index(name) if name in names else 0,
                floor=adaptation.floor,
                feedback=adaptation.feedback,
                min_rad=actuator.min_rad,
                max_rad=actuator.max_rad,
                caution=adaptation.caution,
                oracle=adaptation.enabled and adaptation.oracle,
            )
        )
    references = zip(roll.q_cmd_rad_s, roll.q_ref_rad_s, sideslip.q_cmd_rad_s, sideslip.q_ref_rad_s, strict=True)
    return LateralAxes(
        plant,
        LateralSensors(_lateral_noise(scenario), ticks=ticks, seed=seed),
        [(float(a), float(b), float(c), float(d)) for a, b, c, d in references],
        RollYaw(plan.lateral, weights, control_hz=hz),
        aileron=corrections[0],
        rudder=corrections[1],
        control_hz=hz,
    )


_WEIGHTS = ("beta_deg", "p_deg_s", "r_deg_s", "aileron_deg", "rudder_deg")


def _lateral_noise(scenario: Scenario) -> LateralNoise:
    sensors = scenario.sensors
    return LateralNoise(
        sensors.beta_std_deg * DEG,
        sensors.p_std_deg_s * DEG,
        sensors.r_std_deg_s * DEG,
        sensors.aileron_std_deg * DEG,
        sensors.rudder_std_deg * DEG,
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
            gusts=gusts(scenario.gusts),
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
        gusts=gusts(scenario.gusts),
        lateral=scenario.lateral.enabled,
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
        sensors.nz_std_g,
    )


def _with_model_errors(onboard: OnBoard, error: ModelError) -> OnBoard:
    """Return the on-board models with the scenario's errors in the pitching moment."""
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


def health_history(scenario: Scenario) -> HealthHistory:
    """Return the health over time from all failures of a scenario, in order of time; of two at once, the later in the file acts."""
    health: HealthHistory = healthy
    for failure in sorted(scenario.failures, key=lambda f: f.at_s):
        health = failure.build(health, scenario.rates.control_hz)
    return health
