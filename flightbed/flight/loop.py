"""The flight loop: ``fly`` senses, estimates, decides, acts and yields one Sample per control tick."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from math import inf, isfinite

from flightbed.command.base import Profile
from flightbed.control.base import Law
from flightbed.control.correction import Adaptation
from flightbed.control.redesign import Redesign
from flightbed.core.errors import EstimateError
from flightbed.core.signals import Estimate, LateralMeasurement, LateralSample, Measurement, Sample
from flightbed.core.units import DEG
from flightbed.estimation.base import Commanded, Estimator, SurfacesEstimator, estimate_names
from flightbed.failures.base import HealthHistory
from flightbed.flight.lateral_axes import LateralAxes
from flightbed.flight.load_factor_axis import LoadFactorAxis
from flightbed.plant.base import Plant
from flightbed.plant.sensors import Sensors

_new = tuple.__new__  # makes a named tuple without its constructor, which costs 1 % of a tick
# Deviation of alpha from trim, or sideslip beta where aileron and rudder are commanded, that counts as a departure.
DEPARTURE_RAD = 25.0 * DEG


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


Updater = Callable[[Measurement, LateralMeasurement], Sequence[Estimate]]


def updater(estimator: Estimator | SurfacesEstimator) -> Updater:
    """Return the update of an estimator in a flight with lateral axes: (pitch, lateral measurement) -> its estimates.

    An estimator of the elevator alone gets the pitch measurement only.
    """
    if isinstance(estimator, SurfacesEstimator):
        return estimator.update_all
    update = estimator.update
    return lambda measurement, _lateral: (update(measurement),)


def invalid_estimate(estimator: int, smoothed: float, t_s: float) -> EstimateError:
    """Return the error of an estimator whose smoothed K is not finite at flight time ``t_s``."""
    return EstimateError(
        f"estimators.{estimator}: smoothed K is {smoothed} at t = {t_s:g} s; "
        "the correction 1/K needs a finite K, flightbed.testing.check_estimator helps to find the cause"
    )


def fly(flight: Flight) -> Iterator[Sample]:
    """Fly and yield one Sample per control tick, up to the end of the profile, a departure, or the ground (that sample included).

    Raises:
        EstimateError: the smoothed K of the correcting estimator is not finite.

    """
    plant, sensors, law, adaptation = flight.plant, flight.sensors, flight.law, flight.adaptation
    sense, read, demand_of, advance = plant.sense, sensors.read, law.demand, plant.advance
    effectiveness_used_of, feedback_of, health_at = (
        adaptation.effectiveness_used,
        adaptation.position_feedback,
        flight.health,
    )
    reference_of, command_of = adaptation.reference, adaptation.command
    axes, redesign, load_factor = flight.lateral, flight.redesign, flight.load_factor
    updaters = [updater(estimator) for estimator in flight.estimators] if axes is not None else []
    updates = [e.update for e in flight.estimators if not isinstance(e, SurfacesEstimator)] if axes is None else []
    only = updates[0] if len(updates) == 1 else None
    listeners = [e.commanded for e in flight.estimators if isinstance(e, Commanded)]
    commands = zip(flight.profile.q_cmd_rad_s.tolist(), flight.profile.q_ref_rad_s.tolist(), strict=True)
    hold, floor, following, effectiveness_used = False, flight.floor_m, health_at(0), 1.0
    alpha_trim, oracle, corrected, correcting = (
        flight.alpha_trim_rad,
        adaptation.oracle,
        adaptation.enabled,
        adaptation.estimator,
    )
    state_from = flight.state_from
    delay, delayed_commands = flight.delay_ticks, deque([plant.sense().elevator_rad] * flight.delay_ticks)
    lateral: LateralSample | None = None
    delayed_lateral_commands = deque([(0.0, 0.0)] * flight.delay_ticks)
    for tick, (q_cmd, q_ref) in enumerate(commands):
        health, following = following, health_at(tick + 1)
        truth = sense(health)
        measurement = read(tick, truth)

        if axes is not None:
            lateral = axes.sense(tick, health)
            lateral_reading = lateral.measurement
            estimates = tuple([estimate for update in updaters for estimate in update(measurement, lateral_reading)])
        else:
            estimates = (only(measurement),) if only else tuple([update(measurement) for update in updates])

        if redesign is not None:
            redesign.update(estimates)
        if oracle:  # the true K of the scenario; no estimator is used
            effectiveness_used = effectiveness_used_of(health.effectiveness)
        elif estimates:
            estimate = estimates[correcting]
            if corrected and not isfinite(estimate.effectiveness_smoothed) and isfinite(measurement.q_rad_s):
                raise invalid_estimate(correcting, estimate.effectiveness_smoothed, tick / flight.control_hz)
            effectiveness_used = effectiveness_used_of(estimate.effectiveness_smoothed, estimate.effectiveness_std)
        feedback = feedback_of(measurement.elevator_rad, effectiveness_used)
        reference = reference_of(q_ref, effectiveness_used)
        law_input = measurement
        if state_from is not None:
            law_input = measurement._replace(
                alpha_rad=estimates[state_from].alpha_rad, q_rad_s=estimates[state_from].q_rad_s
            )
        demand = demand_of(law_input, q_ref_rad_s=reference, elevator_rad=feedback, hold=hold)
        command = command_of(demand, effectiveness_used)
        hold = command != demand / effectiveness_used
        for listen in listeners:
            listen(command)

        if axes is not None and lateral is not None:
            lateral = axes.decide(lateral, estimates, tick)

        load_factor_sample = None if load_factor is None else load_factor.sample
        yield _new(Sample, (tick, q_cmd, q_ref, truth, measurement, estimates, command, lateral, load_factor_sample))
        deviation = truth.alpha_rad - alpha_trim
        if not abs(deviation) <= DEPARTURE_RAD or not isfinite(truth.q_rad_s) or truth.altitude_m < floor:
            return
        if axes is not None and lateral is not None:
            if not abs(lateral.truth.beta_rad) <= DEPARTURE_RAD:
                return
            delayed_lateral_commands.append((lateral.aileron_cmd_rad, lateral.rudder_cmd_rad))
            axes.plant.steer(*delayed_lateral_commands.popleft())
        if load_factor is not None:
            load_factor.power()
        if delay:
            delayed_commands.append(command)
            command = delayed_commands.popleft()
        advance(command, health, following)
