"""JSBSim as an airframe: derivatives of any motion at settled hidden states, and free flight from any motion."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from math import cos, sin, tan
from typing import Literal

import numpy as np
import numpy.typing as npt

from flightbed.aircraft.overlay import Aircraft
from flightbed.core.errors import AircraftError, InputError
from flightbed.core.units import DEG, FT, KT, LBF
from flightbed.fdm.jsbsim import Fdm, kinks
from flightbed.fdm.stock import StockAircraft
from flightbed.plant.base import Controls, Input, Motion, Rates, Response

_RESPONSE = (
    "accelerations/udot-ft_sec2", "accelerations/vdot-ft_sec2", "accelerations/wdot-ft_sec2",
    "accelerations/pdot-rad_sec2", "accelerations/qdot-rad_sec2", "accelerations/rdot-rad_sec2",
    "accelerations/Nz", "accelerations/n-pilot-z-norm", "accelerations/Ny",
)  # fmt: skip
_MOTION = (
    "velocities/vt-fps", "aero/alpha-rad", "attitude/theta-rad", "velocities/q-rad_sec", "position/h-sl-ft",
    "aero/beta-rad", "attitude/phi-rad", "velocities/p-rad_sec", "velocities/r-rad_sec", "attitude/psi-rad",
)  # fmt: skip
# The order matters: setting the attitude keeps the angle of attack, setting body velocities keeps the attitude.
_STATE = (
    "ic/h-sl-ft", "ic/phi-rad", "ic/theta-rad", "ic/psi-true-rad", "ic/u-fps", "ic/v-fps", "ic/w-fps",
    "ic/p-rad_sec", "ic/q-rad_sec", "ic/r-rad_sec",
)  # fmt: skip
_KINKS = {
    "mach": (("velocities/mach", 1.0),),
    "alpha": (("aero/alpha-rad", 1.0), ("aero/alpha-deg", DEG)),
    "beta": (("aero/beta-rad", 1.0), ("aero/beta-deg", DEG)),
    "altitude": (("atmosphere/density-altitude", FT), ("position/h-sl-ft", FT)),
}
_SELF_SETTLING = ("turbine", "rocket")  # engines that JSBSim settles itself in a step of zero length
_ELEVATOR, _THROTTLE = "fcs/elevator-cmd-norm", "fcs/throttle-cmd-norm"

_BESIDE_MACH = 1e-9

Engine = Literal["steady", "frozen"]
Array = npt.NDArray[np.float64]


class JsbsimAirframe:
    """The equations of motion of an aircraft at one condition; implements Airframe.

    Exactly one of mach, tas_m_s and cas_m_s gives the airspeed.

    Args:
        aircraft: an overlay aircraft or a stock JSBSim aircraft.
        mach, tas_m_s, cas_m_s: Mach number, true airspeed, calibrated airspeed (m/s).
        altitude_m: geometric altitude above sea level, m.
        cg_shift_cbar: c.g. shift in mean chords, aft positive.
        effectiveness: elevator effectiveness K, of moment and force alike; overlay aircraft only.
        engine: ``"steady"``: engines and propellers are at the steady state of each motion evaluated; ``"frozen"``: spool,
            propeller speed and manifold pressure keep the values at ``freeze``, and the throttle is not an input.

    Attributes:
        mach: Mach number of the condition, whichever speed was given.
        notes: description of the inputs, the engine and the control system.

    Raises:
        AircraftError: JSBSim cannot load the aircraft, or it has no airplane controls.
        InputError: an effectiveness other than 1 for a stock aircraft.

    """

    def __init__(
        self,
        aircraft: Aircraft | StockAircraft,
        *,
        altitude_m: float,
        mach: float | None = None,
        tas_m_s: float | None = None,
        cas_m_s: float | None = None,
        cg_shift_cbar: float = 0.0,
        effectiveness: float = 1.0,
        engine: Engine = "steady",
    ) -> None:
        given = {"ic/mach": mach, "ic/vt-fps": tas_m_s and tas_m_s / FT, "ic/vc-kts": cas_m_s and cas_m_s / KT}
        speeds = [(path, value) for path, value in given.items() if value is not None]
        if len(speeds) != 1:
            raise TypeError("exactly one of mach, tas_m_s and cas_m_s must be given")
        if effectiveness != 1.0 and isinstance(aircraft, StockAircraft):
            raise InputError(
                f"effectiveness: {aircraft.name} is a stock aircraft, its effectiveness cannot be changed "
                f"(got {effectiveness:g}); use an overlay aircraft"
            )
        self.name, self.aircraft, self._engine = aircraft.name, aircraft, engine
        self.altitude_m, self.effectiveness, self.cg_shift_cbar = altitude_m, effectiveness, cg_shift_cbar
        kinds = aircraft.engines if isinstance(aircraft, StockAircraft) else ("turbine",)
        self.powered = bool(kinds)
        self.throttle_acts = self.powered and engine == "steady"
        self._settles_engines = any(kind not in _SELF_SETTLING for kind in kinds)
        # A stock control system differentiates its inputs and feeds back accelerations one frame late: repeat until both settle.
        self._passes = 4 if isinstance(aircraft, StockAircraft) else 1
        self._fdm, self._controls = self._load(1.0 / 200.0)
        fdm = self._fdm
        fdm.set(*speeds[0])
        # At a Mach breakpoint, round-off would toggle switches as alpha and q are varied: move slightly below the breakpoint.
        for kink in kinks(aircraft, "velocities/mach"):
            if abs(fdm.getter("ic/mach")() - kink) < _BESIDE_MACH:
                fdm.set("ic/mach", kink - _BESIDE_MACH)
        self.airspeed_m_s, self.mach = fdm.getter("ic/vt-fps")() * FT, fdm.getter("ic/mach")()
        self.span_m = fdm.getter("metrics/bw-ft")() * FT
        self._set = [fdm.setter(path) for path in _STATE]
        self._get = [fdm.getter(path) for path in _RESPONSE]
        engines = [_indexed("propulsion/engine", i) + "/thrust-lbs" for i in range(len(kinds))]
        self._thrust = [fdm.getter(path) for path in engines if fdm.has(path)]
        self._frozen_throttle: float | None = None
        self.alpha_limits_rad, self.inputs = self._limits()
        self._kinks = {
            name: tuple(sorted({v * factor for path, factor in paths for v in kinks(aircraft, path)}))
            for name, paths in _KINKS.items()
        }
        acting = ("fcs/elevator-eff-rad", "fcs/elevator-force-rad") if isinstance(aircraft, Aircraft) else (_ELEVATOR,)
        self._kinks["elevator"] = tuple(sorted({v for path in acting for v in kinks(aircraft, path)}))
        position = next((p for p in ("fcs/elevator-pos-rad", "fcs/elevator-pos-deg") if fdm.has(p)), None)
        self._position = fdm.getter(position) if position else None
        self._position_unit = DEG if position and position.endswith("deg") else 1.0

    def _load(self, dt_s: float) -> tuple[Fdm, list[list[Callable[[float], object]]]]:
        """Return a fresh, configured FDM and the property setters of each control."""
        aircraft, fdm = self.aircraft, Fdm(self.aircraft, dt_s)
        if isinstance(aircraft, Aircraft):
            fdm.configure(altitude_m=self.altitude_m, cg_shift_cbar=self.cg_shift_cbar)
            names = aircraft.properties
            for share in ("effectiveness", "elevator_force"):
                fdm.set(names[share], self.effectiveness)
            paths = [[names["elevator_cmd_rad"]], [names["throttle_norm"]]]
            if aircraft.lateral:
                fdm.set(names["lateral_direct"], 1.0)
                paths += [[names["aileron_cmd_rad"]], [names["rudder_cmd_rad"]]]
        else:
            count = len(aircraft.engines)
            for i in range(count):  # before the engines are started
                for name in ("mixture", "advance"):
                    if fdm.has(path := _indexed(f"fcs/{name}-cmd-norm", i)):
                        fdm.set(path, 1.0)
            fdm.configure(altitude_m=self.altitude_m, cg_shift_cbar=self.cg_shift_cbar, gear_up=aircraft.retractable)
            throttles = [_indexed(_THROTTLE, i) for i in range(count)]
            paths = [[_ELEVATOR], [p for p in throttles if fdm.has(p)]]
        if len(paths) == 2:
            paths += [["fcs/aileron-cmd-norm"], ["fcs/rudder-cmd-norm"]]
        for path in (path for group in paths for path in group):
            if not fdm.has(path):
                raise AircraftError(
                    f"aircraft {aircraft.name}: has no property {path}; choose an aircraft with airplane controls"
                )
        return fdm, [[fdm.setter(path) for path in group] for group in paths]

    def _limits(self) -> tuple[tuple[float, float], tuple[Input, ...]]:
        aircraft = self.aircraft
        command = "normalized command; the model includes the aircraft's own control system"
        if isinstance(aircraft, StockAircraft):
            names = ("elevator", "throttle", "aileron", "rudder")
            lows = (-1.0, 0.0, -1.0, -1.0)
            inputs = tuple(
                Input(n, "1", low, 1.0, command if n != "throttle" else "normalized command, the same for all engines")
                for n, low in zip(names, lows, strict=True)
            )
            return (-10.0 * DEG, 25.0 * DEG), inputs
        surface = "surface position; the actuator is not part of the model"
        actuator, (low, high) = aircraft.actuator, aircraft.limits.throttle_norm
        lateral = [
            Input(
                name,
                "rad",
                aircraft.lateral[name].min_rad,
                aircraft.lateral[name].max_rad,
                "surface position; the stock control law is bypassed",
            )
            if aircraft.lateral
            else Input(name, "1", -1.0, 1.0, command)
            for name in ("aileron", "rudder")
        ]
        return aircraft.limits.alpha_rad, (
            Input("elevator", "rad", actuator.min_rad, actuator.max_rad, surface),
            Input("throttle", "1", low, high, "normalized command"),
            *lateral,
        )

    @property
    def notes(self) -> dict[str, str]:
        """Description of each input, the engine and the control system, by name."""
        engine = {
            "steady": "at the steady state of every motion: spool, propeller speed and manifold pressure follow without delay",
            "frozen": "held at trim: thrust changes only with speed and altitude, the throttle is not an input",
        }[self._engine]
        inputs = {i.name: i.source for i in self.inputs if i.name != "throttle" or self.throttle_acts}
        if isinstance(self.aircraft, StockAircraft):
            control = "the aircraft's own, included; lags and actuators settled, integrators held"
        elif self.aircraft.lateral:
            control = "none in pitch, roll and yaw; speed and altitude are free"
        else:
            control = "none in pitch; the stock laws in roll and yaw, settled, integrators held"
        absent = {"absent": f"set to 0: {', '.join(self._fdm.absent)}"} if self._fdm.absent else {}
        return inputs | {"engine": engine if self.powered else "none", "control_system": control} | absent

    def freeze(self, motion: Motion, controls: Controls) -> None:
        """Hold the engine at its state in this motion from now on; no effect unless ``engine`` is ``"frozen"``."""
        self._frozen_throttle = None
        self.respond(motion, controls)
        if self._engine == "frozen":
            self._frozen_throttle = controls.throttle

    def respond(self, motion: Motion, controls: Controls) -> Response:
        """Return the derivatives and load factors of a motion with the controls held."""
        v, alpha, theta, q, altitude, beta, phi, p, r, psi = motion
        ca, sa, cb, sb = cos(alpha), sin(alpha), cos(beta), sin(beta)
        u, side, w = v * ca * cb, v * sb, v * sa * cb
        ct, st, cp, sp = cos(theta), sin(theta), cos(phi), sin(phi)
        state = (altitude / FT, phi, theta, psi, u / FT, side / FT, w / FT, p, q, r)
        for put, value in zip(self._set, state, strict=True):
            put(value)
        self._command(controls)
        for _ in range(self._passes):
            self._fdm.settle()
        if self._settles_engines and self._frozen_throttle is None:
            self._fdm.settle_engines()
            self._fdm.settle()
        udot, vdot, wdot, pdot, qdot, rdot, nz, nz_pilot, ny = [get() for get in self._get]
        plane = u * udot + w * wdot
        speed2 = u * u + w * w
        turn = q * sp + r * cp
        rates = Rates(
            (plane + side * vdot) / v * FT,
            (u * wdot - w * udot) / speed2 * FT,
            q * cp - r * sp,
            qdot,
            u * st - (side * sp + w * cp) * ct,
            (vdot * speed2 - side * plane) / (v * v * speed2**0.5) * FT,
            p + tan(theta) * turn,
            pdot,
            rdot,
            turn / ct,
        )
        return Response(rates, nz, -nz_pilot, ny)

    def _command(self, controls: Controls) -> None:
        throttle = controls.throttle if self._frozen_throttle is None else self._frozen_throttle
        elevator, throttles, *lateral = self._controls
        elevator[0](controls.elevator)
        for put in throttles:
            put(throttle)
        for group, value in zip(lateral, controls[2:], strict=True):
            group[0](value)

    def breakpoints(self, quantity: str) -> Sequence[float]:
        """Return the kinks of tables and switches over ``"mach"``, ``"alpha"``, ``"beta"``, ``"altitude"`` or ``"elevator"``, SI."""
        return self._kinks[quantity]

    def thrust_n(self, motion: Motion, controls: Controls) -> float:
        """Return the thrust of all engines, N."""
        self.respond(motion, controls)
        return sum(get() for get in self._thrust) * LBF

    def elevator_position_rad(self, motion: Motion, controls: Controls) -> float | None:
        """Return the surface position at a motion, rad; None if the aircraft has no such property."""
        if self._position is None:
            return None
        self.respond(motion, controls)
        return self._position() * self._position_unit

    def engine_problem(self) -> str:
        """Report engines of a stock aircraft that do not run, a possible reason for a failed trim; empty if all run."""
        aircraft = self.aircraft
        if not (isinstance(aircraft, StockAircraft) and self._settles_engines):
            return ""
        v = self.airspeed_m_s
        self.respond(Motion(v, 0.03, 0.03, 0.0, self.altitude_m), Controls(0.0, 1.0))
        stopped = len(aircraft.engines) - self._fdm.engines_running(len(aircraft.engines))
        return (
            f"{stopped} of {len(aircraft.engines)} engines do not run after JSBSim starts them and settles their steady state"
            if stopped
            else ""
        )

    def free_flight(self, motion: Motion, controls: Controls, commands: Iterable[Controls], *, hz: int) -> Array:
        """Fly a sequence of commands from a motion, on a fresh FDM with actuators settled at ``controls``.

        The commands pass through the aircraft's own actuators, if it has any.

        Returns:
            (n, 10) states in the order and units of Motion, each row 1/hz s after its command was set.

        """
        copy = JsbsimAirframe.__new__(JsbsimAirframe)
        copy.__dict__.update(self.__dict__)
        copy._fdm, copy._controls = self._load(1.0 / hz)
        copy._set = [copy._fdm.setter(path) for path in _STATE]
        copy._get = [copy._fdm.getter(path) for path in _RESPONSE]
        read = [copy._fdm.getter(path) for path in _MOTION]
        run, rows = copy._fdm.exec.run, []
        copy._frozen_throttle = None
        copy.respond(motion, controls)
        for command in commands:
            copy._command(command)
            run()
            rows.append([get() for get in read])
        states = np.array(rows)
        states[:, [0, 4]] *= FT
        states[:, 9] = np.unwrap(states[:, 9]) - (2.0 * np.pi if states[0, 9] > np.pi else 0.0)
        return states


def _indexed(path: str, i: int) -> str:
    return path if i == 0 else f"{path}[{i}]"
