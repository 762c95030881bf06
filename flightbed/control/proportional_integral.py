"""The proportional-integral law in Sillence's form."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from flightbed.avionics.short_period import ShortPeriod
from flightbed.config.kinds import GainOrPoleSettings, IntegralGainSettings
from flightbed.config.table import between, only_with
from flightbed.control.base import Gains, Law
from flightbed.control.design import design_integral
from flightbed.control.proportional import Proportional, given_gains
from flightbed.core.signals import Measurement


class ProportionalIntegral:
    """The proportional law plus the integral of r - q, held while the command is at a stop (Sillence S 3.3)."""

    def __init__(self, gains: Gains, *, alpha_trim_rad: float, elevator_trim_rad: float, control_hz: int) -> None:
        self._proportional = Proportional(gains, alpha_trim_rad=alpha_trim_rad, elevator_trim_rad=elevator_trim_rad)
        self.gains, self.alpha_trim_rad, self.elevator_trim_rad = gains, alpha_trim_rad, elevator_trim_rad
        self.per_tick = gains.integral / control_hz
        self._integral = 0.0

    def demand(self, measurement: Measurement, *, q_ref_rad_s: float, elevator_rad: float, hold: bool) -> float:
        """Return the demanded effective deflection, rad."""
        demand = self._integral + self._proportional.demand(
            measurement, q_ref_rad_s=q_ref_rad_s, elevator_rad=elevator_rad, hold=hold
        )
        if not hold:
            self._integral += self.per_tick * (q_ref_rad_s - measurement.q_rad_s)
        return demand


class ProportionalIntegralSettings(GainOrPoleSettings):
    """Add to the proportional law the integral of the pitch-rate error (Sillence S 3.3)."""

    reads_accelerometer: ClassVar[bool] = False

    law: Literal["proportional-integral"] = "proportional-integral"
    gains: IntegralGainSettings | None = None
    """Gains, which replace the design."""
    integral_pole_rad_s: Annotated[float, between(-100.0, -1e-6), only_with(gains=None)] = -0.5
    """Fourth pole of the closed loop."""

    def build(self, design: ShortPeriod, control_hz: int) -> Law:
        """Return the law. Raises DesignError."""
        return ProportionalIntegral(
            given_gains(self.gains, integral=self.gains.integral)
            if self.gains
            else design_integral(design, self.wanted_poles(), integral_pole=self.integral_pole_rad_s),
            alpha_trim_rad=design.alpha_trim_rad,
            elevator_trim_rad=design.elevator_trim_rad,
            control_hz=control_hz,
        )
