"""The linear plant: a short period with exact discretization, for linear aircraft, tests and studies."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from math import cos, isnan, nan, sin
from typing import NamedTuple

import numpy as np

from flightbed.avionics.short_period import ShortPeriod, zero_order_hold
from flightbed.core.signals import HEALTHY, Health, Truth
from flightbed.core.units import G0
from flightbed.plant.gusts import Gusts, calm

Row = tuple[float, ...]


class _Step(NamedTuple):
    """Transition over one period: rows for alpha, q, elevator and the integral of elevator.

    Each row multiplies (alpha, q, elevator, command, alpha_gust, w_alpha, w_q, 1).
    """

    alpha: Row
    q: Row
    elevator: Row
    integral: Row


class LinearPlant:
    """Short period plus first-order actuator without limits, discretized exactly over the control period; implements Plant.

    x = (alpha, q) follows x' = A x + S b delta - b delta_trim + w if ``absolute``, else x' = A x + S b (delta - delta_trim) + w, the
    form of the thesis, with S b = (force share x Z_delta, K x M_delta). The mean deflection over the period is exact as well: it is
    the integral of a state of the matrix exponential. A gust of vertical speed w adds w/V to the angle of attack, for the forces and
    for the vane; over a period it is held at the mean of its values at both ends. Flight path and load factor follow from the
    kinematics at constant speed: nz = cos(gamma) + V gamma'/g, gamma = theta - alpha without the gust, gamma' its mean over the last
    period.

    Args:
        design: short-period model; the flight starts at its trim, level.
        control_hz: control rate, Hz; one advance() is one period.
        absolute: whether the shares scale the trim deflection as well.
        airspeed_m_s: airspeed for gusts, flight path and load factor; nan leaves the latter two nan.
        mach, altitude_m: values at the start; the Mach number stays constant.
        gusts: vertical speed of the air over time, m/s, up positive.
        process_noise: standard deviations of w: an alpha rate, rad/s, and a pitch acceleration, rad/s^2; white, held over a period.
        seed: seed of the process noise.

    Raises:
        ValueError: gusts without an airspeed.

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
        gusts: Gusts = calm,
        process_noise: tuple[float, float] = (0.0, 0.0),
        seed: np.random.SeedSequence | int = 0,
    ) -> None:
        if gusts is not calm and isnan(airspeed_m_s):
            raise ValueError("airspeed_m_s: must be given with gusts (got nan); a gust w changes alpha by w / V")
        self._design, self._hz, self._absolute = design, control_hz, absolute
        self._speed, self._mach, self._altitude, self._north = airspeed_m_s, mach, altitude_m, 0.0
        self._steps: dict[Health, _Step] = {}
        self._health, self._step = HEALTHY, self._step_of(HEALTHY)
        self._x = (0.0, 0.0, 0.0)  # alpha, q, elevator: deviations from trim
        self._mean = design.elevator_trim_rad
        self._theta = self._theta_0 = design.alpha_trim_rad
        self._nz = nan if isnan(airspeed_m_s) else 1.0
        self._gusts, self._tick, self._gust_m_s = gusts, 0, gusts(0.0)
        self._noise = _noise(process_noise, seed) if any(process_noise) else None

    def sense(self, health: Health = HEALTHY) -> Truth:
        """Return the truth at the current tick; quantities outside the short period are 0 or nan."""
        d, (alpha, q, elevator) = self._design, self._x
        return Truth(
            alpha_rad=d.alpha_trim_rad + alpha + self._gust_rad(self._gust_m_s),
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
            effectiveness=health.effectiveness,
            elevator_force=health.elevator_force,
            gust_up_m_s=self._gust_m_s,
        )

    def _gust_rad(self, up_m_s: float) -> float:
        return up_m_s / self._speed if up_m_s else 0.0

    def advance(self, elevator_cmd_rad: float, health: Health, following: Health) -> None:  # noqa: ARG002
        """Fly one control period with the command held. ``following`` is unused: the transition is exact.

        Raises ValueError for a c.g. shift.
        """
        if health is not self._health:
            self._health, self._step = health, self._steps.get(health) or self._step_of(health)
        dt, trim, (alpha, q, elevator) = 1.0 / self._hz, self._design.elevator_trim_rad, self._x
        command, gust = elevator_cmd_rad - trim, self._next_gust()
        if self._noise is None:
            moved = [
                r[0] * alpha + r[1] * q + r[2] * elevator + r[3] * command + r[4] * gust + r[7] for r in self._step
            ]
        else:
            w_alpha, w_q = next(self._noise)
            moved = [
                r[0] * alpha + r[1] * q + r[2] * elevator + r[3] * command + r[4] * gust + r[5] * w_alpha + r[6] * w_q + r[7]
                for r in self._step
            ]  # fmt: skip
        self._x = (moved[0], moved[1], moved[2])
        self._mean = trim + moved[3] / dt
        # Trapezoidal rule over the period: it enters only flight path and load factor, which feed nothing back.
        climbed = self._theta - self._theta_0 - alpha
        self._theta += 0.5 * dt * (q + moved[1])
        now = self._theta - self._theta_0 - moved[0]
        self._nz = cos(now) + self._speed / G0 * (now - climbed) / dt
        gamma = 0.5 * (climbed + now)
        self._altitude += self._speed * sin(gamma) * dt
        self._north += self._speed * cos(gamma) * dt

    def _next_gust(self) -> float:
        """Advance the gust by one period; return its mean over the period as an angle of attack, rad."""
        if self._gusts is calm:
            return 0.0
        self._tick += 1
        before, self._gust_m_s = self._gust_m_s, self._gusts(self._tick / self._hz)
        return self._gust_rad(0.5 * (before + self._gust_m_s))

    def _step_of(self, health: Health) -> _Step:
        if health.cg_shift_cbar:
            raise ValueError(
                f"cg_shift_cbar: A and b alone do not model a c.g. shift (got {health.cg_shift_cbar:g}); use JsbsimPlant"
            )
        d = self._design
        damaged = np.array([health.elevator_force, health.effectiveness]) * d.b
        A3, b3 = replace(d, b=damaged).with_actuator()
        A, B = np.zeros((4, 4)), np.zeros((4, 5))
        A[:3, :3] = A3
        A[3, 2] = 1.0
        B[:3, 0] = b3
        B[:2, 1] = d.A[:, 0]  # gust angle of attack
        B[0, 2] = B[1, 3] = 1.0
        if self._absolute:  # loss of force and moment at the trim deflection
            B[:2, 4] = (damaged - d.b) * d.elevator_trim_rad
        phi, gamma = zero_order_hold(A, B, 1.0 / self._hz)
        step = _Step(*(tuple(row) for row in np.column_stack([phi[:, :3], gamma]).tolist()))
        self._steps[health] = step
        return step


def _noise(stds: tuple[float, float], seed: np.random.SeedSequence | int) -> Iterator[tuple[float, float]]:
    """Yield process noise without end, drawn in blocks: a single draw costs more than one period of flight."""
    rng = np.random.default_rng(seed)
    while True:
        yield from map(tuple, (rng.standard_normal((1024, 2)) * stds).tolist())
