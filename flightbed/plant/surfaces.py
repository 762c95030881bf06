"""The control surfaces of an aircraft in JSBSim, each with its actuator and the faults that an effectiveness does not describe."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import isnan
from typing import TYPE_CHECKING

from flightbed.core.actuator import Actuator
from flightbed.core.signals import NO_FAULT, Fault

if TYPE_CHECKING:
    from flightbed.fdm.jsbsim import Fdm

Getter = Callable[[], float]


class Surface:
    """One control surface with its actuator.

    Args:
        fdm: the loaded model.
        properties: ``Aircraft.properties``.
        name: ``"elevator"``, ``"aileron"`` or ``"rudder"``.
        actuator: limits of the actuator.
        float_angle: returns the deflection of the floating surface, rad; None for 0.

    Attributes:
        stops: lowest and highest command that the actuator follows, rad; both equal in a hardover.
        put: writes a command without limits, rad.
        position: reads the actuator's position, rad.
        floats: whether the surface is detached from its actuator.
        offset_rad: deflection that acts in addition to effectiveness x position.

    """

    def __init__(
        self, fdm: Fdm, properties: Mapping[str, str], name: str, actuator: Actuator, float_angle: Getter | None
    ) -> None:
        self._actuator_stops, self._rate = (actuator.min_rad, actuator.max_rad), actuator.rate_limit_rad_s
        self.stops = self._actuator_stops
        self.put, self.position = fdm.setter(properties[f"{name}_cmd_rad"]), fdm.getter(properties[f"{name}_rad"])
        # An overlay may omit the properties of faults; scenarios with such failures are then rejected before the flight.
        self._stick, self._limit, self._offset = (
            fdm.setter(properties[f"{name}_{suffix}"]) if f"{name}_{suffix}" in properties else None
            for suffix in ("stuck", "rate_limit_rad_s", "offset_rad")
        )
        self._float_angle = float_angle
        self._actuator_fault, self._aerodynamic_fault = NO_FAULT, NO_FAULT
        self.floats = False
        self.offset_rad = 0.0

    def command(self, rad: float) -> None:
        """Command the actuator, clamped to ``stops``: JSBSim's rate limiter winds up beyond them."""
        low, high = self.stops
        self.put(low if rad < low else high if rad > high else rad)

    def set_actuator_fault(self, fault: Fault) -> None:
        """Set stuck, hardover and rate limit of the actuator, effective from the next frame."""
        if fault is self._actuator_fault:
            return
        if fault.stuck != self._actuator_fault.stuck and self._stick is not None:
            self._stick(float(fault.stuck))
        if fault.rate_share != self._actuator_fault.rate_share and self._limit is not None:
            self._limit(fault.rate_share * self._rate)
        self._actuator_fault = fault
        goes_to = fault.hardover_rad
        low, high = self._actuator_stops
        self.stops = (low, high) if isnan(goes_to) else (min(max(goes_to, low), high),) * 2

    def set_aerodynamic_fault(self, fault: Fault) -> None:
        """Set bias and floating of the surface; JSBSim's accelerations include them from the end of the next frame."""
        if fault is self._aerodynamic_fault:
            return
        self._aerodynamic_fault, self.floats = fault, fault.floats
        self._deflect(fault.bias_rad)

    def update_float(self) -> None:
        """Set the deflection of a floating surface to its float angle plus bias."""
        bias = self._aerodynamic_fault.bias_rad
        self._deflect(bias + (self._float_angle() if self._float_angle is not None else 0.0))

    def _deflect(self, rad: float) -> None:
        self.offset_rad = rad
        if self._offset is not None:
            self._offset(rad)
