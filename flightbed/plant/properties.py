"""The JSBSim properties that the fields of Truth are computed from."""

from __future__ import annotations

from collections.abc import Callable
from math import pi

from flightbed.core.compiled import compiled, plain
from flightbed.core.units import FT, LBF

# One property per field of Truth up to nz_g, then the forces; the elevator comes last, its property is named by the aircraft.
READ = (
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
    "forces/fwz-aero-lbs",
    "forces/fwx-aero-lbs",
    "forces/fbx-prop-lbs",
)
# Arguments of ``fields`` after the initial position, in order.
RAW = (
    "alpha", "q", "theta", "phi", "psi", "airspeed_fps", "mach", "altitude_ft", "latitude", "longitude", "nz", "lift_lbs", "drag_lbs",
    "thrust_lbs", "elevator", "elevator_mean", "effectiveness", "elevator_force", "cg_shift", "gust_up_m_s", "elevator_offset",
)  # fmt: skip
LATERAL = ("aero/beta-rad", "velocities/p-rad_sec", "velocities/r-rad_sec")  # LateralTruth; aileron and rudder follow
Fields = tuple[
    float, float, float, float, float, float, float, float, float, float, float,
    float, float, float, float, float, float, float, float, float, float,
]  # fmt: skip


@compiled
def fields(
    latitude_0: float, longitude_0: float, north_m: float, east_m: float,
    alpha: float, q: float, theta: float, phi: float, psi: float, airspeed_fps: float, mach: float, altitude_ft: float,
    latitude: float, longitude: float, nz: float, lift_lbs: float, drag_lbs: float, thrust_lbs: float, elevator: float,
    elevator_mean: float, effectiveness: float, elevator_force: float, cg_shift: float, gust_up_m_s: float, elevator_offset: float,
) -> Fields:  # fmt: skip
    """Return the fields of Truth from the initial position (with metres per radian of latitude and longitude) and JSBSim's values."""
    return (
        alpha, q, theta, phi, psi - 2.0 * pi if psi > pi else psi, airspeed_fps * FT, mach, altitude_ft * FT,
        (latitude - latitude_0) * north_m, (longitude - longitude_0) * east_m, nz, elevator, elevator_mean,
        effectiveness, elevator_force, cg_shift, gust_up_m_s, lift_lbs * LBF, drag_lbs * LBF, thrust_lbs * LBF,
        elevator_offset,
    )  # fmt: skip


plain_fields: Callable[..., Fields] = plain(fields)
