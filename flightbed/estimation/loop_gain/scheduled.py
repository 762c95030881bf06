"""The filter bank of K on the scheduled pitch model, compiled."""

from __future__ import annotations

from math import pi

from flightbed.avionics.pitch_kernels import SPAN, local_model
from flightbed.core.atmosphere import air
from flightbed.core.compiled import Array, compiled
from flightbed.estimation.loop_gain import filter_bank
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
        model = settings[filter_bank.MODEL : filter_bank.THRESHOLD].reshape((2, 4))
        follow, r, airspeed = (
            settings[filter_bank.ADAPTIVE] > 0.0,
            settings[filter_bank.NOISE_ALPHA],
            mach * air(altitude_m)[1],
        )
        rate = min(pi * airspeed / (4.0 * schedule[SPAN]), 0.5 / dt)
        share = (
            max(0.0, 1.0 - 1.3 * r / bank[filter_bank.GUST_SQUARE, filter_bank.SHARED])
            if follow and bank[filter_bank.GUST_SQUARE, filter_bank.SHARED] > 0.0
            else 0.0
        )
        last = bank[filter_bank.GUST_SUM, filter_bank.SHARED]
        damping = local_model(
            schedule,
            model,
            settings[filter_bank.SCRATCH : filter_bank.SETTINGS].reshape((2, 4)),
            bank[filter_bank.SMOOTHED, filter_bank.SHARED],
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
            predicted = (
                model[0, 0] * alpha
                + model[0, 1] * q
                + model[0, 2] * bank[filter_bank.SMOOTHED, filter_bank.SHARED] * elevator
                + model[0, 3]
            )
            bank[filter_bank.GUST_SUM, filter_bank.SHARED] = (1.0 - rate * dt) * last + z0 - predicted
            bank[filter_bank.GUST_SQUARE, filter_bank.SHARED] += max(1.0 / 300.0, 1.0 / (k + 20.0)) * (
                bank[filter_bank.GUST_SUM, filter_bank.SHARED] * bank[filter_bank.GUST_SUM, filter_bank.SHARED]
                - bank[filter_bank.GUST_SQUARE, filter_bank.SHARED]
            )
            # The mean over a period of two frames, each with the gust at its start, contains a quarter of the new value.
            model[1, 3] -= damping * dt * share * rate * 0.25 * (bank[filter_bank.GUST_SUM, filter_bank.SHARED] - last)
    return advance(bank, settings, elevator, z0, z1, k)
