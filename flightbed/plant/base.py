"""What the loop asks of a plant, and what trim and linearization ask of an airframe."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import cos, sin
from typing import NamedTuple, Protocol

from flightbed.signals import HEALTHY, Health, LateralTruth, Truth


class Plant(Protocol):
    """An aircraft in flight: sense it, then advance it by one control period."""

    def sense(self, health: Health = HEALTHY) -> Truth:
        """Return the truth at the present tick, from which on this is what is left of the aircraft."""

    def advance(self, elevator_cmd_rad: float, health: Health, following: Health) -> None:
        """Fly one control period with the command held and this left of the aircraft.

        ``following`` is what is left in the period after it. Raises ValueError for damage that the plant cannot fly.
        """


class SteeredPlant(Plant, Protocol):
    """A plant whose aileron and rudder are commanded, too."""

    def sense_lateral(self, health: Health) -> LateralTruth:
        """Return the truth of roll and yaw at the present tick, from which on this is what is left of the aircraft."""

    def steer(self, aileron_cmd_rad: float, rudder_cmd_rad: float) -> None:
        """Command aileron and rudder for the control period that ``advance`` will fly."""


class ThrottledPlant(Plant, Protocol):
    """A plant whose engine is commanded, too."""

    def throttle(self, throttle_norm: float) -> None:
        """Command the engine, 0 to 1, for the control period that ``advance`` will fly, and from then on."""


class Motion(NamedTuple):
    """A state of motion of the rigid body. Airspeed m/s, altitude m, the rest rad and rad/s; wings level unless told."""

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
    """Controls held: a surface in rad (position, not command) or as a normalized command, as the airframe says; throttle 0 to 1."""

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
    """What the equations of motion say at a motion: its derivatives, and load factors, g: up at c.g. and pilot, right at the c.g."""

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
        low, high: its stops, in that unit.
        source: what it is, in words.

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
    powered: bool  # without an engine trim is a glide
    throttle_acts: bool  # whether the throttle is an input of the linear model
    airspeed_m_s: float  # of the condition
    altitude_m: float  # of the condition
    mach: float  # of the condition
    span_m: float  # of the wing

    def respond(self, motion: Motion, controls: Controls) -> Response:
        """Return derivatives and load factors at a motion with the controls held there."""

    def thrust_n(self, motion: Motion, controls: Controls) -> float:
        """Return the thrust of all engines, N."""

    def breakpoints(self, quantity: str) -> Sequence[float]:
        """Return where tables and switches have kinks: over ``"mach"``, ``"alpha"``, ``"beta"``, ``"altitude"`` or ``"elevator"``."""
