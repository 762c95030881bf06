"""Redesign of the laws for the remaining effectiveness, after a confirmed change (Wu, Zhang and Zhou 2000, eqs (47)-(49)).

The weights stay, so the law uses a weaker surface relatively less. Division of the demand by K-hat, as in ``correction``, is equivalent to
weights scaled by K^2. W does not state how the gains are switched: here the step of the command is subtracted at the switch and decays
with a time constant of 0.2 s.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import exp
from typing import ClassVar, Literal

import numpy as np

from flightbed.avionics.short_period import ShortPeriod, zero_order_hold
from flightbed.config.kinds import LawSettings
from flightbed.config.table import Positive, Settings
from flightbed.control.base import Gains, Law
from flightbed.control.lq import lq_gain
from flightbed.control.proportional import Proportional
from flightbed.control.roll_yaw import RollYaw
from flightbed.core.errors import DesignError
from flightbed.core.signals import Estimate, Measurement
from flightbed.core.units import DEG

_BUMP_S = 0.2


@dataclass(frozen=True)
class PitchWeights:
    """Bryson's rule: deviations of equal cost, in rad, rad/s and rad."""

    alpha_rad: float
    q_rad_s: float
    elevator_rad: float


def pitch_lq(design: ShortPeriod, weights: PitchWeights, *, control_hz: int, effectiveness: float = 1.0) -> Gains:
    """Return LQ gains of (alpha, q, elevator) with the actuator, and the reference gain for unit DC gain to pitch rate.

    Args:
        design: the healthy model.
        weights: of alpha, q and command.
        control_hz: control rate.
        effectiveness: K of the design.

    Raises:
        DesignError: the remaining elevator does not control the model.

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
    """The proportional law with LQ gains for the estimated K; its demand is the command. A Law.

    Args:
        design: the healthy model.
        weights: of the regulator.
        control_hz: control rate.

    Attributes:
        gains: present gains.
        effectiveness: K of their design.
        law: present proportional law.
        keep: share of the step at a switch that remains after a tick.

    Raises:
        DesignError: as ``pitch_lq``.

    """

    def __init__(self, design: ShortPeriod, weights: PitchWeights, *, control_hz: int) -> None:
        self._design, self._weights, self._hz = design, weights, control_hz
        self.keep = exp(-1.0 / (_BUMP_S * control_hz))
        self.gains, self.effectiveness = pitch_lq(design, weights, control_hz=control_hz), 1.0
        self.law = self._with(self.gains)
        self._bump, self._last, self._is_new = 0.0, 0.0, False

    def _with(self, gains: Gains) -> Proportional:
        # Only the share K of the trim deflection acts.
        trim = self._design.elevator_trim_rad / self.effectiveness
        return Proportional(gains, alpha_trim_rad=self._design.alpha_trim_rad, elevator_trim_rad=trim)

    def redesign(self, effectiveness: float) -> None:
        """Redesign for another K; the next demand uses the new gains. Raises DesignError."""
        self.gains = pitch_lq(self._design, self._weights, control_hz=self._hz, effectiveness=effectiveness)
        self.effectiveness = effectiveness
        self.law, self._is_new = self._with(self.gains), True

    def demand(self, measurement: Measurement, *, q_ref_rad_s: float, elevator_rad: float, hold: bool) -> float:
        """Return the command, rad."""
        found = self.law.demand(measurement, q_ref_rad_s=q_ref_rad_s, elevator_rad=elevator_rad, hold=hold)
        self._bump *= self.keep
        if self._is_new:
            self._bump, self._is_new = self._last - found, False
        self._last = found + self._bump
        return self._last


@dataclass(frozen=True)
class Redesign:
    """Redesign of the laws when a change is confirmed and K-hat differs from the K of the design by more than the tolerance.

    Attributes:
        pitch: the elevator's law, and the index of the estimate of its K.
        roll_yaw: the law of aileron and rudder, and the indices of their estimates; None where they are not commanded or not estimated.
        floor: smallest K of a design.
        tolerance: largest deviation of K-hat from the K of the design without a redesign.

    """

    pitch: tuple[RedesignedPitch, int]
    roll_yaw: tuple[RollYaw, tuple[int, int]] | None
    floor: float
    tolerance: float = 0.05

    def update(self, estimates: Sequence[Estimate]) -> None:
        """Take the estimates of a tick and redesign where needed; the new gains act at the same tick."""
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


class WeightSettings(Settings):
    """Weights by Bryson's rule: these deviations of alpha, q and elevator cost the same."""

    alpha_deg: Positive = 3.0
    """Deviation of the angle of attack."""
    q_deg_s: Positive = 3.0
    """Deviation of the pitch rate."""
    elevator_deg: Positive = 3.0
    """Deflection of the elevator."""


class LqSettings(LawSettings):
    """Proportional law with gains that are optimal for quadratic weights, redesigned for K-hat with adaptation.method = "redesign"."""

    can_redesign: ClassVar[bool] = True
    reads_accelerometer: ClassVar[bool] = False

    law: Literal["lq"] = "lq"
    weights: WeightSettings = WeightSettings()
    """Weights of the regulator."""

    def build(self, design: ShortPeriod, control_hz: int) -> Law:
        """Return the law. Raises DesignError."""
        return RedesignedPitch(design, self._weights(), control_hz=control_hz)

    def gains_at(self, design: ShortPeriod, control_hz: int, effectiveness: float) -> Gains:
        """Return the gains at a given K. Raises DesignError."""
        return pitch_lq(design, self._weights(), control_hz=control_hz, effectiveness=effectiveness)

    def _weights(self) -> PitchWeights:
        weights = self.weights
        return PitchWeights(weights.alpha_deg * DEG, weights.q_deg_s * DEG, weights.elevator_deg * DEG)
