"""The proportional-integral law in Sillence's form."""

from __future__ import annotations

from flightbed.avionics.short_period import ShortPeriod
from flightbed.config import kinds
from flightbed.control.base import Gains, Law
from flightbed.control.design import design_integral
from flightbed.control.proportional import Proportional, given_gains, wanted_poles
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


def build(settings: kinds.Control, design: ShortPeriod, control_hz: int) -> Law:
    """Add to the proportional law the integral of the pitch-rate error (Sillence S 3.3)."""
    return ProportionalIntegral(
        given_gains(settings.gains, integral=settings.gains.integral)
        if settings.gains
        else design_integral(design, wanted_poles(settings), integral_pole=settings.integral_pole_rad_s),
        alpha_trim_rad=design.alpha_trim_rad,
        elevator_trim_rad=design.elevator_trim_rad,
        control_hz=control_hz,
    )
