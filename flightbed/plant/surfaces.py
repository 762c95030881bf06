"""The surfaces of an aircraft in JSBSim, each with its actuator: commanded, and failing in ways that an effectiveness does not tell."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import isnan
from typing import TYPE_CHECKING

from flightbed.aircraft import Actuator
from flightbed.signals import NO_FAULT, Fault

if TYPE_CHECKING:
    from flightbed.plant.jsbsim import Fdm

Getter = Callable[[], float]


class Surface:
    """One surface in flight.

    Args:
        fdm: the aircraft.
        properties: ``Aircraft.properties``.
        name: ``"elevator"``, ``"aileron"`` or ``"rudder"``.
        actuator: its actuator.
        stream: angle at which it trails when it has come off, rad; None for 0.

    Attributes:
        stops: lowest and highest command that the actuator follows; one and the same of an actuator that goes where it likes.
        put: writes a command as it is.
        position: reads the actuator's position.
        floats: whether it has come off.
        offset_rad: deflection that acts beside effectiveness x position.

    """

    def __init__(
        self, fdm: Fdm, properties: Mapping[str, str], name: str, actuator: Actuator, stream: Getter | None
    ) -> None:
        self._actuator_stops, self._rate = (actuator.min_rad, actuator.max_rad), actuator.rate_limit_rad_s
        self.stops = self._actuator_stops
        self.put, self.position = fdm.setter(properties[f"{name}_cmd_rad"]), fdm.getter(properties[f"{name}_rad"])
        # An overlay may do without what faults need; flights with such failures are then refused before they begin.
        self._stick, self._limit, self._offset = (
            fdm.setter(properties[f"{name}_{what}"]) if f"{name}_{what}" in properties else None
            for what in ("stuck", "rate_limit_rad_s", "offset_rad")
        )
        self._stream = stream
        self._actuator, self._acting = NO_FAULT, NO_FAULT
        self.floats = False
        self.offset_rad = 0.0

    def command(self, rad: float) -> None:
        """Command the actuator, within ``stops``: JSBSim's rate limiter runs on beyond them and comes back late."""
        low, high = self.stops
        self.put(low if rad < low else high if rad > high else rad)

    def seize(self, fault: Fault) -> None:
        """Make this what is wrong with the actuator, from the next frame on."""
        if fault is self._actuator:
            return
        if fault.stuck != self._actuator.stuck and self._stick is not None:
            self._stick(float(fault.stuck))
        if fault.rate_share != self._actuator.rate_share and self._limit is not None:
            self._limit(fault.rate_share * self._rate)
        self._actuator = fault
        goes_to = fault.hardover_rad
        low, high = self._actuator_stops
        self.stops = (low, high) if isnan(goes_to) else (min(max(goes_to, low), high),) * 2

    def become(self, fault: Fault) -> None:
        """Make this what is wrong beyond the actuator: JSBSim's accelerations show it from the end of the next frame on."""
        if fault is self._acting:
            return
        self._acting, self.floats = fault, fault.floats
        self._deflect(fault.bias_rad)

    def trail(self) -> None:
        """Let a surface that has come off follow the stream."""
        self._deflect(self._acting.bias_rad + (self._stream() if self._stream is not None else 0.0))

    def _deflect(self, rad: float) -> None:
        self.offset_rad = rad
        if self._offset is not None:
            self._offset(rad)
