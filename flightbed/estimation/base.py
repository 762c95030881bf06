"""What the loop asks of an estimator, and what an estimator may know."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from flightbed.aircraft import Actuator
from flightbed.lateral_directional import LateralDirectional
from flightbed.naming import estimate_name
from flightbed.schedule import Schedule
from flightbed.sensors import LateralNoise, SensorNoise
from flightbed.short_period import ShortPeriod
from flightbed.signals import Estimate, LateralMeasurement, Measurement


class Estimator(Protocol):
    """An estimator of effectiveness: fed one measurement per tick, in order, from tick 0.

    It may say in an attribute ``readings`` how many readings its innovation is of: what its NIS is on the average if its model holds.
    What else the loop relies on, ``flightbed.testing.check_estimator`` lists and checks.
    """

    def update(self, measurement: Measurement) -> Estimate:
        """Take the readings of the next tick, return the estimate at that tick."""


@runtime_checkable
class Commanded(Protocol):
    """An estimator that is told, besides, what the elevator is asked to do."""

    def commanded(self, elevator_cmd_rad: float) -> None:
        """Take the command of a tick, after the law has given it: it acts over the period that begins."""


@runtime_checkable
class SurfacesEstimator(Protocol):
    """An estimator of the effectiveness of several surfaces, in flights whose aileron and rudder are commanded.

    Attributes:
        surfaces: which, in the order of what ``update_all`` returns.

    """

    surfaces: tuple[str, ...]

    def update_all(self, measurement: Measurement, lateral: LateralMeasurement) -> Sequence[Estimate]:
        """Take the readings of the next tick, return an estimate for each surface; their state is the same."""


def estimate_names(name: str, estimator: Estimator | SurfacesEstimator) -> list[str]:
    """Return what the estimates of an estimator are called: by its name that of the elevator, NAME.aileron and NAME.rudder the others."""
    surfaces = estimator.surfaces if isinstance(estimator, SurfacesEstimator) else ("elevator",)
    return [estimate_name(name, surface) for surface in surfaces]


@dataclass(frozen=True, eq=False)
class OnBoard:
    """What the flight computer knows before take-off.

    Attributes:
        design: short-period model at the trim point.
        noise: standard deviations of the sensors, as believed.
        control_hz: rate of the measurements.
        schedule: pitch model over the envelope; None if no estimator of the flight asks for it.
        lateral: model of roll and yaw at the trim point; None in a flight that leaves them to the plant.
        lateral_noise: standard deviations of its sensors.
        actuator: what the elevator's actuator should make of a command; None if nobody asks.
        delay_ticks: between a command and the actuator.

    """

    design: ShortPeriod
    noise: SensorNoise
    control_hz: int
    schedule: Schedule | None = None
    lateral: LateralDirectional | None = None
    lateral_noise: LateralNoise | None = None
    actuator: Actuator | None = None
    delay_ticks: int = 0
