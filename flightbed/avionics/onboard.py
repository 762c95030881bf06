"""The knowledge of the flight computer before take-off."""

from __future__ import annotations

from dataclasses import dataclass

from flightbed.avionics.lateral import LateralDirectional
from flightbed.avionics.schedule import Schedule
from flightbed.avionics.short_period import ShortPeriod
from flightbed.core.actuator import Actuator
from flightbed.core.signals import LateralNoise, SensorNoise


@dataclass(frozen=True, eq=False)
class OnBoard:
    """Knowledge of the flight computer before take-off.

    Attributes:
        design: short-period model at the trim point.
        noise: assumed standard deviations of the sensors.
        control_hz: rate of the measurements.
        schedule: pitch model over the envelope; None if no estimator of the flight uses it.
        lateral: model of roll and yaw at the trim point; None in a flight without commanded aileron and rudder.
        lateral_noise: assumed standard deviations of the lateral sensors.
        actuator: model of the elevator's actuator; None if no estimator of the flight uses it.
        delay_ticks: delay between a command and the actuator.

    """

    design: ShortPeriod
    noise: SensorNoise
    control_hz: int
    schedule: Schedule | None = None
    lateral: LateralDirectional | None = None
    lateral_noise: LateralNoise | None = None
    actuator: Actuator | None = None
    delay_ticks: int = 0
