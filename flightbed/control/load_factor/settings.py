"""Settings that the load-factor laws share."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from flightbed.config.kinds import PoleSettings, Surroundings
from flightbed.control.load_factor.autothrottle import Autothrottle, AutothrottleSettings
from flightbed.control.load_factor.design import POLES


class LoadFactorSettings(PoleSettings):
    """A law commanded in g, with three poles, of two states and the integral."""

    in_g: ClassVar[bool] = True

    autothrottle: AutothrottleSettings = AutothrottleSettings()
    """Control of the airspeed."""

    @property
    def times(self) -> Mapping[str, float]:
        """Key -> its time in s, of the keys that act at a time of the flight."""
        return {"autothrottle.then_at_s": self.autothrottle.then_at_s} if self.autothrottle.then_fps else {}

    def wanted_poles(self) -> list[complex]:
        """Return the poles, rad/s; without any, ``POLES``."""
        given = super().wanted_poles()
        return list(POLES) if given is None else given

    def throttle(self, *, airspeed_m_s: float, control_hz: int) -> Autothrottle | None:
        """Return the autothrottle; None if the throttle stays at trim."""
        return self.autothrottle.build(airspeed_m_s=airspeed_m_s, control_hz=control_hz)

    def conflicts(self, place: str, surroundings: Surroundings) -> list[str]:
        """Return the problems of the poles and of the autothrottle."""
        problems = super().conflicts(place, surroundings)
        if self.poles is not None and len(self.poles) != 3:
            problems.append(
                f"{place}.poles: must be three with {place}.law = '{self.law}': two states and the integral (got {len(self.poles)})"
            )
        if self.poles is not None:
            pairs = [complex(*pole) for pole in self.poles]
            if any(pairs.count(pole) != pairs.count(pole.conjugate()) for pole in pairs):
                given = [list(pole) for pole in self.poles]
                problems.append(
                    f"{place}.poles: complex ones must come in conjugate pairs, [re, im] and [re, -im] (got {given})"
                )
        throttle = self.autothrottle
        if throttle.enabled and not throttle.low_norm < throttle.high_norm:
            problems.append(
                f"{place}.autothrottle.low_norm: must be below high_norm = {throttle.high_norm:g} (got {throttle.low_norm:g})"
            )
        return problems
