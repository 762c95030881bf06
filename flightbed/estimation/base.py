"""Interface of estimators to the loop, and the on-board knowledge available to them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

from flightbed.core.estimate_names import estimate_name
from flightbed.core.signals import Estimate, LateralMeasurement, Measurement


class Estimator(Protocol):
    """An estimator of effectiveness; receives one measurement per tick, in order, from tick 0.

    An optional attribute ``readings`` gives the number of readings in its innovation, which is the mean NIS if its model holds.
    ``flightbed.testing.check_estimator`` lists and checks the other requirements of the loop.
    """

    def update(self, measurement: Measurement) -> Estimate:
        """Take the readings of the next tick, return the estimate at that tick."""


@runtime_checkable
class Commanded(Protocol):
    """An estimator that also receives the elevator commands."""

    def commanded(self, elevator_cmd_rad: float) -> None:
        """Take the law's command of a tick, rad; it acts over the period that begins at this tick."""


@runtime_checkable
class SurfacesEstimator(Protocol):
    """An estimator of the effectiveness of several surfaces, for flights with commanded aileron and rudder.

    Attributes:
        surfaces: names of the surfaces, in the order of the estimates from ``update_all``.

    """

    surfaces: tuple[str, ...]

    def update_all(self, measurement: Measurement, lateral: LateralMeasurement) -> Sequence[Estimate]:
        """Take the readings of the next tick, return an estimate for each surface; all have the same state."""


def estimate_names(name: str, estimator: Estimator | SurfacesEstimator) -> list[str]:
    """Return the names of an estimator's estimates: NAME for the elevator, NAME.aileron and NAME.rudder for the others."""
    surfaces = estimator.surfaces if isinstance(estimator, SurfacesEstimator) else ("elevator",)
    return [estimate_name(name, surface) for surface in surfaces]
