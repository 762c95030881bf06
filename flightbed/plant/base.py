"""What the loop asks of a plant, and what trim and linearization ask of an airframe."""

from __future__ import annotations

from typing import NamedTuple, Protocol

from flightbed.aircraft import Actuator, Limits
from flightbed.signals import Truth


class Plant(Protocol):
    """An aircraft in flight: sense it, then advance it by one control period."""

    def sense(self, effectiveness: float = 1.0) -> Truth:
        """Return the truth at the present tick, from which on this share of the elevator's deflection acts."""

    def advance(self, elevator_cmd_rad: float, effectiveness: float, following: float) -> None:
        """Fly one control period with the command held and this share of the elevator's deflection acting.

        ``following`` is the share in the period after it.
        """


class Motion(NamedTuple):
    """A symmetric state of motion, wings level. Airspeed m/s, the rest rad and rad/s."""

    airspeed_m_s: float
    alpha_rad: float
    theta_rad: float
    q_rad_s: float


class Controls(NamedTuple):
    """Surface position (not command) and throttle. rad, normalized."""

    elevator_rad: float
    throttle_norm: float


class Rates(NamedTuple):
    """Time derivatives of a motion: m/s^2, rad/s, rad/s, rad/s^2, in the order of Motion."""

    airspeed: float
    alpha: float
    theta: float
    q: float


class Airframe(Protocol):
    """The equations of motion of one aircraft at one altitude and c.g., actuators settled, engine at steady state."""

    name: str
    actuator: Actuator
    limits: Limits
    airspeed_m_s: float  # of the condition

    def rates(self, motion: Motion, controls: Controls) -> Rates:
        """Return the time derivatives at a motion with the controls held there."""
