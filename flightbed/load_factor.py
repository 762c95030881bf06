"""A flight that is commanded in g: a law of load factor as the loop's Law, its references, and the throttle."""

from __future__ import annotations

from collections.abc import Sequence
from math import isnan, nan

from flightbed.control.autothrottle import Autothrottle
from flightbed.control.load_factor import LoadFactorLaw, level_g
from flightbed.plant.base import ThrottledPlant
from flightbed.signals import LoadFactorSample, Measurement


class LoadFactorAxis:
    """All parts of it, ready to fly once; a Law, which is asked once a tick, in order.

    Args:
        plant: the flight's plant.
        law: what is wanted of the elevator.
        references: of each tick command and reference of a_n, g, up positive.
        autothrottle: None leaves the throttle where the trim had it.

    Attributes:
        told: the sample of the tick that was last asked for.

    """

    def __init__(
        self,
        plant: ThrottledPlant,
        law: LoadFactorLaw,
        references: Sequence[tuple[float, float]],
        autothrottle: Autothrottle | None,
    ) -> None:
        self.law = law
        self._plant, self._references, self._autothrottle = plant, references, autothrottle
        self._tick = 0
        self.told = LoadFactorSample(nan, nan)

    def demand(self, measurement: Measurement, *, q_ref_rad_s: float, elevator_rad: float, hold: bool) -> float:  # noqa: ARG002
        """Return the deflection that should act, rad; the reference is in g and the axis's own."""
        command, reference = self._references[self._tick]
        demand = self.law.demand(measurement, increment_ref_g=reference, hold=hold)
        auto, level = self._autothrottle, level_g(measurement)
        throttle = nan if auto is None else auto.throttle(measurement, self._tick)
        self.told = LoadFactorSample(command + level, reference + level, throttle, *self.law.model)
        self._tick += 1
        return demand

    def power(self) -> None:
        """Command the engine for the period to come, as of the tick that was last asked for."""
        if not isnan(self.told.throttle_norm):
            self._plant.throttle(self.told.throttle_norm)
