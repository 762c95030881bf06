"""The parts of one flight."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf

from flightbed.command.base import Profile
from flightbed.control.base import Law
from flightbed.control.correction import Adaptation
from flightbed.control.redesign import Redesign
from flightbed.estimation.base import Estimator, SurfacesEstimator, estimate_names
from flightbed.failures.base import HealthHistory
from flightbed.flight.lateral_axes import LateralAxes
from flightbed.flight.load_factor_axis import LoadFactorAxis
from flightbed.plant.base import Plant
from flightbed.plant.sensors import Sensors


@dataclass(frozen=True)
class Flight:
    """All parts of one flight, ready to fly once."""

    plant: Plant
    sensors: Sensors
    profile: Profile
    health: HealthHistory
    law: Law
    adaptation: Adaptation
    estimators: Sequence[Estimator | SurfacesEstimator]
    alpha_trim_rad: float
    control_hz: int
    floor_m: float = -inf  # altitude of the ground, where the flight ends
    delay_ticks: int = 0  # control ticks between a command and the actuator
    state_from: int | None = None  # index of the estimate that supplies alpha and q of the law; None for the readings
    redesign: Redesign | None = None  # redesign of the laws instead of the correction by 1/K
    lateral: LateralAxes | None = None  # None if the plant controls roll and yaw
    load_factor: LoadFactorAxis | None = None  # the law of a flight commanded in g, with its throttle

    @property
    def ticks(self) -> int:
        """Number of control ticks of the whole flight."""
        return len(self.profile.q_cmd_rad_s)

    @property
    def estimates(self) -> int:
        """Number of estimates per tick."""
        return sum(len(estimate_names("", estimator)) for estimator in self.estimators)

    def __post_init__(self) -> None:
        if self.adaptation.enabled and not self.adaptation.oracle and not self.estimators:
            raise ValueError("adaptation is enabled, but the flight has no estimator")
        if self.state_from is not None and self.state_from >= self.estimates:
            raise ValueError(
                f"state_from: the flight has {self.estimates} estimates (got {self.state_from}); give a smaller index"
            )
        if self.lateral is None and any(isinstance(estimator, SurfacesEstimator) for estimator in self.estimators):
            raise ValueError("an estimator of several surfaces needs a flight with lateral axes")
        if self.load_factor is not None and self.law is not self.load_factor:
            raise ValueError("law and load_factor must be the same object in a flight commanded in g")
