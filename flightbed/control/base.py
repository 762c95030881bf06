"""Control laws: reference and measurement -> the elevator deflection that should act."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from flightbed.signals import Measurement


class Law(Protocol):
    """A control law. Its demand is the *effective* deflection, trim included; Adaptation makes a command of it."""

    def demand(self, measurement: Measurement, *, q_ref_rad_s: float, elevator_rad: float, hold: bool) -> float:
        """Return the deflection that should act, rad.

        Args:
            measurement: the sensors' readings.
            q_ref_rad_s: reference.
            elevator_rad: deflection to feed back, absolute.
            hold: the last command was cut at the stops: do not integrate further.

        """


@dataclass(frozen=True)
class Gains:
    """Gains that are summed: delta = reference r + alpha (a - a_trim) + q q + elevator (d - d_trim) + integral I(r - q).

    These are the signs that give the tables of Sillence (1999); his text prints several of them the other way.
    """

    alpha: float
    q: float
    elevator: float
    reference: float
    integral: float = 0.0
