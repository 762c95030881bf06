"""The exact linear plant: a short period flown with exact arithmetic, for linear aircraft, tests and studies; a Plant."""

from __future__ import annotations

from collections.abc import Iterator
from math import cos, nan, sin
from typing import NamedTuple

import numpy as np

from flightbed.short_period import ShortPeriod, zero_order_hold
from flightbed.signals import Truth
from flightbed.units import G0

Row = tuple[float, ...]


class _Step(NamedTuple):
    """One period: rows for alpha, q, elevator and the integral of elevator, over (alpha, q, elevator, command, w_alpha, w_q, 1)."""

    alpha: Row
    q: Row
    elevator: Row
    integral: Row


class LinearPlant:
    """Short period plus first-order actuator, exactly discretized per control period, without limits.

    alpha' , q' follow x' = A x + b (K delta - delta_trim) + w if ``absolute``, else x' = A x + K b (delta - delta_trim) + w, the
    thesis's form. The period's mean deflection is exact too: it is the integral of a state of the matrix exponential. Flight path and
    load factor are the kinematics of that motion at constant speed, nz = 1 + V (q - alpha')/g.

    Args:
        design: the model to fly; starts at its trim, level.
        control_hz: one advance() is one period.
        absolute: whether K scales the trim deflection as well.
        airspeed_m_s: for flight path and load factor; nan leaves them nan.
        mach, altitude_m: of the start; Mach number stays.
        process_noise: standard deviations of w: an alpha rate, rad/s, and a pitch acceleration, rad/s^2; white, each held for a period.
        seed: of the process noise.

    """

    def __init__(
        self,
        design: ShortPeriod,
        *,
        control_hz: int,
        absolute: bool = True,
        airspeed_m_s: float = nan,
        mach: float = nan,
        altitude_m: float = nan,
        process_noise: tuple[float, float] = (0.0, 0.0),
        seed: np.random.SeedSequence | int = 0,
    ) -> None:
        self._design, self._dt, self._absolute = design, 1.0 / control_hz, absolute
        self._speed, self._mach, self._altitude, self._north = airspeed_m_s, mach, altitude_m, 0.0
        self._steps: dict[float, _Step] = {}
        self._x = (0.0, 0.0, 0.0)  # alpha, q, elevator, in deviations from trim
        self._mean = design.elevator_trim_rad
        self._theta = self._theta_0 = design.alpha_trim_rad
        self._nz = nan if airspeed_m_s != airspeed_m_s else 1.0
        self._noise = _noise(process_noise, seed) if any(process_noise) else None

    def sense(self, effectiveness: float = 1.0) -> Truth:
        """Return the truth at the present tick; what a short period does not have is 0, or nan."""
        d, (alpha, q, elevator) = self._design, self._x
        return Truth(
            alpha_rad=d.alpha_trim_rad + alpha,
            q_rad_s=q,
            theta_rad=self._theta,
            phi_rad=0.0,
            psi_rad=0.0,
            airspeed_m_s=self._speed,
            mach=self._mach,
            altitude_m=self._altitude,
            north_m=self._north,
            east_m=0.0,
            nz_g=self._nz,
            elevator_rad=d.elevator_trim_rad + elevator,
            elevator_mean_rad=self._mean,
            effectiveness=effectiveness,
        )

    def advance(self, elevator_cmd_rad: float, effectiveness: float, following: float) -> None:  # noqa: ARG002
        """Fly one control period with the command held; exact, so the following period does not matter."""
        step = self._steps.get(effectiveness) or self._step(effectiveness)
        trim, dt, (alpha, q, elevator) = self._design.elevator_trim_rad, self._dt, self._x
        command = elevator_cmd_rad - trim
        if self._noise is None:
            moved = [r[0] * alpha + r[1] * q + r[2] * elevator + r[3] * command + r[6] for r in step]
        else:
            w_alpha, w_q = next(self._noise)
            moved = [
                r[0] * alpha + r[1] * q + r[2] * elevator + r[3] * command + r[4] * w_alpha + r[5] * w_q + r[6]
                for r in step
            ]
        self._x = (moved[0], moved[1], moved[2])
        self._mean = trim + moved[3] / dt
        # Over the period, by the trapezoidal rule: only flight path and load factor hang on it, nothing hangs on them.
        turned, climbed = 0.5 * dt * (q + moved[1]), self._theta - self._theta_0 - alpha
        self._theta += turned
        now = self._theta - self._theta_0 - moved[0]
        self._nz = cos(now) + self._speed / G0 * (now - climbed) / dt
        gamma = 0.5 * (climbed + now)
        self._altitude += self._speed * sin(gamma) * dt
        self._north += self._speed * cos(gamma) * dt

    def _step(self, effectiveness: float) -> _Step:
        d = self._design
        A3, b3 = d.with_actuator(effectiveness)
        A, B = np.zeros((4, 4)), np.zeros((4, 4))
        A[:3, :3] = A3
        A[3, 2] = 1.0
        B[:3, 0] = b3
        B[0, 1] = B[1, 2] = 1.0
        if self._absolute:  # the moment that the trim deflection has lost
            B[:2, 3] = (effectiveness - 1.0) * d.elevator_trim_rad * d.b
        phi, gamma = zero_order_hold(A, B, self._dt)
        rows = np.column_stack([phi[:, :3], gamma]).tolist()
        step = self._steps[effectiveness] = _Step(*(tuple(row) for row in rows))
        return step


def _noise(stds: tuple[float, float], seed: np.random.SeedSequence | int) -> Iterator[tuple[float, float]]:
    """Yield process noise for ever, drawn in blocks: one draw at a time costs more than a period of flight."""
    rng = np.random.default_rng(seed)
    while True:
        for alpha, q in (rng.standard_normal((1024, 2)) * stds).tolist():
            yield alpha, q
