"""Truth -> Measurement: the only door between them."""

from __future__ import annotations

from dataclasses import astuple, dataclass
from itertools import repeat

import numpy as np

from flightbed.signals import Measurement, Truth

_new = tuple.__new__


@dataclass(frozen=True)
class SensorNoise:
    """Standard deviations of white Gaussian noise, one draw per tick. rad, rad/s, rad, 1, m, rad, rad."""

    alpha_rad: float
    q_rad_s: float
    elevator_rad: float = 0.0
    mach: float = 0.0
    altitude_m: float = 0.0
    theta_rad: float = 0.0
    phi_rad: float = 0.0


@dataclass(frozen=True)
class SensorErrors:
    """Constant errors that the flight computer does not know of. rad, rad/s, and a share of the Mach number."""

    alpha_rad: float = 0.0
    q_rad_s: float = 0.0
    mach: float = 0.0


class Sensors:
    """Sensors of one flight: all noise is drawn up front, from one stream per sensor.

    Args:
        noise: standard deviations.
        ticks: length of the flight.
        seed: of this flight's sensors; streams are spawned from it, so a further sensor leaves the others as they are.
        errors: constant errors.

    """

    def __init__(
        self, noise: SensorNoise, *, ticks: int, seed: np.random.SeedSequence, errors: SensorErrors | None = None
    ) -> None:
        errors = errors or SensorErrors()
        stds = astuple(noise)
        offsets = (errors.alpha_rad, errors.q_rad_s)
        streams = zip(stds, seed.spawn(len(stds)), (*offsets, *repeat(0.0, len(stds) - len(offsets))), strict=True)
        drawn = (
            (offset + std * np.random.default_rng(s).standard_normal(ticks)).tolist()
            if std
            else list(repeat(offset, ticks))
            for std, s, offset in streams
        )
        # Rows of plain numbers: reading them costs a third of reading an array.
        self._rows = list(zip(*drawn, strict=True))
        self._mach = 1.0 + errors.mach

    def read(self, tick: int, truth: Truth) -> Measurement:
        """Return the readings at a tick. The averaged surface position carries the same error as the present one."""
        alpha, q, elevator, mach, altitude, theta, phi = self._rows[tick]
        # The fields of Truth taken apart at once, the Measurement made without its constructor: half the time of doing it by name.
        alpha_0, q_0, theta_0, phi_0, _, _, mach_0, altitude_0, _, _, _, elevator_0, mean_0 = truth[:13]
        return _new(
            Measurement,
            (
                alpha_0 + alpha,
                q_0 + q,
                elevator_0 + elevator,
                mean_0 + elevator,
                mach_0 * self._mach + mach,
                altitude_0 + altitude,
                theta_0 + theta,
                phi_0 + phi,
            ),
        )
