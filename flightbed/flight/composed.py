"""The flight computer composed of Python objects: sensors, estimators, correction and law of anyone's making."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import isfinite, nan

from flightbed.core.compiled import plain
from flightbed.core.errors import EstimateError
from flightbed.core.signals import Estimate, Health, LateralMeasurement, LateralSample, Measurement, Sample
from flightbed.estimation.base import Commanded, Estimator, SurfacesEstimator
from flightbed.flight.ending import FLIES, NAMES, Ended, ending
from flightbed.flight.parts import Flight

_new = tuple.__new__  # makes a named tuple without its constructor, which costs 1 % of a tick
_ending = plain(ending)

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


class Composed:
    """All work on board at a tick, by the objects of a flight; a ``loop.Computer``.

    Args:
        flight: assembled, at its start.

    Attributes:
        ended: end condition that holds at the latest tick; None while the flight flies.
        listeners: functions that take the elevator command that acts from a tick on, rad.

    """

    def __init__(self, flight: Flight) -> None:
        axes, estimators = flight.lateral, flight.estimators
        self._flight, self._axes, self._adaptation = flight, axes, flight.adaptation
        self._sense, self._read, self._demand = flight.plant.sense, flight.sensors.read, flight.law.demand
        self._updaters = [updater(estimator) for estimator in estimators] if axes is not None else []
        updates = [e.update for e in estimators if not isinstance(e, SurfacesEstimator)] if axes is None else []
        self._updates, self._only = updates, updates[0] if len(updates) == 1 else None
        self._q_cmd, self._q_ref = flight.profile.q_cmd_rad_s.tolist(), flight.profile.q_ref_rad_s.tolist()
        self._hold, self._effectiveness_used = False, 1.0
        self._sample: Sample
        self.listeners = [e.commanded for e in estimators if isinstance(e, Commanded)]
        self.ended: Ended | None = None

    def step(self, tick: int, health: Health) -> float:
        """Sense, estimate and decide at a tick; return the elevator command, rad, or nan if the flight ends here.

        Raises:
            EstimateError: the smoothed K of a correcting estimator is not finite.

        """
        flight, axes, adaptation = self._flight, self._axes, self._adaptation
        q_ref = self._q_ref[tick]
        truth = self._sense(health)
        measurement = self._read(tick, truth)
        lateral: LateralSample | None = None
        if axes is not None:
            lateral = axes.sense(tick, health)
            reading = lateral.measurement
            estimates = tuple([estimate for update in self._updaters for estimate in update(measurement, reading)])
        elif self._only is not None:
            estimates = (self._only(measurement),)
        else:
            estimates = tuple([update(measurement) for update in self._updates])

        if flight.redesign is not None:
            flight.redesign.update(estimates)
        if adaptation.oracle:  # the true K of the scenario; no estimator is used
            self._effectiveness_used = adaptation.effectiveness_used(health.effectiveness)
        elif estimates:
            estimate = estimates[adaptation.estimator]
            smoothed = estimate.effectiveness_smoothed
            if adaptation.enabled and not isfinite(smoothed) and isfinite(measurement.q_rad_s):
                raise invalid_estimate(adaptation.estimator, smoothed, tick / flight.control_hz)
            self._effectiveness_used = adaptation.effectiveness_used(smoothed, estimate.effectiveness_std)
        effectiveness_used = self._effectiveness_used
        law_input = measurement
        if flight.state_from is not None:
            state = estimates[flight.state_from]
            law_input = measurement._replace(alpha_rad=state.alpha_rad, q_rad_s=state.q_rad_s)
        demand = self._demand(
            law_input,
            q_ref_rad_s=adaptation.reference(q_ref, effectiveness_used),
            elevator_rad=adaptation.position_feedback(measurement.elevator_rad, effectiveness_used),
            hold=self._hold,
        )
        command = adaptation.command(demand, effectiveness_used)
        self._hold = command != demand / effectiveness_used
        if axes is not None and lateral is not None:
            lateral = axes.decide(lateral, estimates, tick)
        in_g = None if flight.load_factor is None else flight.load_factor.sample
        self._sample = _new(
            Sample, (tick, self._q_cmd[tick], q_ref, truth, measurement, estimates, command, lateral, in_g)
        )

        beta = 0.0 if lateral is None else lateral.truth.beta_rad
        found = _ending(truth.alpha_rad - flight.alpha_trim_rad, truth.q_rad_s, truth.altitude_m, flight.floor_m, beta)
        if found != FLIES:
            self.ended = NAMES[found]
            return nan
        return command

    def sample(self) -> Sample:
        """Return all signals of the latest tick."""
        return self._sample

    def replace(self, elevator_cmd_rad: float) -> None:
        """Take the command that replaces the law's at the latest tick; the law holds its integral at the next one."""
        self._hold, self._sample = True, self._sample._replace(elevator_cmd_rad=elevator_cmd_rad)

    def lateral_command(self) -> tuple[float, float]:
        """Return the commands to aileron and rudder of the latest tick, rad."""
        lateral = self._sample.lateral
        assert lateral is not None
        return lateral.aileron_cmd_rad, lateral.rudder_cmd_rad

    def throttle_norm(self) -> float:
        """Return the throttle command of the latest tick; nan keeps the throttle."""
        in_g = self._sample.load_factor
        return nan if in_g is None else in_g.throttle_norm
