"""fly(): sense, estimate, decide, act, record - a generator of Samples."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from math import inf, isfinite

from flightbed.command.base import Profile
from flightbed.control.adaptation import Adaptation
from flightbed.control.base import Law
from flightbed.control.redesign import Redesign
from flightbed.errors import EstimateError
from flightbed.estimation.base import Commanded, Estimator, SurfacesEstimator, estimate_names
from flightbed.failures.base import HealthHistory
from flightbed.lateral import LateralAxes
from flightbed.load_factor import LoadFactorAxis
from flightbed.plant.base import Plant
from flightbed.sensors import Sensors
from flightbed.signals import Estimate, LateralMeasurement, LateralSample, Measurement, Sample
from flightbed.units import DEG

_new = tuple.__new__  # of a named tuple: without its constructor, which costs a tick in a hundred
DEPARTURE_RAD = (
    25.0 * DEG
)  # deviation of alpha from trim, or of beta where rudder and aileron are commanded, that counts as a departure


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
    floor_m: float = -inf  # altitude at which the flight ends in the ground
    delay_ticks: int = 0  # between a command and the actuator
    state_from: int | None = None  # index of the estimate whose alpha and q the law is fed; None for the readings
    redesign: Redesign | None = None  # of the laws, instead of the correction by 1/K
    lateral: LateralAxes | None = None  # None leaves roll and yaw to the plant
    load_factor: LoadFactorAxis | None = None  # the law, where it is commanded in g and may have the throttle

    @property
    def estimates(self) -> int:
        """Number of estimates at a tick."""
        return sum(len(estimate_names("", estimator)) for estimator in self.estimators)

    def __post_init__(self) -> None:
        if self.adaptation.enabled and not self.adaptation.oracle and not self.estimators:
            raise ValueError("adaptation is enabled, but the flight has no estimator")
        if self.state_from is not None and self.state_from >= self.estimates:
            raise ValueError("the law is to be fed an estimator's state, but the flight has no such estimator")
        if self.lateral is None and any(isinstance(estimator, SurfacesEstimator) for estimator in self.estimators):
            raise ValueError("an estimator of several surfaces flies only where aileron and rudder are commanded")
        if self.load_factor is not None and self.law is not self.load_factor:
            raise ValueError("a flight that is commanded in g has one law, that of the load factor")


Teller = Callable[[Measurement, LateralMeasurement], Sequence[Estimate]]


def teller(estimator: Estimator | SurfacesEstimator) -> Teller:
    """Return what asks an estimator where aileron and rudder are commanded: one of the elevator alone is told nothing of them."""
    if isinstance(estimator, SurfacesEstimator):
        return estimator.update_all
    update = estimator.update
    return lambda measurement, _lateral: (update(measurement),)


def not_a_number(estimator: int, smoothed: float, tick: int) -> EstimateError:
    """Return the error of an estimator whose smoothed K is no number."""
    return EstimateError(
        f"estimators.{estimator}: its smoothed K is {smoothed} at tick {tick}; "
        "the law cannot be corrected by that, flightbed.testing.check_estimator helps to find out why"
    )


def fly(flight: Flight) -> Iterator[Sample]:
    """Fly, yielding one Sample per control tick; stops at the end of the profile, or after the sample that departs or hits the ground."""
    plant, sensors, law, adaptation = flight.plant, flight.sensors, flight.law, flight.adaptation
    sense, read, demand_of, advance = plant.sense, sensors.read, law.demand, plant.advance
    believed_of, feedback_of, health_at = adaptation.effectiveness_used, adaptation.position_feedback, flight.health
    reference_of, command_of = adaptation.reference, adaptation.command
    axes, redesign, pulling = flight.lateral, flight.redesign, flight.load_factor
    tellers = [teller(estimator) for estimator in flight.estimators] if axes is not None else []
    updates = [e.update for e in flight.estimators if not isinstance(e, SurfacesEstimator)] if axes is None else []
    only = updates[0] if len(updates) == 1 else None
    listeners = [e.commanded for e in flight.estimators if isinstance(e, Commanded)]
    commands = zip(flight.profile.q_cmd_rad_s.tolist(), flight.profile.q_ref_rad_s.tolist(), strict=True)
    hold, floor, following, believed = False, flight.floor_m, health_at(0), 1.0
    alpha_trim, oracle, corrected, which = (
        flight.alpha_trim_rad,
        adaptation.oracle,
        adaptation.enabled,
        adaptation.estimator,
    )
    state_from = flight.state_from
    delay, on_the_way = flight.delay_ticks, deque([plant.sense().elevator_rad] * flight.delay_ticks)
    lateral: LateralSample | None = None
    steering = deque([(0.0, 0.0)] * flight.delay_ticks)
    for tick, (q_cmd, q_ref) in enumerate(commands):
        health, following = following, health_at(tick + 1)
        truth = sense(health)
        measurement = read(tick, truth)

        if axes is not None:
            lateral = axes.sense(tick, health)
            turning = lateral.measurement
            estimates = tuple([estimate for tell in tellers for estimate in tell(measurement, turning)])
        else:
            estimates = (only(measurement),) if only else tuple([update(measurement) for update in updates])

        if redesign is not None:
            redesign.update(estimates)
        if oracle:  # told by the scenario; no estimator is
            believed = believed_of(health.effectiveness)
        elif estimates:
            estimate = estimates[which]
            if corrected and not isfinite(estimate.effectiveness_smoothed) and isfinite(measurement.q_rad_s):
                raise not_a_number(which, estimate.effectiveness_smoothed, tick)
            believed = believed_of(estimate.effectiveness_smoothed, estimate.effectiveness_std)
        feedback = feedback_of(measurement.elevator_rad, believed)
        reference = reference_of(q_ref, believed)
        felt = measurement
        if state_from is not None:
            felt = measurement._replace(
                alpha_rad=estimates[state_from].alpha_rad, q_rad_s=estimates[state_from].q_rad_s
            )
        demand = demand_of(felt, q_ref_rad_s=reference, elevator_rad=feedback, hold=hold)
        command = command_of(demand, believed)
        hold = command != demand / believed
        for listen in listeners:
            listen(command)

        if axes is not None and lateral is not None:
            lateral = axes.decide(lateral, estimates, tick)

        pulled = None if pulling is None else pulling.told
        yield _new(Sample, (tick, q_cmd, q_ref, truth, measurement, estimates, command, lateral, pulled))
        deviation = truth.alpha_rad - alpha_trim
        if not abs(deviation) <= DEPARTURE_RAD or not isfinite(truth.q_rad_s) or truth.altitude_m < floor:
            return
        if axes is not None and lateral is not None:
            if not abs(lateral.truth.beta_rad) <= DEPARTURE_RAD:
                return
            steering.append((lateral.aileron_cmd_rad, lateral.rudder_cmd_rad))
            axes.plant.steer(*steering.popleft())
        if pulling is not None:
            pulling.power()
        if delay:
            on_the_way.append(command)
            command = on_the_way.popleft()
        advance(command, health, following)
