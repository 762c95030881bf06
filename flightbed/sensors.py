"""Truth -> Measurement: the only door between them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flightbed.signals import Measurement, Truth


@dataclass(frozen=True)
class SensorNoise:
    """Standard deviations of white Gaussian noise, one draw per tick. rad, rad/s, rad."""

    alpha_rad: float
    q_rad_s: float
    elevator_rad: float = 0.0


class Sensors:
    """Sensors of one flight: all noise is drawn up front, from one stream per sensor.

    Args:
        noise: standard deviations.
        ticks: length of the flight.
        seed: of this flight's sensors; streams are spawned from it, so a further sensor leaves the others as they are.

    """

    def __init__(self, noise: SensorNoise, *, ticks: int, seed: np.random.SeedSequence) -> None:
        streams = [np.random.default_rng(s) for s in seed.spawn(3)]
        # Lists: reading one number from a list costs a third of reading it from an array.
        self._alpha, self._q, self._elevator = (
            (std * stream.standard_normal(ticks)).tolist()
            for std, stream in zip((noise.alpha_rad, noise.q_rad_s, noise.elevator_rad), streams, strict=True)
        )

    def read(self, tick: int, truth: Truth) -> Measurement:
        """Return the readings at a tick. The averaged surface position carries the same error as the present one."""
        error = self._elevator[tick]
        return Measurement(
            truth.alpha_rad + self._alpha[tick],
            truth.q_rad_s + self._q[tick],
            truth.elevator_rad + error,
            truth.elevator_mean_rad + error,
        )
