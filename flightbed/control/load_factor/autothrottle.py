"""A bang-bang autothrottle on airspeed (Kemp 1987, S 6.3 and the listing of subroutine D)."""

from __future__ import annotations

from dataclasses import dataclass

from flightbed.config import kinds
from flightbed.core.atmosphere import standard_air
from flightbed.core.signals import Measurement
from flightbed.core.units import FT


@dataclass(frozen=True)
class Autothrottle:
    """Two throttle settings: the high one below the target airspeed, the low one above.

    Attributes:
        low_norm, high_norm: the throttle settings; 0.25 and 1 in the listing, for its engine.
        airspeed_m_s: target true airspeed; the measured one comes from air data.
        then_m_s: target from the tick ``from_tick`` on.
        from_tick: first tick of ``then_m_s``.

    """

    low_norm: float
    high_norm: float
    airspeed_m_s: float
    then_m_s: float
    from_tick: int

    def throttle(self, measurement: Measurement, tick: int) -> float:
        """Return the throttle command, 0 to 1."""
        wanted = self.then_m_s if tick >= self.from_tick else self.airspeed_m_s
        airspeed = measurement.mach * standard_air(measurement.altitude_m).sound_m_s
        return self.high_norm if airspeed < wanted else self.low_norm


def build(settings: kinds.Autothrottle, *, airspeed_m_s: float, control_hz: int) -> Autothrottle | None:
    """Return an build that holds the initial airspeed, and then_fps from then_at_s on; None if it is disabled."""
    if not settings.enabled:
        return None
    return Autothrottle(
        settings.low_norm,
        settings.high_norm,
        airspeed_m_s,
        settings.then_fps * FT if settings.then_fps else airspeed_m_s,
        round(settings.then_at_s * control_hz),
    )
