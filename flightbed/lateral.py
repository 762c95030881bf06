"""Roll and yaw of a flight whose aileron and rudder are commanded: sensed, decided and steered beside the pitch axis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite

from flightbed.control.adaptation import Adaptation
from flightbed.control.roll_yaw import RollYaw
from flightbed.errors import EstimateError
from flightbed.plant.base import SteeredPlant
from flightbed.sensors import LateralSensors
from flightbed.signals import Estimate, Health, LateralSample


@dataclass(frozen=True)
class LateralAxes:
    """All parts of roll and yaw, ready to fly once.

    Attributes:
        plant: the flight's plant.
        sensors: of roll and yaw.
        references: of each tick p_cmd, p_ref, rad/s, beta_cmd, beta_ref, rad.
        law: what is wanted of aileron and rudder.
        aileron, rudder: correction of each surface; ``estimator`` is the index of its own estimate.

    """

    plant: SteeredPlant
    sensors: LateralSensors
    references: Sequence[tuple[float, float, float, float]]
    law: RollYaw
    aileron: Adaptation
    rudder: Adaptation

    def sense(self, tick: int, health: Health) -> LateralSample:
        """Return truth and readings at a tick; nothing is commanded yet."""
        truth = self.plant.sense_lateral(health)
        return LateralSample(*self.references[tick], truth, self.sensors.read(tick, truth))

    def decide(self, sample: LateralSample, estimates: Sequence[Estimate], tick: int) -> LateralSample:
        """Return the sample with the commands to aileron and rudder.

        Raises EstimateError for a smoothed K that is no number.
        """
        read, truth = sample.measurement, sample.truth
        aileron_share = _believed(self.aileron, estimates, truth.aileron_effectiveness, tick)
        rudder_share = _believed(self.rudder, estimates, truth.rudder_effectiveness, tick)
        aileron, rudder = self.law.demand(
            read,
            p_ref_rad_s=sample.p_ref_rad_s,
            beta_ref_rad=sample.beta_ref_rad,
            aileron_rad=self.aileron.position_feedback(read.aileron_rad, aileron_share),
            rudder_rad=self.rudder.position_feedback(read.rudder_rad, rudder_share),
        )
        return sample._replace(
            aileron_cmd_rad=self.aileron.command(aileron, aileron_share),
            rudder_cmd_rad=self.rudder.command(rudder, rudder_share),
        )


def _believed(adaptation: Adaptation, estimates: Sequence[Estimate], true_share: float, tick: int) -> float:
    if not adaptation.enabled:
        return 1.0
    if adaptation.oracle:
        return adaptation.effectiveness_used(true_share)
    estimate = estimates[adaptation.estimator]
    if not isfinite(estimate.effectiveness_smoothed):
        raise EstimateError(
            f"estimators: the smoothed K of a surface is {estimate.effectiveness_smoothed} at tick {tick}; "
            "the law cannot be corrected by that"
        )
    return adaptation.effectiveness_used(estimate.effectiveness_smoothed, estimate.effectiveness_std)
