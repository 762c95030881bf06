"""The regulator of roll and yaw: LQ feedback on the design model with actuators, unit DC gain to roll rate and sideslip."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from flightbed.control.lq import lq_gain
from flightbed.errors import DesignError
from flightbed.lateral_directional import LateralDirectional
from flightbed.short_period import zero_order_hold
from flightbed.signals import LateralMeasurement

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class RollYawWeights:
    """Bryson's rule: how much of each is as bad as that much of the others. rad, rad/s."""

    beta_rad: float
    p_rad_s: float
    r_rad_s: float
    aileron_rad: float
    rudder_rad: float


class RollYaw:
    """Deflections of aileron and rudder that should act; with what acts fed back the loop is the healthy one whatever their effectiveness.

    u = N (p_ref, beta_ref) - F (beta, p, r, aileron, rudder), F from the discrete Riccati equation at the control rate; N makes
    the DC gain from the references to (p, beta) one on the design model, which does not know of gravity.

    Args:
        design: the model.
        weights: of the regulator.
        control_hz: rate of the commands.

    Attributes:
        F: (2, 5).
        N: (2, 2).
        closed_loop: (5, 5), of (beta, p, r, aileron, rudder) over a tick, healthy.

    Raises:
        DesignError: the surfaces do not control the model.

    """

    def __init__(self, design: LateralDirectional, weights: RollYawWeights, *, control_hz: int) -> None:
        A5, B5 = design.with_actuators()
        A, B = zero_order_hold(A5, B5, 1.0 / control_hz)
        w = weights
        Q = np.diag([w.beta_rad**-2, w.p_rad_s**-2, w.r_rad_s**-2, 0.0, 0.0])
        self.F: Array = lq_gain(A, B, Q, np.diag([w.aileron_rad**-2, w.rudder_rad**-2]))
        self.closed_loop: Array = A - B @ self.F
        followed = np.zeros((2, 5))
        followed[0, 1] = followed[1, 0] = 1.0
        dc = followed @ np.linalg.solve(np.eye(5) - self.closed_loop, B)
        if np.linalg.cond(dc) > 1e9:
            raise DesignError(
                "roll and yaw: aileron and rudder do not set roll rate and sideslip independently; there is no such law"
            )
        self.N: Array = np.linalg.inv(dc)
        self._F, self._N = self.F.tolist(), self.N.tolist()

    def demand(
        self,
        measurement: LateralMeasurement,
        *,
        p_ref_rad_s: float,
        beta_ref_rad: float,
        aileron_rad: float,
        rudder_rad: float,
    ) -> tuple[float, float]:
        """Return the deflections of aileron and rudder that should act, rad.

        Args:
            measurement: the sensors' readings.
            p_ref_rad_s, beta_ref_rad: references.
            aileron_rad, rudder_rad: deflections to feed back.

        """
        beta, p, r = measurement[:3]
        found = [
            n[0] * p_ref_rad_s
            + n[1] * beta_ref_rad
            - (f[0] * beta + f[1] * p + f[2] * r + f[3] * aileron_rad + f[4] * rudder_rad)
            for n, f in zip(self._N, self._F, strict=True)
        ]
        return found[0], found[1]
