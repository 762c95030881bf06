"""JSBSim as a plant and as an airframe. The only module that imports jsbsim.

What is handled here, because JSBSim does not say: the step must be set before the model is loaded (components copy it);
hidden states (actuator, kinematics) settle only while the trim flag is set; engines must run before the last run_ic;
sea level is ground contact unless the terrain is lowered; a mistyped property is created silently and a read-only one
swallows writes; a reused FDM is not bit-identical to a fresh one; one FDM loads one model.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Sequence
from functools import cache
from math import cos, pi, sin
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

os.environ.setdefault("JSBSIM_DEBUG", "0")  # before the import: the banner is printed by the constructor

import jsbsim

from flightbed.aircraft import Aircraft
from flightbed.errors import AircraftError
from flightbed.plant.base import Controls, Motion, Rates, Response
from flightbed.signals import Truth
from flightbed.tables import breakpoints
from flightbed.units import FT, INCH, KT

_TERRAIN_FT = -2000.0  # below sea level: no ground contact, no ground effect at h = 0
_TURBULENCE_MODEL = 4  # MIL-F-8785C spectra, Tustin-discretized (JSBSim's ttTustin)
# MIL-F-8785C: above 2000 ft JSBSim's index of the exceedance curve; below 1000 ft the wind at 20 ft, 15, 30 and 45 kt.
_SEVERITY = MappingProxyType({"light": (3, 25.3), "moderate": (4, 50.6), "severe": (6, 75.9)})

_RESPONSE = (
    "velocities/u-fps", "velocities/w-fps", "accelerations/udot-ft_sec2", "accelerations/wdot-ft_sec2",
    "accelerations/qdot-rad_sec2", "accelerations/Nz", "accelerations/n-pilot-z-norm",
)  # fmt: skip

Getter = Callable[[], float]
Setter = Callable[[float], object]


def version() -> str:
    """Return the version of the installed jsbsim."""
    return str(jsbsim.__version__)


class Start(NamedTuple):
    """A trimmed start: where a flight begins. SI, radians."""

    altitude_m: float
    airspeed_m_s: float
    alpha_rad: float
    theta_rad: float
    elevator_rad: float
    throttle_norm: float


class _Fdm:
    """One FGFDMExec with one model loaded, and its properties by name."""

    def __init__(self, aircraft: Aircraft, dt_s: float) -> None:
        root = Path(jsbsim.get_default_root_dir())
        self.exec = jsbsim.FGFDMExec(str(root))
        self.exec.set_debug_level(0)
        self.exec.set_dt(dt_s)  # before the load
        loaded = self.exec.load_model_with_paths(
            aircraft.name, str(_model_folder(aircraft)), str(root / "engine"), str(root / "systems")
        )
        if not loaded:
            raise AircraftError(f"aircraft {aircraft.name}: JSBSim refuses the patched model")
        self._manager = self.exec.get_property_manager()
        # Found at run time instead, a missing property would abort the process.
        for file, path in aircraft.references():
            if self._manager.get_node(path) is None:
                raise AircraftError(f"aircraft {aircraft.name}: {file} refers to {path}, which JSBSim does not have")

    def node(self, path: str) -> jsbsim.FGPropertyNode:
        node = self._manager.get_node(path)
        if node is None:
            raise AircraftError(f"JSBSim has no property {path}")
        return node

    def getter(self, path: str) -> Getter:
        return self.node(path).get_double_value

    def setter(self, path: str) -> Setter:
        node = self.node(path)
        if not node.get_attribute(jsbsim.Attribute.WRITE):
            raise AircraftError(f"JSBSim's property {path} is read-only")
        return node.set_double_value

    def set(self, path: str, value: float) -> None:
        self.setter(path)(value)

    def configure(self, *, altitude_m: float, cg_shift_cbar: float) -> None:
        """Clean configuration in free air, engine running, c.g. shifted aft.

        The aft c.g. is had by moving the aerodynamic reference point forward: same moments, same weight.
        """
        self.set("ic/terrain-elevation-ft", _TERRAIN_FT)
        self.set("gear/gear-cmd-norm", 0.0)
        self.set("gear/gear-pos-norm", 0.0)
        self.set("ic/h-sl-ft", altitude_m / FT)
        if cg_shift_cbar:
            inches = (
                self.getter("metrics/aero-rp-x-in")() - cg_shift_cbar * self.getter("metrics/cbarw-ft")() * FT / INCH
            )
            self.set("metrics/aero-rp-x-in", inches)
        self.set("propulsion/set-running", -1)

    def settle(self) -> None:
        """Apply the initial conditions with actuators and kinematics at their targets."""
        self.exec.set_trim_status(True)
        self.exec.run_ic()
        self.exec.set_trim_status(False)


@cache
def _patched(aircraft: Aircraft) -> bytes:
    stock = Path(jsbsim.get_default_root_dir()) / aircraft.stock_file
    try:
        return aircraft.patch(stock.read_bytes())
    except OSError as error:
        raise AircraftError(f"aircraft {aircraft.name}: stock model {aircraft.stock_file}: {error.strerror}") from None


@cache
def _breakpoints(aircraft: Aircraft, path: str) -> tuple[float, ...]:
    return breakpoints(_patched(aircraft), path)


@cache
def _workspace() -> tempfile.TemporaryDirectory[str]:
    return tempfile.TemporaryDirectory(prefix="flightbed-")


@cache
def _model_folder(aircraft: Aircraft) -> Path:
    """Write the patched model where JSBSim can load it; the folder goes with the process."""
    folder = Path(tempfile.mkdtemp(dir=_workspace().name))
    (folder / aircraft.name).mkdir()
    (folder / aircraft.name / f"{aircraft.name}.xml").write_bytes(_patched(aircraft))
    return folder


class JsbsimAirframe:
    """The equations of motion of an aircraft at one condition; an Airframe.

    Exactly one of mach, tas_m_s and cas_m_s gives the airspeed.

    Args:
        aircraft: the overlay aircraft.
        mach, tas_m_s, cas_m_s: Mach number, true airspeed, calibrated airspeed (m/s).
        altitude_m: geometric altitude above sea level, m.
        cg_shift_cbar: c.g. shift in mean chords, aft positive.
        effectiveness: share of the elevator's deflection that acts.

    Attributes:
        mach: Mach number of the condition, however it was given.

    """

    def __init__(
        self,
        aircraft: Aircraft,
        *,
        altitude_m: float,
        mach: float | None = None,
        tas_m_s: float | None = None,
        cas_m_s: float | None = None,
        cg_shift_cbar: float = 0.0,
        effectiveness: float = 1.0,
    ) -> None:
        given = {"ic/mach": mach, "ic/vt-fps": tas_m_s and tas_m_s / FT, "ic/vc-kts": cas_m_s and cas_m_s / KT}
        speeds = [(path, value) for path, value in given.items() if value is not None]
        if len(speeds) != 1:
            raise TypeError("exactly one of mach, tas_m_s and cas_m_s must be given")
        self.name, self.actuator, self.limits = aircraft.name, aircraft.actuator, aircraft.limits
        self._fdm = fdm = _Fdm(aircraft, 1.0 / 200.0)
        fdm.configure(altitude_m=altitude_m, cg_shift_cbar=cg_shift_cbar)
        fdm.set(*speeds[0])
        fdm.set(aircraft.properties["effectiveness"], effectiveness)
        self.altitude_m, self.effectiveness, self.cg_shift_cbar = altitude_m, effectiveness, cg_shift_cbar
        self.airspeed_m_s, self.mach = fdm.getter("ic/vt-fps")() * FT, fdm.getter("ic/mach")()
        self._set_altitude = fdm.setter("ic/h-sl-ft")
        self._set_airspeed = fdm.setter("ic/vt-fps")
        self._set_alpha = fdm.setter("ic/alpha-rad")
        self._set_gamma = fdm.setter("ic/gamma-rad")
        self._set_q = fdm.setter("ic/q-rad_sec")
        self._set_elevator = fdm.setter(aircraft.properties["elevator_cmd_rad"])
        self._set_throttle = fdm.setter(aircraft.properties["throttle_norm"])
        self._get = [fdm.getter(p) for p in _RESPONSE]
        self._kinks = {
            "mach": _breakpoints(aircraft, "velocities/mach"),
            "alpha": _breakpoints(aircraft, "aero/alpha-rad"),
            "elevator": _breakpoints(aircraft, "fcs/elevator-eff-rad"),
        }

    def respond(self, motion: Motion, controls: Controls) -> Response:
        """Return derivatives and load factors at a motion with the controls held there."""
        # Order matters: altitude keeps the kind of speed that was set last, alpha keeps the flight path.
        self._set_altitude(motion.altitude_m / FT)
        self._set_airspeed(motion.airspeed_m_s / FT)
        self._set_alpha(motion.alpha_rad)
        self._set_gamma(motion.theta_rad - motion.alpha_rad)
        self._set_q(motion.q_rad_s)
        self._set_elevator(controls.elevator_rad)
        self._set_throttle(controls.throttle_norm)
        self._fdm.settle()
        u, w, udot, wdot, qdot, nz, nz_pilot = (get() for get in self._get)
        v2 = u * u + w * w
        climb = motion.airspeed_m_s * sin(motion.theta_rad - motion.alpha_rad)
        rates = Rates((u * udot + w * wdot) / v2**0.5 * FT, (u * wdot - w * udot) / v2, motion.q_rad_s, qdot, climb)
        return Response(rates, nz, -nz_pilot)

    def breakpoints(self, quantity: str) -> Sequence[float]:
        """Return where the tables and switches over a quantity have kinks: ``"mach"``, ``"alpha"`` or ``"elevator"``."""
        return self._kinks[quantity]


class JsbsimPlant:
    """One flight of an aircraft, on a fresh FDM; a Plant.

    Args:
        aircraft: the overlay aircraft.
        start: trimmed start.
        control_hz, plant_hz: rates; the plant rate is an integer multiple of the control rate.
        cg_shift_cbar: c.g. shift in mean chords, aft positive.
        turbulence: ``"none"``, ``"light"``, ``"moderate"`` or ``"severe"`` (MIL-F-8785C, Tustin).
        seed: of the turbulence.
        effectiveness: share of the elevator's deflection that acts from the start; the trim does not know of it.

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
        effectiveness: float = 1.0,
    ) -> None:
        self._fdm = fdm = _Fdm(aircraft, 1.0 / plant_hz)
        self._substeps = plant_hz // control_hz
        self._stops = aircraft.actuator.min_rad, aircraft.actuator.max_rad
        fdm.configure(altitude_m=start.altitude_m, cg_shift_cbar=cg_shift_cbar)
        fdm.set("ic/vt-fps", start.airspeed_m_s / FT)
        fdm.set("ic/alpha-rad", start.alpha_rad)
        fdm.set("ic/gamma-rad", start.theta_rad - start.alpha_rad)
        fdm.set(aircraft.properties["throttle_norm"], start.throttle_norm)
        self._command = fdm.setter(aircraft.properties["elevator_cmd_rad"])
        self._effectiveness = fdm.setter(aircraft.properties["effectiveness"])
        self._command(start.elevator_rad)
        self._effectiveness(effectiveness)
        fdm.settle()
        if turbulence != "none":  # after the last run_ic: the Tustin filters divide by dt, which is 0 in there
            fdm.set("simulation/randomseed", seed)
            curve, wind_fps = _SEVERITY[turbulence]
            fdm.set("atmosphere/turbulence/milspec/severity", curve)
            fdm.set("atmosphere/turbulence/milspec/windspeed_at_20ft_AGL-fps", wind_fps)
            fdm.set("atmosphere/turb-type", _TURBULENCE_MODEL)
        self._run = fdm.exec.run
        self._elevator = fdm.getter(aircraft.properties["elevator_rad"])
        self._get = tuple(
            fdm.getter(p)
            for p in (
                "aero/alpha-rad",
                "velocities/q-rad_sec",
                "attitude/theta-rad",
                "attitude/phi-rad",
                "attitude/psi-rad",
                "velocities/vt-fps",
                "velocities/mach",
                "position/h-sl-ft",
                "position/lat-gc-rad",
                "position/long-gc-rad",
                "accelerations/Nz",
            )
        )
        self._latitude, self._longitude = self._get[8](), self._get[9]()
        self._north_m = fdm.getter("position/radius-to-vehicle-ft")() * FT  # per rad of latitude
        self._east_m = self._north_m * cos(self._latitude)
        self._mean_elevator = self._elevator()

    def sense(self, effectiveness: float = 1.0) -> Truth:
        """Return the truth at the present tick; the effectiveness is the one that acts from now on."""
        (alpha, q, theta, phi, psi, airspeed, mach, altitude, latitude, longitude, nz) = [get() for get in self._get]
        return Truth(
            alpha,
            q,
            theta,
            phi,
            psi - 2.0 * pi if psi > pi else psi,
            airspeed * FT,
            mach,
            altitude * FT,
            (latitude - self._latitude) * self._north_m,
            (longitude - self._longitude) * self._east_m,
            nz,
            self._elevator(),
            self._mean_elevator,
            effectiveness,
        )

    def advance(self, elevator_cmd_rad: float, effectiveness: float, following: float) -> None:
        """Fly one control period with the command held and this share of the elevator's deflection acting.

        JSBSim computes at the end of a frame the accelerations that move the aircraft over the next one: the last frame of
        a period is given the effectiveness of the ``following`` period, which so begins exactly at its tick.

        The command is clamped to the stops first: JSBSim's rate limiter runs on beyond them and comes back late.
        """
        low, high = self._stops
        self._command(low if elevator_cmd_rad < low else high if elevator_cmd_rad > high else elevator_cmd_rad)
        self._effectiveness(effectiveness)
        elevator, run, total = self._elevator, self._run, 0.0
        for _ in range(self._substeps - 1):
            # A frame moves the aircraft with the accelerations, and so the deflection, of the frame before.
            total += elevator()
            run()
        self._effectiveness(following)
        total += elevator()
        run()
        self._mean_elevator = total / self._substeps
