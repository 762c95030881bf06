"""Pitch axis of a flight commanded in g: a load-factor law in the form of the loop's Law, its references, and the throttle."""

from __future__ import annotations

from collections.abc import Sequence
from math import nan

from flightbed.control.load_factor.autothrottle import Autothrottle
from flightbed.control.load_factor.design import LoadFactorLaw, level_g
from flightbed.core.signals import LoadFactorSample, Measurement
from flightbed.plant.base import ThrottledPlant


class LoadFactorAxis:
    """All parts of the axis, ready for one flight; a Law whose ``demand`` is called once per tick, in order.

    Args:
        plant: the flight's plant.
        law: demand on the elevator.
        references: per tick command and reference of the increment a_n, g, up positive.
        autothrottle: None keeps the throttle at its trim setting.

    Attributes:
        plant, law, references, autothrottle: as given.
        sample: the load-factor sample of the latest tick.

    """

    def __init__(
        self,
        plant: ThrottledPlant,
        law: LoadFactorLaw,
        references: Sequence[tuple[float, float]],
        autothrottle: Autothrottle | None,
    ) -> None:
        self.law = law
        self.plant, self.references, self.autothrottle = plant, references, autothrottle
        self._tick = 0
        self.sample = LoadFactorSample(nan, nan)

    def demand(self, measurement: Measurement, *, q_ref_rad_s: float, elevator_rad: float, hold: bool) -> float:  # noqa: ARG002
        """Return the elevator deflection that should act, rad; the reference is the axis's own, in g."""
        command, reference = self.references[self._tick]
        demand = self.law.demand(measurement, increment_ref_g=reference, hold=hold)
        auto, level = self.autothrottle, level_g(measurement)
        throttle = nan if auto is None else auto.throttle(measurement, self._tick)
        self.sample = LoadFactorSample(command + level, reference + level, throttle, *self.law.model)
        self._tick += 1
        return demand
