"""The exact linear plant: the design model flown with exact arithmetic, for tests and studies; a Plant."""

from __future__ import annotations

from dataclasses import replace
from math import isnan, nan

import numpy as np

from flightbed.gusts import Gusts, calm
from flightbed.short_period import ShortPeriod, zero_order_hold
from flightbed.signals import HEALTHY, Health, Truth


class LinearPlant:
    """Short period plus first-order actuator, exactly discretized per control period, without limits.

    alpha' , q' follow x' = A x + S b delta - b delta_trim if ``absolute``, else x' = A x + S b (delta - delta_trim), the
    thesis's form, with S b = (force share x Z_delta, K x M_delta). The period's mean deflection is exact too: it is a fourth
    state of the matrix exponential. A gust w adds w/V to the angle of attack, for the forces and for the vane; it is held over a
    period at the mean of its values at both ends.

    Args:
        design: the model to fly; starts at its trim.
        control_hz: one advance() is one period.
        absolute: whether the shares scale the trim deflection as well.
        airspeed_m_s: for gusts, flight path and load factor; nan leaves the latter two nan.
        gusts: vertical speed of the air over time, m/s, up positive.

    Raises:
        ValueError: there are gusts, but no airspeed.

    """

    def __init__(
        self,
        design: ShortPeriod,
        *,
        control_hz: int,
        absolute: bool = True,
        airspeed_m_s: float = nan,
        gusts: Gusts = calm,
    ) -> None:
        if gusts is not calm and isnan(airspeed_m_s):
            raise ValueError("a linear plant in gusts needs airspeed_m_s: a gust w changes alpha by w / V")
        self._design, self._dt, self._absolute, self._speed = design, 1.0 / control_hz, absolute, airspeed_m_s
        self._gusts, self._hz, self._tick, self._gust_m_s = gusts, control_hz, 0, gusts(0.0)
        self._transitions: dict[Health, tuple[np.ndarray, np.ndarray]] = {}
        self._x = np.zeros(4)  # alpha, q, elevator, in deviations from trim; integral of elevator over the period
        self._mean = design.elevator_trim_rad
        self._theta = design.alpha_trim_rad

    def sense(self, health: Health = HEALTHY) -> Truth:
        """Return the truth at the present tick; what a short period does not have is nan."""
        d = self._design
        return Truth(
            alpha_rad=d.alpha_trim_rad + float(self._x[0]) + self._gust_rad(self._gust_m_s),
            q_rad_s=float(self._x[1]),
            theta_rad=self._theta,
            phi_rad=0.0,
            psi_rad=0.0,
            airspeed_m_s=self._speed,
            mach=nan,
            altitude_m=nan,
            north_m=nan,
            east_m=nan,
            nz_g=nan,
            elevator_rad=d.elevator_trim_rad + float(self._x[2]),
            elevator_mean_rad=self._mean,
            effectiveness=health.effectiveness,
            elevator_force=health.elevator_force,
            gust_up_m_s=self._gust_m_s,
        )

    def _gust_rad(self, up_m_s: float) -> float:
        return up_m_s / self._speed if up_m_s else 0.0

    def advance(self, elevator_cmd_rad: float, health: Health, following: Health) -> None:  # noqa: ARG002
        """Fly one control period with the command held; exact, so the following period does not matter.

        Raises ValueError for a c.g. shift.
        """
        if health.cg_shift_cbar:
            raise ValueError(
                f"a c.g. shift of {health.cg_shift_cbar:g} cbar has no meaning for A and b alone: fly it on a JsbsimPlant"
            )
        d = self._design
        phi, gamma = self._transition(health)
        # Deviation input plus, in the absolute form, the force and moment that the trim deflection has lost.
        lost = d.elevator_trim_rad if self._absolute else 0.0
        self._tick += 1
        gust_before, self._gust_m_s = self._gust_m_s, self._gusts(self._tick / self._hz)
        gust = self._gust_rad(0.5 * (gust_before + self._gust_m_s))
        before = self._x[1]
        self._x = phi @ [*self._x[:3], 0.0] + gamma @ [elevator_cmd_rad - d.elevator_trim_rad, lost, gust]
        self._mean = d.elevator_trim_rad + float(self._x[3]) / self._dt
        self._theta += 0.5 * self._dt * float(before + self._x[1])

    def _transition(self, health: Health) -> tuple[np.ndarray, np.ndarray]:
        if health not in self._transitions:
            design = self._design
            left = np.array([health.elevator_force, health.effectiveness]) * design.b
            A3, b3 = replace(design, b=left).with_actuator()
            A = np.zeros((4, 4))
            A[:3, :3] = A3
            A[3, 2] = 1.0
            phi, command = zero_order_hold(A, np.append(b3, 0.0), self._dt)
            held = np.zeros((4, 2))  # what a trim deflection, and an angle of attack by a gust, do beside the states
            held[:2] = np.column_stack([left - design.b, design.A[:, 0]])
            _, beside = zero_order_hold(A, held, self._dt)
            self._transitions[health] = (phi, np.column_stack([command, beside]))
        return self._transitions[health]
