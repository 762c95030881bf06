"""The filter bank of K on the scheduled pitch model, compiled."""

from __future__ import annotations

from math import pi

from flightbed.avionics.pitch_kernels import SPAN, local_model
from flightbed.core.atmosphere import air
from flightbed.core.compiled import Array, compiled
from flightbed.estimation.loop_gain.filter_bank import TickResult
from flightbed.estimation.loop_gain.filter_bank import tick as advance


@compiled
def tick(
    bank: Array, settings: Array, schedule: Array, dt: float, elevator: float, z0: float, z1: float,
    alpha: float, q: float, mach: float, altitude_m: float, theta: float, phi: float, k: int,
) -> TickResult:  # fmt: skip
    """Advance a bank by one sample on the schedule: ``filter_bank.tick`` with the model of the period that ends now.

    If the process noise follows disturbances, the gust's pitch rate is also subtracted. A vertical gust w that varies along the flight
    path rotates the surrounding air at q_g = (s/V) / (1 + 4 b s/(pi V)) w (MIL-F-8785C 3.7.2); w/V is estimated by the change of alpha
    that the model does not explain. A Wiener gain, 1 - noise/total, removes the sensor's share.

    Args:
        bank, settings, k: as in ``filter_bank.tick``; the model in the settings is overwritten.
        schedule: ``Schedule.packed()``.
        dt: the period, s.
        elevator: mean measured deflection over the period, rad.
        z0, z1: alpha and q measured now.
        alpha, q, mach, altitude_m, theta, phi: measured at the period's start.

    Returns:
        As in ``filter_bank.tick``.

    """
    if k > 0:
        model = settings[23:31].reshape((2, 4))
        follow, r, airspeed = settings[32] > 0.0, settings[21], mach * air(altitude_m)[1]
        rate = min(pi * airspeed / (4.0 * schedule[SPAN]), 0.5 / dt)
        share = max(0.0, 1.0 - 1.3 * r / bank[41, 0]) if follow and bank[41, 0] > 0.0 else 0.0
        last = bank[40, 0]
        damping = local_model(
            schedule,
            model,
            settings[36:44].reshape((2, 4)),
            bank[24, 0],
            dt,
            alpha,
            q,
            elevator,
            mach,
            altitude_m,
            theta,
            phi,
            share * rate * last,
        )
        if follow:
            predicted = model[0, 0] * alpha + model[0, 1] * q + model[0, 2] * bank[24, 0] * elevator + model[0, 3]
            bank[40, 0] = (1.0 - rate * dt) * last + z0 - predicted
            bank[41, 0] += max(1.0 / 300.0, 1.0 / (k + 20.0)) * (bank[40, 0] * bank[40, 0] - bank[41, 0])
            # The mean over a period of two frames, each with the gust at its start, contains a quarter of the new value.
            model[1, 3] -= damping * dt * share * rate * 0.25 * (bank[40, 0] - last)
    return advance(bank, settings, elevator, z0, z1, k)
