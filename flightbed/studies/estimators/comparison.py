"""Which estimators are compared in which flights, and the jobs that fly them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from flightbed.analysis.seeds import Job
from flightbed.analysis.trace import true_share
from flightbed.scenario.own_code import named_extensions
from flightbed.studies.base import Trials
from flightbed.studies.estimators.cost import round_us
from flightbed.studies.estimators.entrants import ENTRANTS, FIXED, Entrant
from flightbed.studies.estimators.flights import FLIGHTS, Course, Flight

Key = tuple[str, ...]
Unfit = Mapping[tuple[str, str], str]  # (flight, estimator) -> the error that refuses it there

TOGETHER, CORRECTED, HEALTHY, COST = "together", "corrected", "healthy", "cost"
TRACKING = ("t_s", "q_deg_s", "q_ref_deg_s")
ROUNDS = 9


@dataclass(frozen=True)
class Comparison:
    """Estimators and flights.

    Attributes:
        entrants: the estimators, in the order of the tables.
        flights: the flights, in the order of the tables; times of updates are taken with the readings of the first.
        course: makes their scenarios.
        rounds: in which the time of an update is taken, the only figures that are not the same in every run; 0 takes none.

    """

    entrants: tuple[Entrant, ...] = ENTRANTS
    flights: tuple[Flight, ...] = FLIGHTS
    course: Course = field(default_factory=Course)
    rounds: int = ROUNDS

    def unfit(self) -> dict[tuple[str, str], str]:
        """Return (flight, estimator) -> the error that refuses the estimator there."""
        refused = {(f.name, e.name): self.course.why_not(f, e) for f in self.flights for e in self.entrants}
        return {pair: why for pair, why in refused.items() if why is not None}

    def fit(self, flight: Flight, unfit: Unfit) -> list[Entrant]:
        """Return the estimators that can fly in a flight."""
        return [e for e in self.entrants if (flight.name, e.name) not in unfit]

    def tested(self, flight: Flight, unfit: Unfit) -> list[Entrant]:
        """Return those of them that have a test, or may have one."""
        return [e for e in self.fit(flight, unfit) if e.alarm]

    def jobs(self, runs: int, unfit: Unfit) -> dict[Key, Job | Trials]:
        """Return all that is flown: per flight with all estimators in parallel, with each one correcting the law, with none; no failure.

        Args:
            runs: flights of each kind, seeds 0, 1, ...
            unfit: as ``unfit()`` returns it.

        """
        jobs: dict[Key, Job | Trials] = {}
        for flight in self.flights:
            fit = self.fit(flight, unfit)
            jobs[TOGETHER, flight.name] = Job(self.course.together(flight, fit), runs, _kept(fit))
            jobs[CORRECTED, flight.name, FIXED] = Job(self.course.corrected(flight, FIXED), runs)
            for entrant in fit:
                jobs[CORRECTED, flight.name, entrant.name] = Job(self.course.corrected(flight, entrant), runs)
            if (HEALTHY, flight.without) not in jobs:  # flown with estimators that raise alarms alone
                healthy = self.course.healthy(flight, self.tested(flight, unfit))
                jobs[HEALTHY, flight.without] = Job(healthy, runs, TRACKING)
        if self.rounds:
            timed = self.course.together(self.flights[0], self.fit(self.flights[0], unfit))
            jobs[(COST,)] = Trials(round_us, (timed, named_extensions(timed)), self.rounds)
        return jobs


def _kept(entrants: Sequence[Entrant]) -> tuple[str, ...]:
    estimates = (f"{e.name}.{c}" for e in entrants for c in ("effectiveness", "effectiveness_smoothed"))
    return ("t_s", true_share(""), *estimates)
