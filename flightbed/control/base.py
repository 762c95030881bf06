"""Control laws: reference and measurement -> demanded effective elevator deflection."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from flightbed.core.signals import Measurement


class Law(Protocol):
    """A control law. Its demand is the *effective* deflection, trim included; Adaptation converts it into a command."""

    def demand(self, measurement: Measurement, *, q_ref_rad_s: float, elevator_rad: float, hold: bool) -> float:
        """Return the demanded effective deflection, rad.

        Args:
            measurement: the sensors' readings.
            q_ref_rad_s: pitch-rate reference.
            elevator_rad: absolute deflection to feed back.
            hold: the last command was limited by the stops: stop integrating.

        """


@dataclass(frozen=True)
class Gains:
    """Gains of the sum delta = reference r + alpha (a - a_trim) + q q + elevator (d - d_trim) + integral I(r - q).

    The signs are those that reproduce the tables of Sillence (1999); his text prints several of them reversed.
    """

    alpha: float
    q: float
    elevator: float
    reference: float
    integral: float = 0.0
