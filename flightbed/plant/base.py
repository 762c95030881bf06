"""Protocols: the plant of the simulation loop, and the airframe of trim and linearization."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import cos, sin
from typing import NamedTuple, Protocol

from flightbed.core.signals import HEALTHY, Health, LateralTruth, Truth


class Plant(Protocol):
    """An aircraft in flight: sense it, then advance it by one control period."""

    def sense(self, health: Health = HEALTHY) -> Truth:
        """Return the truth at the current tick; ``health`` applies from this tick on."""

    def advance(self, elevator_cmd_rad: float, health: Health, following: Health) -> None:
        """Fly one control period with the elevator command held at this health.

        ``following`` is the health in the next period. Raises ValueError for damage that the plant does not model.
        """


class SteeredPlant(Plant, Protocol):
    """A plant that also takes aileron and rudder commands."""

    def sense_lateral(self, health: Health) -> LateralTruth:
        """Return the truth of roll and yaw at the current tick; ``health`` applies from this tick on."""

    def steer(self, aileron_cmd_rad: float, rudder_cmd_rad: float) -> None:
        """Command aileron and rudder for the control period that the next ``advance`` flies."""


class ThrottledPlant(Plant, Protocol):
    """A plant that also takes a throttle command."""

    def throttle(self, throttle_norm: float) -> None:
        """Command the engine, 0 to 1, from the control period that the next ``advance`` flies."""


class Motion(NamedTuple):
    """State of motion of the rigid body. Airspeed m/s, altitude m, the rest rad and rad/s; the defaults are wings level."""

    airspeed_m_s: float
    alpha_rad: float
    theta_rad: float
    q_rad_s: float
    altitude_m: float
    beta_rad: float = 0.0
    phi_rad: float = 0.0
    p_rad_s: float = 0.0
    r_rad_s: float = 0.0
    psi_rad: float = 0.0

    @property
    def climb_m_s(self) -> float:
        """Rate of climb, m/s."""
        u = self.airspeed_m_s * cos(self.alpha_rad) * cos(self.beta_rad)
        v = self.airspeed_m_s * sin(self.beta_rad)
        w = self.airspeed_m_s * sin(self.alpha_rad) * cos(self.beta_rad)
        return u * sin(self.theta_rad) - (v * sin(self.phi_rad) + w * cos(self.phi_rad)) * cos(self.theta_rad)


class Controls(NamedTuple):
    """Control inputs, held constant: surfaces as positions in rad or normalized commands (``Airframe.inputs``); throttle 0 to 1."""

    elevator: float
    throttle: float
    aileron: float = 0.0
    rudder: float = 0.0


class Rates(NamedTuple):
    """Time derivatives of a motion, in the order of Motion: m/s^2, rad/s, rad/s, rad/s^2, m/s; rad/s, rad/s, rad/s^2 twice, rad/s."""

    airspeed: float
    alpha: float
    theta: float
    q: float
    altitude: float
    beta: float = 0.0
    phi: float = 0.0
    p: float = 0.0
    r: float = 0.0
    psi: float = 0.0


class Response(NamedTuple):
    """Derivatives of a motion and its load factors, g: upward at the c.g. and at the pilot, to the right at the c.g."""

    rates: Rates
    nz_g: float
    nz_pilot_g: float
    ny_g: float = 0.0


@dataclass(frozen=True)
class Input:
    """A control of an airframe, in the order of Controls.

    Attributes:
        name: ``"elevator"``, ``"throttle"``, ``"aileron"`` or ``"rudder"``.
        unit: ``"rad"`` for a surface position, ``"1"`` for a normalized command.
        low, high: stops, in that unit.
        source: description of the input.

    """

    name: str
    unit: str
    low: float
    high: float
    source: str


class Airframe(Protocol):
    """The equations of motion of one aircraft at one condition, hidden states (actuators, engine) settled."""

    name: str
    alpha_limits_rad: tuple[float, float]
    inputs: tuple[Input, ...]  # in the order of Controls
    powered: bool  # False: no engine, trim is a glide
    throttle_acts: bool  # whether the throttle is an input of the linear model
    airspeed_m_s: float  # of the condition
    altitude_m: float  # of the condition
    mach: float  # of the condition
    span_m: float  # of the wing

    def respond(self, motion: Motion, controls: Controls) -> Response:
        """Return the derivatives and load factors of a motion with the controls held."""

    def thrust_n(self, motion: Motion, controls: Controls) -> float:
        """Return the thrust of all engines, N."""

    def breakpoints(self, quantity: str) -> Sequence[float]:
        """Return the kinks of tables and switches over ``"mach"``, ``"alpha"``, ``"beta"``, ``"altitude"`` or ``"elevator"``, SI."""
