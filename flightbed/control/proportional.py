"""The proportional law in Sillence's form."""

from __future__ import annotations

from flightbed.control.base import Gains
from flightbed.signals import Measurement


class Proportional:
    """Feedback of alpha, q and elevator about trim, prefilter gain for unit DC gain (Sillence S 3.2)."""

    def __init__(self, gains: Gains, *, alpha_trim_rad: float, elevator_trim_rad: float) -> None:
        self.gains = gains
        self._alpha, self._q, self._elevator, self._reference = gains.alpha, gains.q, gains.elevator, gains.reference
        self._alpha_trim, self._elevator_trim = alpha_trim_rad, elevator_trim_rad

    def demand(self, measurement: Measurement, *, q_ref_rad_s: float, elevator_rad: float, hold: bool) -> float:  # noqa: ARG002
        """Return the deflection that should act, rad."""
        return (
            self._elevator_trim
            + self._reference * q_ref_rad_s
            + self._alpha * (measurement.alpha_rad - self._alpha_trim)
            + self._q * measurement.q_rad_s
            + self._elevator * (elevator_rad - self._elevator_trim)
        )
