"""The exact linear plant: the design model flown with exact arithmetic, for tests and studies; a Plant."""

from __future__ import annotations

from math import nan

import numpy as np

from flightbed.short_period import ShortPeriod, zero_order_hold
from flightbed.signals import Truth


class LinearPlant:
    """Short period plus first-order actuator, exactly discretized per control period, without limits.

    alpha' , q' follow x' = A x + b (K delta - delta_trim) if ``absolute``, else x' = A x + K b (delta - delta_trim),
    the thesis's form. The period's mean deflection is exact too: it is a fourth state of the matrix exponential.

    Args:
        design: the model to fly; starts at its trim.
        control_hz: one advance() is one period.
        absolute: whether K scales the trim deflection as well.
        airspeed_m_s: only for flight path and load factor; nan leaves them nan.

    """

    def __init__(
        self, design: ShortPeriod, *, control_hz: int, absolute: bool = True, airspeed_m_s: float = nan
    ) -> None:
        self._design, self._dt, self._absolute, self._speed = design, 1.0 / control_hz, absolute, airspeed_m_s
        self._transitions: dict[float, tuple[np.ndarray, np.ndarray]] = {}
        self._x = np.zeros(4)  # alpha, q, elevator, in deviations from trim; integral of elevator over the period
        self._mean = design.elevator_trim_rad
        self._theta = design.alpha_trim_rad

    def sense(self, effectiveness: float = 1.0) -> Truth:
        """Return the truth at the present tick; what a short period does not have is nan."""
        d = self._design
        return Truth(
            alpha_rad=d.alpha_trim_rad + float(self._x[0]),
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
            effectiveness=effectiveness,
        )

    def advance(self, elevator_cmd_rad: float, effectiveness: float, following: float) -> None:  # noqa: ARG002
        """Fly one control period with the command held; exact, so the following period does not matter."""
        d = self._design
        phi, gamma = self._transition(effectiveness)
        # Deviation input plus, in the absolute form, the moment that the trim deflection has lost.
        lost = (effectiveness - 1.0) * d.elevator_trim_rad if self._absolute else 0.0
        before = self._x[1]
        self._x = phi @ [*self._x[:3], 0.0] + gamma @ [elevator_cmd_rad - d.elevator_trim_rad, lost]
        self._mean = d.elevator_trim_rad + float(self._x[3]) / self._dt
        self._theta += 0.5 * self._dt * float(before + self._x[1])

    def _transition(self, effectiveness: float) -> tuple[np.ndarray, np.ndarray]:
        if effectiveness not in self._transitions:
            A3, b3 = self._design.with_actuator(effectiveness)
            A = np.zeros((4, 4))
            A[:3, :3] = A3
            A[3, 2] = 1.0
            phi, command = zero_order_hold(A, np.append(b3, 0.0), self._dt)
            _, lost = zero_order_hold(A, np.array([*self._design.b, 0.0, 0.0]), self._dt)
            self._transitions[effectiveness] = (phi, np.column_stack([command, lost]))
        return self._transitions[effectiveness]
