"""The pitch model tabulated over the envelope, and its cache."""

from __future__ import annotations

import hashlib
import io
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from zipfile import BadZipFile

import numpy as np
import numpy.typing as npt

from flightbed.avionics.schedule import BY_ELEVATOR, Schedule
from flightbed.core.atmosphere import standard_air
from flightbed.core.files import cache_folder, touch_used, write_cached
from flightbed.core.units import DEG, G0
from flightbed.plant.base import Airframe, Controls, Motion

Array = npt.NDArray[np.float64]


_FORMAT = 3  # version of the cache file: increase it when the tabulated quantities change
_MOST_BYTES = 100_000_000  # of all cached schedules together


MACHS, ALPHAS_RAD = (0.2, 2.0), (-10.0 * DEG, 45.0 * DEG)


_FILL_RAD, _NODE_GAP = 1.0 * DEG, 1e-7


_PROBE_Q = 0.1


def build_schedule(airframe: Airframe, *, throttle: float) -> Schedule:
    """Tabulate an airframe; about 15,000 evaluations, 0.25 s.

    Args:
        airframe: the aircraft at any condition; its altitude is used, speed and alpha are varied.
        throttle: throttle setting of the flight; thrust is tabulated over Mach number and altitude.

    """
    mach = nodes(airframe.breakpoints("mach"), MACHS, None)
    alpha = nodes(airframe.breakpoints("alpha"), ALPHAS_RAD, _FILL_RAD)
    stops = airframe.inputs[0].low, airframe.inputs[0].high
    elevator = np.unique([*(e for e in airframe.breakpoints("elevator") if stops[0] < e < stops[1]), 0.0, *stops])
    elevator = elevator[np.diff(elevator, prepend=-np.inf) > 1e-3]
    altitude = np.linspace(-1000.0, 19000.0, 41)
    sound, E = airframe.airspeed_m_s / airframe.mach, len(elevator)
    pressure = standard_air(airframe.altitude_m).pressure_pa
    per_newton = _per_newton(airframe)
    table = np.empty((len(mach), len(alpha), BY_ELEVATOR + 2 * E))
    for i, M in enumerate(mach.tolist()):
        speed, qbar = M * sound, 0.7 * pressure * M * M
        thrust = _thrust_at(airframe, speed, airframe.altitude_m, throttle) * per_newton
        for j, a in enumerate(alpha.tolist()):

            def rates(
                q: float, d: float, a: float = a, speed: float = speed, thrust: Array = thrust
            ) -> tuple[float, float]:
                """Return the aerodynamic normal and pitch accelerations in level flight, theta = alpha."""
                r = airframe.respond(Motion(speed, a, a, q, airframe.altitude_m), Controls(d, throttle)).rates
                normal = (r.alpha - q) * speed - G0 - (thrust[1] * np.cos(a) - thrust[0] * np.sin(a))
                return float(normal), r.q - float(thrust[2])

            n, m = rates(0.0, 0.0)
            nq, mq = rates(_PROBE_Q, 0.0)
            row = table[i, j]
            row[:BY_ELEVATOR] = np.array([n, (nq - n) / _PROBE_Q * speed, m, (mq - m) / _PROBE_Q * speed]) / qbar
            for k, d in enumerate(elevator.tolist()):
                nd, md = rates(0.0, d)
                row[BY_ELEVATOR + k], row[BY_ELEVATOR + E + k] = (nd - n) / qbar, (md - m) / qbar
    thrusts = _thrust(airframe, throttle, mach, altitude)
    return Schedule(mach, alpha, elevator, altitude, table, thrusts, per_newton, np.array([airframe.span_m]))


def load_schedule(
    airframe: Airframe, *, throttle: float, fingerprint: Sequence[str] | None, standard: Callable[[], Airframe]
) -> Schedule:
    """Build a schedule, or read its tables from the cache; the thrust is always computed.

    The tables always describe the aircraft at one standard condition: gravity varies with altitude, and a flight's result must not
    depend on earlier flights.

    The cache is in ``$XDG_CACHE_HOME/flightbed`` (default ``~/.cache/flightbed``); if it cannot be read or written, it is ignored.

    Args:
        airframe: airframe of the flight, for the thrust.
        throttle: throttle setting of the flight.
        standard: creates the airframe at the standard condition if the cache has no tables.
        fingerprint: everything that determines the tables: hash of the aircraft, c.g. shift, versions, sources; None: no cache.

    """
    if fingerprint is None:
        return with_throttle(build_schedule(standard(), throttle=0.0), airframe, throttle)
    key = hashlib.sha256("\n".join([str(_FORMAT), *fingerprint]).encode()).hexdigest()[:32]
    name = f"schedule-{key}.npz"
    try:
        file = cache_folder() / name
        with np.load(io.BytesIO(file.read_bytes())) as held:
            schedule = Schedule(**{name: held[name] for name in Schedule.__dataclass_fields__})
        touch_used(file)
        return with_throttle(schedule, airframe, throttle)
    except (OSError, ValueError, KeyError, EOFError, BadZipFile):
        schedule = build_schedule(standard(), throttle=0.0)
    buffer = io.BytesIO()
    np.savez(buffer, **{name: getattr(schedule, name) for name in Schedule.__dataclass_fields__})
    with suppress(OSError):
        write_cached(cache_folder() / name, buffer.getvalue(), pattern="schedule-*.npz", most_bytes=_MOST_BYTES)
    return with_throttle(schedule, airframe, throttle)


def with_throttle(schedule: Schedule, airframe: Airframe, throttle: float) -> Schedule:
    """Return the schedule with the thrust of another throttle setting, 0 to 1."""
    return replace(schedule, thrust_n=_thrust(airframe, throttle, schedule.mach, schedule.altitude_m))


def nodes(breakpoints: Sequence[float], span: tuple[float, float], fill: float | None) -> Array:
    """Return nodes: the ends of the span, a pair around each breakpoint inside it, and multiples of ``fill`` between them."""
    inside = [b for b in breakpoints if span[0] < b < span[1]]
    nodes = [span[0], *(b + side for b in inside for side in (-_NODE_GAP, _NODE_GAP)), span[1]]
    if fill:
        more = np.arange(np.ceil(span[0] / fill), np.floor(span[1] / fill) + 1) * fill
        nodes += [v for v in more.tolist() if min(abs(v - n) for n in nodes) > 0.2 * fill]
    return np.unique(nodes)


def _thrust_at(airframe: Airframe, speed: float, altitude_m: float, throttle: float) -> float:
    return airframe.thrust_n(Motion(speed, 0.0, 0.0, 0.0, altitude_m), Controls(0.0, throttle))


def _thrust(airframe: Airframe, throttle: float, mach: Array, altitude: Array) -> Array:
    sounds = [standard_air(h).sound_m_s for h in altitude.tolist()]
    return np.array(
        [
            [_thrust_at(airframe, M * a, h, throttle) for h, a in zip(altitude.tolist(), sounds, strict=True)]
            for M in mach.tolist()
        ]
    )


def _per_newton(airframe: Airframe) -> Array:
    """Return the accelerations along body x and z and in pitch per newton of thrust, (3,), from two throttle settings."""
    motion = Motion(airframe.airspeed_m_s, 0.0, 0.0, 0.0, airframe.altitude_m)
    low, high = (Controls(0.0, t) for t in (airframe.inputs[1].low, 0.5 * airframe.inputs[1].high))
    one, other = airframe.respond(motion, low).rates, airframe.respond(motion, high).rates
    more = airframe.thrust_n(motion, high) - airframe.thrust_n(motion, low)
    return (
        np.array([other.airspeed - one.airspeed, (other.alpha - one.alpha) * motion.airspeed_m_s, other.q - one.q])
        / more
    )
