"""What the loop asks of an estimator."""

from __future__ import annotations

from typing import Protocol

from flightbed.signals import Estimate, Measurement


class Estimator(Protocol):
    """An estimator of effectiveness: fed one measurement per tick, in order, from tick 0."""

    def update(self, measurement: Measurement) -> Estimate:
        """Take the readings of the next tick, return the estimate at that tick."""
