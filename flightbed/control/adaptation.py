"""Adaptation: the correction by 1/K-hat, after the summing junction and before the actuator."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Adaptation:
    """Turn the deflection that should act into the deflection to command.

    The demand is absolute: the elevator's trim deflection loses its moment with the rest, so the correction multiplies
    all of it, demand / K-hat, not only the deviation from trim. With ``feedback = "effective"`` the law is fed
    K-hat times the surface position: if K-hat is right the loop is then exactly the healthy one in the variable
    K times position. ``"position"`` feeds back the surface position itself, as in Sillence's Figure 1.

    Attributes:
        enabled: off means K-hat = 1 throughout.
        estimator: index of the estimator that adapts.
        floor: smallest K-hat that is believed; bounds the loop gain.
        feedback: ``"effective"`` or ``"position"``.
        min_rad, max_rad: stops of the elevator; the command is cut there.

    """

    enabled: bool
    estimator: int
    floor: float
    feedback: str
    min_rad: float
    max_rad: float

    def believed(self, effectiveness_smoothed: float) -> float:
        """Return the K-hat to divide by."""
        if not self.enabled:
            return 1.0
        return effectiveness_smoothed if effectiveness_smoothed > self.floor else self.floor

    def elevator_feedback(self, elevator_rad: float, believed: float) -> float:
        """Return the deflection that the law is fed, rad."""
        return believed * elevator_rad if self.feedback == "effective" else elevator_rad

    def command(self, demand_rad: float, believed: float) -> float:
        """Return the command, cut at the stops, rad."""
        command = demand_rad / believed
        return self.min_rad if command < self.min_rad else self.max_rad if command > self.max_rad else command
