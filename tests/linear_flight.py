"""A flight on the exact linear plant: where the estimator's model is true."""

from __future__ import annotations

import numpy as np

from flightbed.avionics.onboard import OnBoard
from flightbed.avionics.short_period import ShortPeriod
from flightbed.command.base import profile
from flightbed.command.doublet import doublet
from flightbed.control.correction import Adaptation
from flightbed.control.design import design_proportional
from flightbed.control.proportional import Proportional
from flightbed.core.signals import Sample, SensorNoise
from flightbed.core.units import DEG
from flightbed.estimation.base import Estimator
from flightbed.estimation.loop_gain.estimator import LoopGain, LoopGainConfig
from flightbed.failures.base import healthy
from flightbed.failures.surface import effectiveness_loss
from flightbed.flight.loop import fly
from flightbed.flight.parts import Flight
from flightbed.plant.linear import LinearPlant
from flightbed.plant.sensors import Sensors

NOISE = SensorNoise(0.03 * DEG, 0.1108 * DEG)


def fly_linear(
    design: ShortPeriod,
    *,
    config: LoopGainConfig,
    effectiveness: float,
    seed: int,
    ticks: int = 450,
    at_tick: int = 0,
    adapt: bool = False,
    absolute: bool = True,
) -> tuple[list[Sample], Estimator]:
    """Fly doublets with K = ``effectiveness`` from ``at_tick`` on; returns the samples and the estimator."""
    estimator = LoopGain(config, OnBoard(design, NOISE, 100))
    flight = Flight(
        plant=LinearPlant(design, control_hz=100, absolute=absolute),
        sensors=Sensors(NOISE, ticks=ticks, seed=np.random.SeedSequence(seed)),
        profile=profile(
            doublet(amplitude_rad_s=5 * DEG, period_s=4.5, count=3), ticks=ticks, control_hz=100, filter_rad_s=3.0
        ),
        health=effectiveness_loss(healthy, to=effectiveness, at_tick=at_tick),
        law=Proportional(
            design_proportional(design),
            alpha_trim_rad=design.alpha_trim_rad,
            elevator_trim_rad=design.elevator_trim_rad,
        ),
        adaptation=Adaptation(enabled=adapt, estimator=0, floor=0.08, feedback="effective", min_rad=-1e3, max_rad=1e3),
        estimators=[estimator],
        alpha_trim_rad=design.alpha_trim_rad,
        control_hz=100,
    )
    return list(fly(flight)), estimator
