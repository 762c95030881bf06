"""Laws that are designed anew for the effectiveness that is left, on a confirmed change (Wu, Zhang and Zhou 2000, eqs (47)-(49)).

Weights stay, so that a surface that does less is also asked for relatively less; dividing the demand by K-hat, as ``adaptation`` does, is
what weights give that are scaled by K twice. W does not say how the new gains come in: the step that they would make of the command
is taken out at once and let in again with a time constant of 0.2 s.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import exp

import numpy as np

from flightbed.control.base import Gains
from flightbed.control.lq import lq_gain
from flightbed.control.proportional import Proportional
from flightbed.control.roll_yaw import RollYaw
from flightbed.errors import DesignError
from flightbed.short_period import ShortPeriod, zero_order_hold
from flightbed.signals import Estimate, Measurement

_BUMP_S = 0.2


@dataclass(frozen=True)
class PitchWeights:
    """Bryson's rule: how much of each is as bad as that much of the others. rad, rad/s, rad."""

    alpha_rad: float
    q_rad_s: float
    elevator_rad: float


def pitch_lq(design: ShortPeriod, weights: PitchWeights, *, control_hz: int, effectiveness: float = 1.0) -> Gains:
    """Return LQ gains of (alpha, q, elevator) with the actuator, and the reference gain for unit DC gain to pitch rate.

    Args:
        design: the healthy model.
        weights: of alpha, q and command.
        control_hz: rate of the commands.
        effectiveness: K that is designed for.

    Raises:
        DesignError: the elevator that is left does not control the model.

    """
    A, b = design.with_actuator(effectiveness)
    discrete = zero_order_hold(A, b, 1.0 / control_hz)
    B = discrete.b[:, None]
    F = lq_gain(
        discrete.A,
        B,
        np.diag([weights.alpha_rad**-2, weights.q_rad_s**-2, 0.0]),
        np.array([[weights.elevator_rad**-2]]),
    )[0]
    dc = float(np.linalg.solve(np.eye(3) - discrete.A + np.outer(discrete.b, F), discrete.b)[1])
    if abs(dc) < 1e-9:
        raise DesignError("the elevator has no steady effect on pitch rate: no reference gain exists")
    return Gains(alpha=-float(F[0]), q=-float(F[1]), elevator=-float(F[2]), reference=1.0 / dc)


class RedesignedPitch:
    """The proportional law with LQ gains for the K that is believed; its demand is the command. A Law.

    Args:
        design: the healthy model.
        weights: of the regulator.
        control_hz: rate of the commands.

    Attributes:
        gains: of now.
        effectiveness: that they are designed for.

    Raises:
        DesignError: as ``pitch_lq``.

    """

    def __init__(self, design: ShortPeriod, weights: PitchWeights, *, control_hz: int) -> None:
        self._design, self._weights, self._hz = design, weights, control_hz
        self._keep = exp(-1.0 / (_BUMP_S * control_hz))
        self.gains, self.effectiveness = pitch_lq(design, weights, control_hz=control_hz), 1.0
        self._law = self._with(self.gains)
        self._bump, self._last, self._is_new = 0.0, 0.0, False

    def _with(self, gains: Gains) -> Proportional:
        # Of the trim deflection, too, only the share K acts.
        trim = self._design.elevator_trim_rad / self.effectiveness
        return Proportional(gains, alpha_trim_rad=self._design.alpha_trim_rad, elevator_trim_rad=trim)

    def redesign(self, effectiveness: float) -> None:
        """Design for another K from the next demand on."""
        self.gains = pitch_lq(self._design, self._weights, control_hz=self._hz, effectiveness=effectiveness)
        self.effectiveness = effectiveness
        self._law, self._is_new = self._with(self.gains), True

    def demand(self, measurement: Measurement, *, q_ref_rad_s: float, elevator_rad: float, hold: bool) -> float:
        """Return the command, rad."""
        found = self._law.demand(measurement, q_ref_rad_s=q_ref_rad_s, elevator_rad=elevator_rad, hold=hold)
        self._bump *= self._keep
        if self._is_new:
            self._bump, self._is_new = self._last - found, False
        self._last = found + self._bump
        return self._last


@dataclass(frozen=True)
class Redesign:
    """When laws are designed anew: a change has been confirmed, and K-hat is further from the design's than the tolerance.

    Attributes:
        pitch: the law of the elevator, and the index of the estimate of its K.
        roll_yaw: the law of aileron and rudder, and the indices of theirs; None where they are not commanded or not estimated.
        floor: smallest K that is designed for.
        tolerance: deviation of K-hat from the K designed for that is let pass.

    """

    pitch: tuple[RedesignedPitch, int]
    roll_yaw: tuple[RollYaw, tuple[int, int]] | None
    floor: float
    tolerance: float = 0.05

    def update(self, estimates: Sequence[Estimate]) -> None:
        """Take the estimates of a tick; the laws decide by what was designed from the same tick on."""
        law, index = self.pitch
        K = self._confirmed(estimates[index], law.effectiveness)
        if law.effectiveness != K:
            law.redesign(K)
        if self.roll_yaw is not None:
            both, (aileron, rudder) = self.roll_yaw
            had_aileron, had_rudder = both.effectiveness
            left = self._confirmed(estimates[aileron], had_aileron), self._confirmed(estimates[rudder], had_rudder)
            if left != both.effectiveness:
                both.redesign(left)

    def _confirmed(self, estimate: Estimate, had: float) -> float:
        wanted = max(self.floor, estimate.effectiveness_smoothed)
        return wanted if estimate.alarms > 0.0 and abs(wanted - had) > self.tolerance else had
