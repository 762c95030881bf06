"""Traces of many flights -> one number per flight, and the counts of the tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from flightbed.analysis.metrics import BAND, SETTLING_S
from flightbed.analysis.seeds import Flown
from flightbed.analysis.trace import true_share
from flightbed.studies.estimators.comparison import CORRECTED, COST, TOGETHER, Comparison, Key, Unfit
from flightbed.studies.estimators.comparison import HEALTHY as WITHOUT_FAILURE
from flightbed.studies.estimators.entrants import CHANGED, FIXED, HEALTHY, TRUE_K, UNDECLARED, Entrant
from flightbed.studies.estimators.flights import Flight

Vector = npt.NDArray[np.float64]
Values = list[float | None]  # one per flight, in the order of the seeds; infinite: never; None: the flight ended before

SETTLED_S = 1.0  # from the failure; errors of K count from then on


@dataclass(frozen=True)
class Estimates:
    """Estimates of one estimator in one flight of the set, one value per run.

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
    """Flights that one estimator corrected: RMS of q - q_ref, deg/s, and time of departure, s (None: no departure)."""

    tracking_deg_s: Values
    lost_s: Values


@dataclass(frozen=True)
class Healthy:
    """Flights without a failure: number, flight time, and number of flights with an alarm of each estimator that has a test."""

    runs: int
    hours: float
    alarmed: Mapping[str, int]


@dataclass(frozen=True)
class Results:
    """Measured values of all flights.

    Attributes:
        runs: of each flight, with seeds 0, 1, ...
        flights, entrants: the set.
        cost_us: estimator -> processor time of an update, us, one value per round; empty if none was taken.
        estimates: (flight, estimator) -> errors, delays, alarms.
        corrected: (flight, estimator, ``TRUE_K``, ``FIXED`` or ``HEALTHY``) -> tracking and losses.
        healthy: name of a flight without its failure -> alarms.
        steady: flights in which K stays 1.
        unfit: (flight, estimator) -> the error that refuses it there.

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
        """Return the estimators that have a test."""
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
    """Return errors, delays and alarms of one of the estimators of some flights; ``tests``: whether it has a test."""
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
    """Return tracking and losses; a flight that departed has no tracking error."""
    metrics = [flight.metrics for flight in flown]
    tracking = [None if m.departed else m.tracking_rms_post_deg_s for m in metrics]
    return Corrected(tracking, [m.departed_at_s for m in metrics])


def measured(compared: Comparison, runs: int, unfit: Unfit, found: Mapping[Key, Sequence[Any]]) -> Results:
    """Return the measured values of all flights.

    Args:
        compared: estimators and flights.
        runs: flights of each kind.
        unfit: (flight, estimator) -> the error that refuses it there.
        found: key of each of ``compared.jobs`` -> its flights, or the results of its trials.

    """
    compared = replace(compared, entrants=tuple(_declared(e, found) for e in compared.entrants))
    estimates: dict[tuple[str, str], Estimates] = {}
    flew: dict[tuple[str, str], Corrected] = {}
    healthy: dict[str, Healthy] = {}
    steady = set()
    for flight in compared.flights:
        fit = compared.fit(flight, unfit)
        shared, twins = found[TOGETHER, flight.name], found[WITHOUT_FAILURE, flight.without]
        if all(np.all(flown.columns[true_share("")] == 1.0) for flown in shared):
            steady.add(flight.name)
        for entrant in fit:
            estimates[flight.name, entrant.name] = estimated(shared, entrant.name, tests=bool(entrant.alarm))
        flew[flight.name, TRUE_K] = corrected(shared)
        for name in (FIXED, *(e.name for e in fit)):
            flew[flight.name, name] = corrected(found[CORRECTED, flight.name, name])
        if flight.without not in healthy:
            healthy[flight.without] = _without_failure(twins, [e.name for e in compared.tested(flight, unfit)])
        flew[flight.name, HEALTHY] = _undisturbed(twins, compared.course.failed_at_s(flight) + SETTLING_S)
    rounds: Sequence[Mapping[str, float]] = found.get((COST,), ())
    cost_us = {e.name: [one[e.name] for one in rounds if e.name in one] for e in compared.entrants}
    return Results(
        runs, compared.flights, compared.entrants, {name: us for name, us in cost_us.items() if us},
        estimates, flew, healthy, frozenset(steady), unfit,
    )  # fmt: skip


def _declared(entrant: Entrant, found: Mapping[Key, Sequence[Any]]) -> Entrant:
    """Return an estimator of which flights showed whether it has a test: it raised an alarm in one of them, or in none."""
    if entrant.alarm != UNDECLARED:
        return entrant
    flights = [flown for key, each in found.items() if key[0] in (TOGETHER, WITHOUT_FAILURE) for flown in each]
    metrics = [flown.metrics.estimators[entrant.name] for flown in flights if entrant.name in flown.metrics.estimators]
    raised = any(m.false_alarms > 0 or m.detected_at_s is not None for m in metrics)
    return replace(entrant, alarm=CHANGED if raised else "")


def _without_failure(flown: Sequence[Flown], tested: Sequence[str]) -> Healthy:
    """Count alarms. Raises ValueError if a flight departed."""
    if any(flight.metrics.departed for flight in flown):
        raise ValueError("a flight without a failure departed")
    alarmed = {name: sum(flight.metrics.estimators[name].false_alarms > 0 for flight in flown) for name in tested}
    return Healthy(len(flown), sum(float(flight.columns["t_s"][-1]) for flight in flown) / 3600.0, alarmed)


def _undisturbed(flown: Sequence[Flown], since_s: float) -> Corrected:
    """Return tracking of flights without a failure, over the time that counts in those with it."""
    errors = [flight.columns["q_deg_s"] - flight.columns["q_ref_deg_s"] for flight in flown]
    tracking = [rms_after(flight.columns["t_s"], error, since_s) for flight, error in zip(flown, errors, strict=True)]
    return Corrected(tracking, [flight.metrics.departed_at_s for flight in flown])
