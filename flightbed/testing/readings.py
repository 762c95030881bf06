"""Test readings for estimators: flights of the exact linear plant, and readings outside the range of any flight."""

from __future__ import annotations

from dataclasses import replace
from math import inf

import numpy as np

from flightbed.avionics.onboard import OnBoard
from flightbed.command.base import profile
from flightbed.command.constant import none
from flightbed.command.doublet import doublet
from flightbed.control.correction import Adaptation
from flightbed.control.design import design_proportional
from flightbed.control.proportional import Proportional
from flightbed.core.signals import Measurement, SensorNoise
from flightbed.core.units import DEG, FT
from flightbed.failures.base import healthy
from flightbed.failures.surface import effectiveness_loss
from flightbed.flight import loop, parts
from flightbed.plant.linear import LinearPlant
from flightbed.plant.sensors import Sensors

_TICKS = 600
FAILS_AT = 150  # tick at which K drops to 0.5


def readings_of_flights(onboard: OnBoard) -> dict[str, list[Measurement]]:
    """Return flight name -> readings of six seconds on the exact linear plant; the true K corrects the law, so that no flight departs."""
    noise, silence = onboard.noise, SensorNoise(0.0, 0.0)
    loud = replace(noise, alpha_rad=20.0 * noise.alpha_rad, q_rad_s=20.0 * noise.q_rad_s)
    return {
        "healthy": _readings(onboard, noise, 1.0, moving=True),
        "K drops to 0.5": _readings(onboard, noise, 0.5, moving=True),
        "nothing moves": _readings(onboard, silence, 1.0, moving=False),
        "very noisy": _readings(onboard, loud, 0.5, moving=True),
    }


def _readings(onboard: OnBoard, noise: SensorNoise, effectiveness: float, *, moving: bool) -> list[Measurement]:
    design, hz = onboard.design, onboard.control_hz
    command = doublet(amplitude_rad_s=5.0 * DEG, period_s=3.0, count=2) if moving else none()
    flight = parts.Flight(
        plant=LinearPlant(design, control_hz=hz, airspeed_m_s=252.8, mach=0.8, altitude_m=20000 * FT),
        sensors=Sensors(noise, ticks=_TICKS, seed=np.random.SeedSequence(0)),
        profile=profile(command, ticks=_TICKS, control_hz=hz, filter_rad_s=3.0),
        health=effectiveness_loss(healthy, to=effectiveness, at_tick=FAILS_AT),
        law=Proportional(
            design_proportional(design),
            alpha_trim_rad=design.alpha_trim_rad,
            elevator_trim_rad=design.elevator_trim_rad,
        ),
        adaptation=Adaptation(
            enabled=True, oracle=True, estimator=0, floor=0.08, feedback="effective", min_rad=-inf, max_rad=inf
        ),
        estimators=[],
        alpha_trim_rad=design.alpha_trim_rad,
        control_hz=hz,
    )
    return [sample.measurement for sample in loop.fly(flight)]


def out_of_range_readings(plain: Measurement) -> dict[str, list[Measurement]]:
    """Return name -> readings outside the range of any flight: all zero, and +-0.6 rad, +-4 rad/s at +-0.5 rad of elevator."""
    where = plain._replace(theta_rad=0.0, phi_rad=0.0)
    zero = where._replace(alpha_rad=0.0, q_rad_s=0.0, elevator_rad=0.0, elevator_mean_rad=0.0)
    large = where._replace(alpha_rad=0.6, q_rad_s=4.0, elevator_rad=-0.5, elevator_mean_rad=-0.5)
    other = large._replace(alpha_rad=-0.6, q_rad_s=-4.0, elevator_rad=0.5, elevator_mean_rad=0.5)
    return {"all readings zero": [zero] * 300, "large readings": [large, other] * 150 + [large] * 150}
