"""What the loop asks of a plant, and what trim and linearization ask of an airframe."""

from __future__ import annotations

from collections.abc import Sequence
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
    """A symmetric state of motion, wings level. Airspeed m/s, altitude m, the rest rad and rad/s."""

    airspeed_m_s: float
    alpha_rad: float
    theta_rad: float
    q_rad_s: float
    altitude_m: float


class Controls(NamedTuple):
    """Surface position (not command) and throttle. rad, normalized."""

    elevator_rad: float
    throttle_norm: float


class Rates(NamedTuple):
    """Time derivatives of a motion: m/s^2, rad/s, rad/s, rad/s^2, m/s, in the order of Motion."""

    airspeed: float
    alpha: float
    theta: float
    q: float
    altitude: float


class Response(NamedTuple):
    """What the equations of motion say at a motion: its derivatives, and the load factor at the c.g. and at the pilot, g."""

    rates: Rates
    nz_g: float
    nz_pilot_g: float


class Airframe(Protocol):
    """The equations of motion of one aircraft at one condition, actuators settled, engine at steady state."""

    name: str
    actuator: Actuator
    limits: Limits
    airspeed_m_s: float  # of the condition
    altitude_m: float  # of the condition
    mach: float  # of the condition

    def respond(self, motion: Motion, controls: Controls) -> Response:
        """Return derivatives and load factors at a motion with the controls held there."""

    def breakpoints(self, quantity: str) -> Sequence[float]:
        """Return where the tables and switches over a quantity have kinks: ``"mach"``, ``"alpha"`` or ``"elevator"``."""
