"""Roll and yaw law: LQ feedback on the design model with actuators, and unit DC gain to roll rate and sideslip."""

from __future__ import annotations

from dataclasses import dataclass
from math import exp

import numpy as np
import numpy.typing as npt

from flightbed.avionics.lateral import LateralDirectional
from flightbed.avionics.short_period import zero_order_hold
from flightbed.control.lq import lq_gain
from flightbed.core.errors import DesignError
from flightbed.core.signals import LateralMeasurement

Array = npt.NDArray[np.float64]
_BUMP_S = 0.2  # time constant with which the step of a redesign decays, see ``redesign``


@dataclass(frozen=True)
class RollYawWeights:
    """Bryson's rule: deviations of equal cost, in rad and rad/s."""

    beta_rad: float
    p_rad_s: float
    r_rad_s: float
    aileron_rad: float
    rudder_rad: float


class RollYaw:
    """Law of aileron and rudder; its demand is their effective deflections.

    With the effective deflections fed back, the loop is the healthy one at any effectiveness. u = N (p_ref, beta_ref) - F (beta, p, r,
    aileron, rudder): F from the discrete Riccati equation at the control rate; N gives unit DC gain from the references to (p, beta)
    on the design model, which excludes gravity.

    Args:
        design: the model.
        weights: of the regulator.
        control_hz: control rate.

    Attributes:
        F: (2, 5).
        N: (2, 2).
        closed_loop: (5, 5), of (beta, p, r, aileron, rudder) over a tick.
        effectiveness: K of aileron and rudder of the design.
        keep: share of the step at a redesign that remains after a tick.

    Raises:
        DesignError: the surfaces do not control the model.

    """

    def __init__(self, design: LateralDirectional, weights: RollYawWeights, *, control_hz: int) -> None:
        w = weights
        self._design, self._hz = design, control_hz
        self._Q = np.diag([w.beta_rad**-2, w.p_rad_s**-2, w.r_rad_s**-2, 0.0, 0.0])
        self._R = np.diag([w.aileron_rad**-2, w.rudder_rad**-2])
        self.keep = exp(-1.0 / (_BUMP_S * control_hz))
        self._bump, self._last, self._is_new = [0.0, 0.0], (0.0, 0.0), False
        self._solve((1.0, 1.0))

    def _solve(self, effectiveness: tuple[float, float]) -> None:
        A5, B5 = self._design.with_actuators(effectiveness)
        A, B = zero_order_hold(A5, B5, 1.0 / self._hz)
        F = lq_gain(A, B, self._Q, self._R)
        closed_loop = A - B @ F
        followed = np.zeros((2, 5))
        followed[0, 1] = followed[1, 0] = 1.0
        dc = followed @ np.linalg.solve(np.eye(5) - closed_loop, B)
        if np.linalg.cond(dc) > 1e9:
            raise DesignError(
                "roll and yaw: aileron and rudder do not control roll rate and sideslip independently; set lateral.enabled = false"
            )
        self.F: Array = F
        self.N: Array = np.linalg.inv(dc)
        self.closed_loop: Array = closed_loop
        self.effectiveness = effectiveness
        self._F, self._N = self.F.tolist(), self.N.tolist()

    def redesign(self, effectiveness: tuple[float, float]) -> None:
        """Redesign for other K of aileron and rudder; the next demand uses the new gains and is the command. Raises DesignError."""
        self._solve(effectiveness)
        self._is_new = True

    def demand(
        self,
        measurement: LateralMeasurement,
        *,
        p_ref_rad_s: float,
        beta_ref_rad: float,
        aileron_rad: float,
        rudder_rad: float,
    ) -> tuple[float, float]:
        """Return the demanded effective deflections of aileron and rudder, rad.

        Args:
            measurement: the sensors' readings.
            p_ref_rad_s, beta_ref_rad: references.
            aileron_rad, rudder_rad: absolute deflections to feed back.

        """
        beta, p, r = measurement[:3]
        found = [
            n[0] * p_ref_rad_s
            + n[1] * beta_ref_rad
            - (f[0] * beta + f[1] * p + f[2] * r + f[3] * aileron_rad + f[4] * rudder_rad)
            for n, f in zip(self._N, self._F, strict=True)
        ]
        bump = self._bump
        bump[0], bump[1] = bump[0] * self.keep, bump[1] * self.keep
        if self._is_new:
            bump[0], bump[1], self._is_new = self._last[0] - found[0], self._last[1] - found[1], False
        self._last = found[0] + bump[0], found[1] + bump[1]
        return self._last
