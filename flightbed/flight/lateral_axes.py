"""Roll and yaw axes of a flight with commanded aileron and rudder: sensing and control laws beside the pitch axis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite

from flightbed.control.correction import Adaptation
from flightbed.control.roll_yaw import RollYaw
from flightbed.core.errors import EstimateError
from flightbed.core.signals import Estimate, Health, LateralSample
from flightbed.plant.base import SteeredPlant
from flightbed.plant.sensors import LateralSensors


@dataclass(frozen=True)
class LateralAxes:
    """All parts of the roll and yaw axes, ready for one flight.

    Attributes:
        plant: the flight's plant.
        sensors: sensors of roll and yaw.
        references: per tick p_cmd, p_ref, rad/s, beta_cmd, beta_ref, rad.
        law: demands on aileron and rudder.
        aileron, rudder: correction of each surface; ``estimator`` is the index of the surface's estimate.
        control_hz: control rate, Hz.

    """

    plant: SteeredPlant
    sensors: LateralSensors
    references: Sequence[tuple[float, float, float, float]]
    law: RollYaw
    aileron: Adaptation
    rudder: Adaptation
    control_hz: int

    def sense(self, tick: int, health: Health) -> LateralSample:
        """Return references, truth and readings at a tick, without commands."""
        truth = self.plant.sense_lateral(health)
        return LateralSample(*self.references[tick], truth, self.sensors.read(tick, truth))

    def decide(self, sample: LateralSample, estimates: Sequence[Estimate], tick: int) -> LateralSample:
        """Return the sample with the commands to aileron and rudder, rad.

        Raises:
            EstimateError: the smoothed K of a corrected surface is not finite.

        """
        measurement, truth = sample.measurement, sample.truth
        t_s = tick / self.control_hz
        aileron_share = _effectiveness_used(self.aileron, estimates, truth.aileron_effectiveness, t_s)
        rudder_share = _effectiveness_used(self.rudder, estimates, truth.rudder_effectiveness, t_s)
        aileron, rudder = self.law.demand(
            measurement,
            p_ref_rad_s=sample.p_ref_rad_s,
            beta_ref_rad=sample.beta_ref_rad,
            aileron_rad=self.aileron.position_feedback(measurement.aileron_rad, aileron_share),
            rudder_rad=self.rudder.position_feedback(measurement.rudder_rad, rudder_share),
        )
        return sample._replace(
            aileron_cmd_rad=self.aileron.command(aileron, aileron_share),
            rudder_cmd_rad=self.rudder.command(rudder, rudder_share),
        )


def invalid_share(smoothed: float, t_s: float) -> EstimateError:
    """Return the error of an estimator whose smoothed K of aileron or rudder is not finite at flight time ``t_s``."""
    return EstimateError(
        f"estimators: smoothed K of aileron or rudder is {smoothed} at t = {t_s:g} s; the correction 1/K needs a finite K"
    )


def _effectiveness_used(adaptation: Adaptation, estimates: Sequence[Estimate], true_share: float, t_s: float) -> float:
    if not adaptation.enabled:
        return 1.0
    if adaptation.oracle:
        return adaptation.effectiveness_used(true_share)
    estimate = estimates[adaptation.estimator]
    if not isfinite(estimate.effectiveness_smoothed):
        raise invalid_share(estimate.effectiveness_smoothed, t_s)
    return adaptation.effectiveness_used(estimate.effectiveness_smoothed, estimate.effectiveness_std)
