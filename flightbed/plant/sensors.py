"""Truth -> Measurement, LateralTruth -> LateralMeasurement: the only doors between them."""

from __future__ import annotations

from dataclasses import astuple, dataclass
from itertools import repeat

import numpy as np

from flightbed.core.compiled import Array, compiled, plain
from flightbed.core.signals import LateralMeasurement, LateralNoise, LateralTruth, Measurement, SensorNoise, Truth

_new = tuple.__new__
Nine = tuple[float, float, float, float, float, float, float, float, float]


@compiled
def readings(
    alpha: float, q: float, elevator: float, elevator_mean: float, mach: float, altitude: float, theta: float, phi: float, nz: float,
    mach_scale: float, e_alpha: float, e_q: float, e_elevator: float, e_mach: float, e_altitude: float, e_theta: float, e_phi: float,
    e_nz: float,
) -> Nine:  # fmt: skip
    """Return the readings, in the order of Measurement, from the true values and the errors (e_) at a tick."""
    return (
        alpha + e_alpha,
        q + e_q,
        elevator + e_elevator,
        elevator_mean + e_elevator,
        mach * mach_scale + e_mach,
        altitude + e_altitude,
        theta + e_theta,
        phi + e_phi,
        nz + e_nz,
    )


_readings = plain(readings)


@dataclass(frozen=True)
class SensorErrors:
    """Constant sensor errors, unknown to the flight computer: rad, rad/s, and a share of the Mach number."""

    alpha_rad: float = 0.0
    q_rad_s: float = 0.0
    mach: float = 0.0


class Sensors:
    """Sensors of one flight: all noise is drawn before the flight, from one stream per sensor.

    Args:
        noise: standard deviations.
        ticks: length of the flight.
        seed: seed of this flight's sensors; each sensor's stream is spawned from it, so an additional sensor does not change the others.
        errors: constant errors.

    Attributes:
        errors: (ticks, 8), error of each reading at each tick, in the order of SensorNoise.
        mach_scale: factor on the true Mach number.

    """

    def __init__(
        self, noise: SensorNoise, *, ticks: int, seed: np.random.SeedSequence, errors: SensorErrors | None = None
    ) -> None:
        errors = errors or SensorErrors()
        stds = astuple(noise)
        offsets = (errors.alpha_rad, errors.q_rad_s)
        streams = zip(stds, seed.spawn(len(stds)), (*offsets, *repeat(0.0, len(stds) - len(offsets))), strict=True)
        self.errors: Array = np.zeros((ticks, len(stds)))
        for column, (std, stream, offset) in enumerate(streams):
            self.errors[:, column] = offset
            if std:
                self.errors[:, column] = offset + std * np.random.default_rng(stream).standard_normal(ticks)
        self._rows: list[
            list[float]
        ] = []  # lists of floats, converted at the first reading: access takes a third of the array's time
        self.mach_scale = 1.0 + errors.mach

    def read(self, tick: int, truth: Truth) -> Measurement:
        """Return the readings at a tick. The averaged surface position has the same error as the present one."""
        errors = (self._rows or self._laid_out())[tick]
        # Slicing Truth and bypassing Measurement's constructor halves the time of access by name.
        alpha, q, theta, phi, _, _, mach, altitude, _, _, nz, elevator, elevator_mean = truth[:13]
        return _new(
            Measurement,
            _readings(alpha, q, elevator, elevator_mean, mach, altitude, theta, phi, nz, self.mach_scale, *errors),
        )

    def _laid_out(self) -> list[list[float]]:
        self._rows = self.errors.tolist()
        return self._rows


class LateralSensors:
    """Sensors of roll and yaw in one flight; otherwise as ``Sensors``.

    Args:
        noise: standard deviations.
        ticks: length of the flight.
        seed: seed of this flight's lateral sensors; each sensor's stream is spawned from it.

    Attributes:
        errors: (ticks, 5), error of each reading at each tick, in the order of LateralNoise.

    """

    def __init__(self, noise: LateralNoise, *, ticks: int, seed: np.random.SeedSequence) -> None:
        stds = astuple(noise)
        drawn = [
            std * np.random.default_rng(stream).standard_normal(ticks) if std else np.zeros(ticks)
            for std, stream in zip(stds, seed.spawn(len(stds)), strict=True)
        ]
        self.errors: Array = np.column_stack(drawn)
        self._rows: list[list[float]] = self.errors.tolist()

    def read(self, tick: int, truth: LateralTruth) -> LateralMeasurement:
        """Return the readings at a tick. An averaged surface position has the same error as the present one."""
        beta, p, r, aileron, rudder = self._rows[tick]
        return LateralMeasurement(
            truth.beta_rad + beta, truth.p_rad_s + p, truth.r_rad_s + r, truth.aileron_rad + aileron, truth.rudder_rad + rudder,
            truth.aileron_mean_rad + aileron, truth.rudder_mean_rad + rudder,
        )  # fmt: skip
