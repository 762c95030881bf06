"""Scenario -> Plan: trim, linearization and control design before take-off."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import version

from flightbed.aircraft.overlay import Aircraft, load_path
from flightbed.avionics.lateral import LateralDirectional
from flightbed.avionics.schedule import Schedule
from flightbed.avionics.short_period import ShortPeriod
from flightbed.control.base import Gains, Law
from flightbed.control.load_factor.design import LoadFactorDesign, LoadFactorLaw
from flightbed.control.stability_margins import Margins, pitch_margins
from flightbed.core.actuator import Actuator
from flightbed.core.errors import AircraftError, DesignError, NoTrimError, ScenarioError
from flightbed.core.sources import SourcesChangedError, closure_sha256
from flightbed.core.units import DEG, FT
from flightbed.models.envelope import pitch_point, pitch_points
from flightbed.models.linear_aircraft import LinearAircraft, load_flyable
from flightbed.models.linearize import linearize
from flightbed.models.reduce import lateral_directional, short_period
from flightbed.models.tabulate import load_schedule
from flightbed.models.trim import TrimPoint, trim
from flightbed.plant.airframe import JsbsimAirframe
from flightbed.plant.base import Controls, Motion
from flightbed.scenario.reading import Scenario
from flightbed.scenario.tables import Condition

_STANDARD = Condition(mach=0.8, altitude_ft=20000.0)  # condition at which the schedule is tabulated


@dataclass(frozen=True)
class Plan:
    """The trimmed aircraft and the control design at its trim point, both known before take-off."""

    scenario: Scenario
    aircraft: Aircraft | LinearAircraft
    trim: TrimPoint
    design: ShortPeriod
    gains: Gains | None  # None for a law without the attribute
    schedule: Schedule | None  # None if no estimator uses it
    lateral: LateralDirectional | None = None  # None if the stock laws control roll and yaw
    margins: Margins | None = None  # of the pitch loop; None for a law without gains
    load_factor: LoadFactorDesign | None = None  # None if the flight is not commanded in g
    notes: tuple[str, ...] = ()  # on the settings, one line each; the terminal and the report show them

    @property
    def actuators(self) -> Mapping[str, Actuator]:
        """Actuators of the commanded surfaces by name: of the elevator, or of all three."""
        lateral = self.aircraft.lateral if self.lateral is not None and isinstance(self.aircraft, Aircraft) else {}
        return {"elevator": self.aircraft.actuator, **lateral}


def plan(scenario: Scenario) -> Plan:
    """Trim, linearize and design; the scenario of the plan names the aircraft by path and fingerprint.

    A linear aircraft is its own design model, in deviations from trim.

    Raises:
        AircraftError: the aircraft cannot be loaded, or is not the one that the scenario names.
        NoTrimError: there is no equilibrium at the initial condition.
        DesignError: the law cannot be designed.
        ScenarioError: the aircraft does not support a setting; lists every problem.

    """
    scenario, aircraft, notes = bind(scenario)
    schedule, lateral, load_factor = None, None, None
    if isinstance(aircraft, LinearAircraft):
        if problems := _unsupported_by_linear(scenario, aircraft):
            raise ScenarioError(problems)
        altitude_m = aircraft.altitude_ft * FT
        point = TrimPoint(Motion(aircraft.airspeed_m_s, 0.0, 0.0, 0.0, altitude_m), Controls(0.0, 0.0), 0.0)
        design = aircraft.design
    else:
        airframe, point = _trimmed(scenario, aircraft)
        model = linearize(airframe, point)
        design = short_period(model, actuator_rad_s=aircraft.actuator.lag_rad_s)
        if scenario.lateral.enabled:
            lags = aircraft.lateral["aileron"].lag_rad_s, aircraft.lateral["rudder"].lag_rad_s
            lateral = lateral_directional(model, airframe, actuators_rad_s=lags)
        if scenario.in_g:
            load_factor = LoadFactorDesign(
                pitch_points(aircraft, cg_shift_cbar=scenario.aircraft.cg_shift_cbar),
                pitch_point(model, mach=airframe.mach, altitude_m=airframe.altitude_m),
                aircraft.actuator.lag_rad_s,
                (aircraft.actuator.min_rad, aircraft.actuator.max_rad),
                point.elevator_rad,
            )
        if any(estimator.needs_schedule for estimator in scenario.estimators):
            shift = repr(scenario.aircraft.cg_shift_cbar)
            sources = _tabulating_sources()
            fingerprint = None if sources is None else (aircraft.sha256, shift, version("jsbsim"), sources)
            schedule = load_schedule(
                airframe,
                throttle=point.throttle_norm,
                fingerprint=fingerprint,
                standard=lambda: _airframe(aircraft, _STANDARD, scenario.aircraft.cg_shift_cbar),
            )
    law = law_of(scenario, design) if load_factor is None else load_factor_law_of(scenario, load_factor)
    gains = getattr(law, "gains", None)
    if not isinstance(gains, Gains):
        gains = None
    if scenario.adaptation.limit_command and gains is None:
        raise DesignError(
            f"adaptation.limit_command: needs a law with gains (got '{scenario.control.law}'); set it to false"
        )
    margins = None if gains is None else _margins(scenario, design, gains)
    return Plan(scenario, aircraft, point, design, gains, schedule, lateral, margins, load_factor, notes)


def bind(scenario: Scenario) -> tuple[Scenario, Aircraft | LinearAircraft, tuple[str, ...]]:
    """Return the scenario with path and fingerprint of its aircraft, the aircraft, and a note if the scenario named an equal one.

    Raises AircraftError: the aircraft cannot be loaded, or is neither the one that the scenario names nor equal to it.
    """
    model, named = scenario.aircraft.model, scenario.aircraft.sha256
    aircraft = load_flyable(model)
    notes: tuple[str, ...] = ()
    if isinstance(aircraft, Aircraft) and named != aircraft.sha256 and named in aircraft.equal_to:
        notes = (
            f"aircraft.sha256: the scenario names {named[:12]}..., an earlier version of {aircraft.name}; "
            f"its equal_to lists that version as flying the same traces, so {aircraft.sha256[:12]}... flies",
        )
    elif named not in ("", aircraft.sha256):
        raise AircraftError(
            f"aircraft {model} is not the aircraft of this scenario (aircraft.sha256 differs); "
            'clear the key, --set aircraft.sha256="", to fly it anyway'
        )
    return scenario.with_aircraft(load_path(model), aircraft.sha256), aircraft, notes


def _margins(scenario: Scenario, design: ShortPeriod, gains: Gains) -> Margins:
    adaptation, hz = scenario.adaptation, scenario.rates.control_hz
    redesign = adaptation.enabled and adaptation.method == "redesign"
    return pitch_margins(
        design,
        (lambda K: scenario.control.gains_at(design, hz, K)) if redesign else lambda _K: gains,
        control_hz=hz,
        corrected=adaptation.enabled and not redesign,
        effective=adaptation.enabled and not redesign and adaptation.feedback == "effective",
    )


def _tabulating_sources() -> str | None:
    """Return the digest of the sources that tabulate a schedule; None if it is not known: then nothing is cached."""
    try:
        return closure_sha256("flightbed.models.tabulate", "flightbed.plant.airframe")
    except (OSError, SourcesChangedError):
        return None


def law_of(scenario: Scenario, design: ShortPeriod) -> Law:
    """Return a new law as specified by the scenario. Raises DesignError."""
    law: Law = scenario.control.build(design, scenario.rates.control_hz)
    return law


def load_factor_law_of(scenario: Scenario, design: LoadFactorDesign) -> LoadFactorLaw:
    """Return a new load-factor law as specified by the scenario. Raises DesignError."""
    law: LoadFactorLaw = scenario.control.build(design, scenario.rates.control_hz)
    return law


def _trimmed(scenario: Scenario, aircraft: Aircraft) -> tuple[JsbsimAirframe, TrimPoint]:
    if scenario.process_noise.alpha_std_deg_s or scenario.process_noise.q_std_deg_s2:
        raise ScenarioError(
            ["process_noise: only linear aircraft have process noise; set atmosphere.turbulence instead"]
        )
    if problems := _unsupported_by_overlay(scenario, aircraft):
        raise ScenarioError(problems)
    condition = scenario.condition
    airframe = _airframe(aircraft, condition, scenario.aircraft.cg_shift_cbar)
    try:
        return airframe, trim(airframe, gamma_rad=condition.gamma_deg * DEG)
    except NoTrimError as error:
        error.args = (f"no trim at Mach {condition.mach:.2f}, {condition.altitude_ft:.0f} ft: {error}",)
        raise


def _airframe(aircraft: Aircraft, condition: Condition, cg_shift_cbar: float) -> JsbsimAirframe:
    altitude_m = condition.altitude_ft * FT
    return JsbsimAirframe(aircraft, mach=condition.mach, altitude_m=altitude_m, cg_shift_cbar=cg_shift_cbar)


def _unsupported_by_overlay(scenario: Scenario, aircraft: Aircraft) -> list[str]:
    """Return the settings that an overlay aircraft does not support, one message per line."""
    problems = []
    if scenario.lateral.enabled and not aircraft.lateral:
        problems.append(
            f"lateral.enabled: must be false with the aircraft {aircraft.name}, whose overlay has no [aileron] and [rudder]"
        )
    for i, failure in enumerate(scenario.failures):
        wanted = failure.actuator_property
        if wanted is not None and wanted not in aircraft.properties:
            problems.append(
                f"failures.{i}.kind: '{failure.kind}' needs properties.{wanted}, which the overlay of {aircraft.name} does not name"
            )
    return problems


def _unsupported_by_linear(scenario: Scenario, aircraft: LinearAircraft) -> list[str]:
    """Return the settings that a linear aircraft does not support, one message per line."""
    wanted: list[tuple[str, object, object]] = [
        ("condition.mach", scenario.condition.mach, aircraft.mach),
        ("condition.altitude_ft", scenario.condition.altitude_ft, aircraft.altitude_ft),
        ("condition.gamma_deg", scenario.condition.gamma_deg, 0.0),
        ("aircraft.cg_shift_cbar", scenario.aircraft.cg_shift_cbar, 0.0),
        ("atmosphere.turbulence", scenario.atmosphere.turbulence, "none"),
        ("model_error.cg_shift_cbar", scenario.model_error.cg_shift_cbar, 0.0),
        ("lateral.enabled", scenario.lateral.enabled, False),
        ("model_error.fuel_lbs", scenario.model_error.fuel_lbs, 0.0),
        *(
            (f"estimators.{i}.model", e.model, "short-period")
            for i, e in enumerate(scenario.estimators)
            if e.needs_schedule
        ),
    ]
    faults = [
        f"failures.{i}.kind: '{f.kind}' is an actuator failure; the linear aircraft {aircraft.name} models none, choose another kind"
        for i, f in enumerate(scenario.failures)
        if f.actuator is not None
    ]
    faults += [
        f"failures.{i}.kind: '{f.kind}' moves the c.g., which the linear aircraft {aircraft.name} does not model; choose another kind"
        for i, f in enumerate(scenario.failures)
        if f.moves_cg
    ]
    if scenario.in_g:
        faults.append(
            f"control.law: '{scenario.control.law}' is scheduled over the envelope, which the linear aircraft {aircraft.name} "
            "does not have; choose another law"
        )
    return faults + [
        f"{key}: must be {only!r} with the linear aircraft {aircraft.name} (got {got!r})"
        for key, got, only in wanted
        if got != only
    ]
