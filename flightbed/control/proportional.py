"""The proportional law in Sillence's form."""

from __future__ import annotations

from typing import ClassVar, Literal

from flightbed.avionics.short_period import ShortPeriod
from flightbed.config.kinds import GainOrPoleSettings, GainSettings
from flightbed.control.base import Gains, Law
from flightbed.control.design import design_proportional
from flightbed.core.compiled import compiled, plain
from flightbed.core.signals import Measurement


@compiled
def proportional_demand(
    gain_reference: float, gain_alpha: float, gain_q: float, gain_elevator: float, elevator_trim: float,
    q_ref: float, alpha: float, q: float, elevator: float,
) -> float:  # fmt: skip
    """Return the demanded effective deflection, rad; alpha and elevator are deviations from trim."""
    return elevator_trim + gain_reference * q_ref + gain_alpha * alpha + gain_q * q + gain_elevator * elevator


_demand = plain(proportional_demand)


class Proportional:
    """Feedback of alpha, q and elevator about trim, prefilter gain for unit DC gain (Sillence S 3.2)."""

    def __init__(self, gains: Gains, *, alpha_trim_rad: float, elevator_trim_rad: float) -> None:
        self.gains = gains
        self._alpha, self._q, self._elevator, self._reference = gains.alpha, gains.q, gains.elevator, gains.reference
        self.alpha_trim_rad, self.elevator_trim_rad = alpha_trim_rad, elevator_trim_rad

    def demand(self, measurement: Measurement, *, q_ref_rad_s: float, elevator_rad: float, hold: bool) -> float:  # noqa: ARG002
        """Return the demanded effective deflection, rad."""
        return _demand(
            self._reference, self._alpha, self._q, self._elevator, self.elevator_trim_rad,
            q_ref_rad_s, measurement.alpha_rad - self.alpha_trim_rad, measurement.q_rad_s, elevator_rad - self.elevator_trim_rad,
        )  # fmt: skip


def given_gains(gains: GainSettings, *, integral: float = 0.0) -> Gains:
    """Return the gains of the settings, with their signs as in ``control.base.Gains``."""
    return Gains(gains.alpha, gains.q_s, gains.elevator, gains.reference_s, integral)


class ProportionalSettings(GainOrPoleSettings):
    """Feedback of alpha, q and elevator, prefilter gain for unit DC gain (Sillence S 3.2)."""

    reads_accelerometer: ClassVar[bool] = False

    law: Literal["proportional"] = "proportional"

    def build(self, design: ShortPeriod, control_hz: int) -> Law:  # noqa: ARG002
        """Return the law. Raises DesignError."""
        return Proportional(
            given_gains(self.gains) if self.gains else design_proportional(design, self.wanted_poles()),
            alpha_trim_rad=design.alpha_trim_rad,
            elevator_trim_rad=design.elevator_trim_rad,
        )
