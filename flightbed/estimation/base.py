"""What the loop asks of an estimator, and what an estimator may know."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from flightbed.schedule import Schedule
from flightbed.sensors import SensorNoise
from flightbed.short_period import ShortPeriod
from flightbed.signals import Estimate, Measurement


class Estimator(Protocol):
    """An estimator of effectiveness: fed one measurement per tick, in order, from tick 0.

    It may say in an attribute ``readings`` how many readings its innovation is of: what its NIS is on the average if its model holds.
    What else the loop relies on, ``flightbed.testing.check_estimator`` lists and checks.
    """

    def update(self, measurement: Measurement) -> Estimate:
        """Take the readings of the next tick, return the estimate at that tick."""


@dataclass(frozen=True, eq=False)
class OnBoard:
    """What the flight computer knows before take-off.

    Attributes:
        design: short-period model at the trim point.
        noise: standard deviations of the sensors, as believed.
        control_hz: rate of the measurements.
        schedule: pitch model over the envelope; None if no estimator of the flight asks for it.

    """

    design: ShortPeriod
    noise: SensorNoise
    control_hz: int
    schedule: Schedule | None = None
