"""Fly the set: from the traces of many flights to a number a flight, and to the counts that the tables show."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from flightbed.ensemble import Flown, Job, fly_jobs
from flightbed.metrics import BAND, SETTLING_S
from flightbed.trace import true_share

from .entrants import FIXED, HEALTHY, TOLD, Entrant
from .flights import Course, Flight

Vector = npt.NDArray[np.float64]
Values = list[
    float | None
]  # one a flight, in the order of the seeds; infinite: never; None: the flight was over before

_TRACKING = ("t_s", "q_deg_s", "q_ref_deg_s")
SETTLED_S = 1.0  # from the failure; errors of K count from then on


@dataclass(frozen=True)
class Estimates:
    """What one estimator made of one flight of the set, a value each time that it was flown.

    Attributes:
        rms: RMS of K-hat - K from ``SETTLED_S`` after the failure.
        final: abs(K-hat - K) at the last tick.
        settled_s: time from the failure after which the smoothed K-hat stays within ``metrics.BAND`` of K.
        alarm_s: time from the failure to the first alarm; None in place of the list for an estimator without a test.

    """

    rms: Values
    final: Values
    settled_s: Values
    alarm_s: Values | None


@dataclass(frozen=True)
class Corrected:
    """How flights went that an estimator corrected: RMS of q - q_ref, deg/s, and when they departed (None: did not)."""

    tracking_deg_s: Values
    lost_s: Values


@dataclass(frozen=True)
class Healthy:
    """Flights without a failure: their number, flight time, and in how many of them each estimator with a test raised an alarm."""

    runs: int
    hours: float
    alarmed: Mapping[str, int]


@dataclass(frozen=True)
class Results:
    """All that was flown.

    Attributes:
        runs: of each flight, with seeds 0, 1, ...
        flights, entrants: the set.
        cost_us: of each estimator what an update takes, one value a round.
        estimates: (flight, estimator) -> how well it estimated.
        corrected: (flight, estimator, ``TOLD``, ``FIXED`` or ``HEALTHY``) -> how well the aircraft flew.
        healthy: name of a flight without its failure -> what was flown of it.
        steady: flights in which K stays 1.
        unfit: (flight, estimator) -> why it cannot serve there.

    """

    runs: int
    flights: tuple[Flight, ...]
    entrants: tuple[Entrant, ...]
    cost_us: Mapping[str, Sequence[float]]
    estimates: Mapping[tuple[str, str], Estimates]
    corrected: Mapping[tuple[str, str], Corrected]
    healthy: Mapping[str, Healthy]
    steady: frozenset[str]
    unfit: Mapping[tuple[str, str], str]

    @property
    def tested(self) -> frozenset[str]:
        """Return the estimators that raise alarms."""
        return frozenset(name for (_, name), found in self.estimates.items() if found.alarm_s is not None)


def rms_after(t_s: Vector, error: Vector, since_s: float) -> float | None:
    """Return the RMS of an error, (n,), from a time on; None if the flight was over before."""
    counted = error[t_s >= since_s - 1e-9]
    return float(np.sqrt(np.mean(counted**2))) if counted.size else None


def settled_after(t_s: Vector, error: Vector, band: Vector, since_s: float) -> float:
    """Return the time, counted from ``since_s``, after which abs(error) stays within the band, all (n,); infinite if it ends outside."""
    counted = t_s >= since_s - 1e-9
    t, outside = t_s[counted], np.flatnonzero(np.abs(error[counted]) > band[counted])
    if not outside.size:
        return 0.0
    return float(t[outside[-1] + 1] - since_s) if outside[-1] + 1 < t.size else float("inf")


def estimated(flown: Sequence[Flown], name: str, *, tests: bool) -> Estimates:
    """Return what one of the estimators of some flights made of them."""
    rms: Values = []
    final: Values = []
    settled: Values = []
    alarms: Values = []
    for flight in flown:
        t, K, since = flight.columns["t_s"], flight.columns[true_share(name)], flight.metrics.estimators_since_s
        if since is None:
            raise ValueError("a flight of the set must have a failure")
        error = flight.columns[f"{name}.effectiveness"] - K
        rms.append(rms_after(t, error, since + SETTLED_S))
        final.append(abs(float(error[-1])))
        settled.append(settled_after(t, flight.columns[f"{name}.effectiveness_smoothed"] - K, BAND * K, since))
        alarm = flight.metrics.estimators[name].detected_at_s
        alarms.append(float("inf") if alarm is None else alarm)
    return Estimates(rms, final, settled, alarms if tests else None)


def corrected(flown: Sequence[Flown]) -> Corrected:
    """Return how the flights went; what was lost has no tracking error."""
    metrics = [flight.metrics for flight in flown]
    tracking = [None if m.departed else m.tracking_rms_post_deg_s for m in metrics]
    return Corrected(tracking, [m.departed_at_s for m in metrics])


def fly_set(
    flights: Sequence[Flight],
    entrants: Sequence[Entrant],
    cost_us: Mapping[str, Sequence[float]],
    *,
    runs: int,
    course: Course | None = None,
    executor: Executor | None = None,
    say: Callable[[str], object] = lambda _: None,
) -> Results:
    """Fly all flights: with all estimators in parallel, with each of them correcting the law, with none, and without the failure."""
    course = course or Course()
    estimates: dict[tuple[str, str], Estimates] = {}
    flew: dict[tuple[str, str], Corrected] = {}
    healthy: dict[str, Healthy] = {}
    unfit: dict[tuple[str, str], str] = {}
    steady = set()
    twins: dict[str, list[Flown]] = {}
    for flight in flights:
        refused = {e.name: course.why_not(flight, e) for e in entrants}
        unfit |= {(flight.name, name): why for name, why in refused.items() if why is not None}
        fit = [e for e in entrants if refused[e.name] is None]
        together = course.together(flight, fit)
        tested = [e for e in fit if e.alarm]
        kept = (
            "t_s",
            true_share(""),
            *(f"{e.name}.{c}" for e in fit for c in ("effectiveness", "effectiveness_smoothed")),
        )
        jobs = [Job(together, runs, kept), Job(course.corrected(flight, FIXED), runs)]
        jobs += [Job(course.corrected(flight, e), runs) for e in fit]
        new = flight.without not in twins
        jobs += [Job(course.healthy(flight, tested), runs, _TRACKING)] if new else []
        shared, fixed, *others = fly_jobs(jobs, executor=executor)
        if all(np.all(flown.columns[true_share("")] == 1.0) for flown in shared):
            steady.add(flight.name)
        for entrant in fit:
            estimates[flight.name, entrant.name] = estimated(shared, entrant.name, tests=entrant in tested)
        flew[flight.name, TOLD], flew[flight.name, FIXED] = corrected(shared), corrected(fixed)
        flew |= {(flight.name, e.name): corrected(flown) for e, flown in zip(fit, others[: len(fit)], strict=True)}
        if new:  # flown with those that raise alarms alone: of the others it tells nothing
            twins[flight.without] = others[-1]
            healthy[flight.without] = _without_failure(others[-1], [e.name for e in tested])
        flew[flight.name, HEALTHY] = _undisturbed(
            twins[flight.without], min(f.at_s for f in together.failures) + SETTLING_S
        )
        say(f"{flight.name}: {runs * len(jobs)} flights")
    return Results(
        runs, tuple(flights), tuple(entrants), cost_us, estimates, flew, healthy, frozenset(steady), unfit
    )  # fmt: skip


def _without_failure(flown: Sequence[Flown], tested: Sequence[str]) -> Healthy:
    """Count alarms; such a flight that departs would be no flight without a failure."""
    if any(flight.metrics.departed for flight in flown):
        raise ValueError("a flight without a failure departed")
    alarmed = {name: sum(flight.metrics.estimators[name].false_alarms > 0 for flight in flown) for name in tested}
    return Healthy(len(flown), sum(float(flight.columns["t_s"][-1]) for flight in flown) / 3600.0, alarmed)


def _undisturbed(flown: Sequence[Flown], since_s: float) -> Corrected:
    """Return how well flights without a failure track, over the time that counts in those with it."""
    errors = [flight.columns["q_deg_s"] - flight.columns["q_ref_deg_s"] for flight in flown]
    tracking = [rms_after(flight.columns["t_s"], error, since_s) for flight, error in zip(flown, errors, strict=True)]
    return Corrected(tracking, [flight.metrics.departed_at_s for flight in flown])
