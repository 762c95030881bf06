"""A bang-bang autothrottle on airspeed (Kemp 1987, S 6.3 and the listing of subroutine D)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from flightbed.config.table import Above, NonNegative, Settings, Share, only_with
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


class AutothrottleSettings(Settings):
    """Bang-bang autothrottle; it holds the initial true airspeed."""

    enabled: bool = False
    """Control the airspeed; otherwise the throttle stays at trim."""
    low_norm: Annotated[Share, only_with(enabled=True)] = 0.1
    """Throttle setting above the target airspeed, 0 to 1."""
    high_norm: Annotated[Share, only_with(enabled=True)] = 1.0
    """Throttle setting below the target airspeed, 0 to 1."""
    then_fps: Annotated[NonNegative, only_with(enabled=True)] = 0.0
    """Another true airspeed to hold later; 0: none."""
    then_at_s: Annotated[NonNegative, only_with(enabled=True, then_fps=Above(0.0))] = 0.0
    """Start of the other airspeed."""

    def build(self, *, airspeed_m_s: float, control_hz: int) -> Autothrottle | None:
        """Return an autothrottle that holds the initial airspeed, and then_fps from then_at_s on; None if it is disabled."""
        if not self.enabled:
            return None
        return Autothrottle(
            self.low_norm,
            self.high_norm,
            airspeed_m_s,
            self.then_fps * FT if self.then_fps else airspeed_m_s,
            round(self.then_at_s * control_hz),
        )
