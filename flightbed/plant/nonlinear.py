"""The nonlinear plant: one flight of an overlay aircraft in JSBSim."""

from __future__ import annotations

from math import cos
from operator import call
from types import MappingProxyType
from typing import NamedTuple

from flightbed.aircraft.overlay import Aircraft
from flightbed.core.signals import HEALTHY, Health, LateralTruth, Truth
from flightbed.core.units import FT
from flightbed.fdm.jsbsim import Fdm
from flightbed.plant.gusts import Gusts, calm
from flightbed.plant.properties import LATERAL, READ, plain_fields
from flightbed.plant.surfaces import Surface

_new = tuple.__new__
_NEGLIGIBLE_WIND_FPS = 1e-6
_TURBULENCE_MODEL = 4  # MIL-F-8785C spectra, Tustin-discretized (JSBSim's ttTustin)
# MIL-F-8785C: above 2000 ft JSBSim's index of the exceedance curve; below 1000 ft the wind speed at 20 ft (15, 30, 45 kt), ft/s.
_SEVERITY = MappingProxyType({"light": (3, 25.3), "moderate": (4, 50.6), "severe": (6, 75.9)})


class Start(NamedTuple):
    """Initial condition of a flight: a trim point. SI, radians."""

    altitude_m: float
    airspeed_m_s: float
    alpha_rad: float
    theta_rad: float
    elevator_rad: float
    throttle_norm: float


class JsbsimPlant:
    """One flight of an overlay aircraft, on a fresh FDM; implements SteeredPlant and ThrottledPlant.

    Args:
        aircraft: the overlay aircraft.
        start: initial condition, a trim point.
        control_hz, plant_hz: rates; the plant rate is an integer multiple of the control rate.
        cg_shift_cbar: c.g. shift in mean chords, aft positive.
        turbulence: ``"none"``, ``"light"``, ``"moderate"`` or ``"severe"`` (MIL-F-8785C, Tustin).
        seed: seed of the turbulence.
        health: health from the start; not included in the trim.
        gusts: vertical speed of the air over time, m/s, up positive; not included in the trim.
        fuel_kg: fuel beyond that of the model file, distributed over the tanks in proportion; not included in the trim.
        lateral: whether ``steer`` commands aileron and rudder in place of the stock laws; requires ``aircraft.lateral``.

    Attributes:
        getters, origin: arguments of ``properties.fields``: functions that read JSBSim, and the initial position.
        elevator_mean_rad, gust_up_m_s, elevator_offset_rad: the fields of Truth that JSBSim does not hold.

    """

    def __init__(
        self,
        aircraft: Aircraft,
        start: Start,
        *,
        control_hz: int,
        plant_hz: int,
        cg_shift_cbar: float = 0.0,
        turbulence: str = "none",
        seed: int = 0,
        health: Health = HEALTHY,
        gusts: Gusts = calm,
        fuel_kg: float = 0.0,
        lateral: bool = False,
    ) -> None:
        self._fdm = fdm = Fdm(aircraft, 1.0 / plant_hz)
        self._substeps, self._plant_hz = plant_hz // control_hz, plant_hz
        self._leading_frames = range(self._substeps - 1)
        fdm.configure(altitude_m=start.altitude_m, cg_shift_cbar=cg_shift_cbar)
        fdm.add_fuel(fuel_kg)
        fdm.set("ic/vt-fps", start.airspeed_m_s / FT)
        fdm.set("ic/alpha-rad", start.alpha_rad)
        fdm.set("ic/gamma-rad", start.theta_rad - start.alpha_rad)
        fdm.set(aircraft.properties["throttle_norm"], start.throttle_norm)
        alpha, beta = fdm.getter("aero/alpha-rad"), fdm.getter("aero/beta-rad")
        # A floating surface aligns with the flow: the elevator's trailing edge rises (negative) as alpha increases; the rudder's moves
        # left (positive) when the air comes from the right; the two ailerons oppose each other and do not move.
        float_angles = {"elevator": lambda: -alpha(), "aileron": None, "rudder": beta}
        actuators = {"elevator": aircraft.actuator, **(aircraft.lateral if lateral else {})}
        self._surfaces = [
            Surface(fdm, aircraft.properties, name, actuator, float_angles[name])
            for name, actuator in actuators.items()
        ]
        self._elevator_surface, self._lateral_surfaces = self._surfaces[0], self._surfaces[1:]
        self._command, self._stops = self._elevator_surface.put, self._elevator_surface.stops
        self._shares = [fdm.setter(aircraft.properties[f"{name}_effectiveness"]) for name in [*actuators][1:]]
        if lateral:
            fdm.set(aircraft.properties["lateral_direct"], 2.0)
        self._moment = fdm.setter(aircraft.properties["effectiveness"])
        self._force = fdm.setter(aircraft.properties["elevator_force"])
        self._shift_cg = fdm.cg_shifter()
        self._throttle = fdm.setter(aircraft.properties["throttle_norm"])
        self._command(start.elevator_rad)
        self._gusts, self._gust_down = gusts, fdm.setter("atmosphere/gust-down-fps")
        self._frames, self.gust_up_m_s = 0, 0.0
        self._set_actuator_faults(health)
        self._set_health(health)
        fdm.settle()
        if turbulence != "none":  # after the last run_ic: the Tustin filters divide by dt, which is 0 during run_ic
            fdm.set("simulation/randomseed", seed)
            # The gust axes follow the wind. Without wind, round-off decides their direction, 0 or pi, and so the sign of the gust's
            # pitch rate. With a headwind (flights start heading north) gusts reach the nose first.
            fdm.set("atmosphere/wind-north-fps", -_NEGLIGIBLE_WIND_FPS)
            curve, wind_fps = _SEVERITY[turbulence]
            fdm.set("atmosphere/turbulence/milspec/severity", curve)
            fdm.set("atmosphere/turbulence/milspec/windspeed_at_20ft_AGL-fps", wind_fps)
            fdm.set("atmosphere/turb-type", _TURBULENCE_MODEL)
        self._run = fdm.exec.run
        self._elevator = self._elevator_surface.position
        self.getters = tuple(fdm.getter(p) for p in (*READ, aircraft.properties["elevator_rad"]))
        latitude, longitude = fdm.getter("position/lat-gc-rad")(), fdm.getter("position/long-gc-rad")()
        north_m = fdm.getter("position/radius-to-vehicle-ft")() * FT  # per rad of latitude
        self.origin = latitude, longitude, north_m, north_m * cos(latitude)
        self.elevator_mean_rad = self._elevator()
        self._lateral_getters = tuple(fdm.getter(p) for p in LATERAL) + tuple(
            s.position for s in self._lateral_surfaces
        )
        self._lateral_commands = (0.0, 0.0)
        self._lateral_means = [surface.position() for surface in self._lateral_surfaces]
        self._lateral_totals = [0.0] * len(self._lateral_surfaces)

    def _set_health(self, health: Health) -> None:
        """Set effectiveness, c.g. shift and aerodynamic faults; JSBSim's accelerations include them from the end of the next frame."""
        self._health = health
        self._moment(health.effectiveness)
        self._force(health.elevator_force)
        self._shift_cg(health.cg_shift_cbar)
        for put, share in zip(self._shares, health[3:5], strict=True) if self._shares else ():
            put(share)
        for surface, fault in zip(self._surfaces, health.faults, strict=False):
            surface.set_aerodynamic_fault(fault)
        self.elevator_offset_rad = self._elevator_surface.offset_rad
        self._needs_frame_updates = (
            self._gusts is not calm or bool(self._lateral_surfaces) or any(surface.floats for surface in self._surfaces)
        )

    def _set_actuator_faults(self, health: Health) -> None:
        """Set the faults of the actuators, effective from the next frame."""
        for surface, fault in zip(self._surfaces, health.faults, strict=False):
            surface.set_actuator_fault(fault)
        self._stops = self._elevator_surface.stops

    def _prepare_frame(self) -> None:
        """Set the gust and the floating surfaces for the next frame; accumulate the aileron and rudder positions.

        JSBSim first moves the aircraft and then computes alpha and the accelerations, so the gust is that at the end of the frame.
        """
        if self._gusts is not calm:
            self._frames += 1
            self.gust_up_m_s = self._gusts(self._frames / self._plant_hz)
            self._gust_down(-self.gust_up_m_s / FT)
        for surface in self._surfaces:
            if surface.floats:
                surface.update_float()
        self.elevator_offset_rad = self._elevator_surface.offset_rad
        for i, surface in enumerate(self._lateral_surfaces):
            self._lateral_totals[i] += surface.position()

    def sense(self, health: Health = HEALTHY) -> Truth:
        """Return the truth at the current tick; ``health`` applies from this tick on."""
        # tuple.__new__ skips the constructor: its twenty positional arguments cost as much as reading four properties.
        return _new(
            Truth,
            plain_fields(
                *self.origin, *map(call, self.getters),
                self.elevator_mean_rad, *health[:3], self.gust_up_m_s, self.elevator_offset_rad,
            ),
        )  # fmt: skip

    def sense_lateral(self, health: Health) -> LateralTruth:
        """Return the truth of roll and yaw at the current tick; ``health`` applies from this tick on."""
        aileron, rudder = self._lateral_surfaces
        beta, p, r, aileron_rad, rudder_rad = map(call, self._lateral_getters)
        mean_aileron, mean_rudder = self._lateral_means
        return LateralTruth(
            beta, p, r, aileron_rad, rudder_rad, mean_aileron, mean_rudder,
            health.aileron, health.rudder, aileron.offset_rad, rudder.offset_rad,
        )  # fmt: skip

    def steer(self, aileron_cmd_rad: float, rudder_cmd_rad: float) -> None:
        """Command aileron and rudder for the next control period; ``advance`` applies the command after setting actuator faults."""
        self._lateral_commands = aileron_cmd_rad, rudder_cmd_rad

    def throttle(self, throttle_norm: float) -> None:
        """Command the engine, 0 to 1, from the next control period on."""
        self._throttle(throttle_norm)

    def advance(self, elevator_cmd_rad: float, health: Health, following: Health) -> None:
        """Fly one control period with the elevator command held at this health.

        JSBSim computes the accelerations that move the aircraft over a frame at the end of the previous frame. The last frame of
        a period therefore uses the health of the ``following`` period, which thus takes effect exactly at its tick.

        The command is clamped to the stops first: JSBSim's rate limiter winds up beyond them.
        """
        if health is not self._health:  # differs from ``following`` of the last period
            self._set_health(health)
            self._set_actuator_faults(health)
        low, high = self._stops
        self._command(low if elevator_cmd_rad < low else high if elevator_cmd_rad > high else elevator_cmd_rad)
        elevator, run, total, more = self._elevator, self._run, 0.0, self._needs_frame_updates
        if more:
            for surface, rad in zip(self._lateral_surfaces, self._lateral_commands, strict=False):
                surface.command(rad)
        for _ in self._leading_frames:
            if more:
                self._prepare_frame()
            # A frame moves the aircraft with the accelerations, hence the deflection, of the previous frame.
            total += elevator()
            run()
        if following is not health:
            self._set_health(following)
            more = more or self._needs_frame_updates
        if more:
            self._prepare_frame()
        total += elevator()
        run()
        self.elevator_mean_rad = total / self._substeps
        if more:
            self._lateral_means = [total / self._substeps for total in self._lateral_totals]
            self._lateral_totals = [0.0] * len(self._lateral_totals)
        if following is not health:
            self._set_actuator_faults(following)
