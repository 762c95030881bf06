"""Choice of an estimator: sentences that follow from the results, each with its figures."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import inf, nan
from statistics import median

from flightbed.document.document import Table, show
from flightbed.statistics.intervals import Interval, median_interval
from flightbed.studies.estimators.entrants import CHANGED, FIXED, TRUE_K, UNEXPLAINED
from flightbed.studies.estimators.flights import Flight
from flightbed.studies.estimators.measures import Results, Values
from flightbed.studies.estimators.tables import (
    DASH,
    centre,
    changing,
    lost,
    lost_of_all,
    middle,
    survivable,
    worst,
)


def not_worse(values: Mapping[str, Values]) -> tuple[str, ...]:
    """Return the name with the least median first, then those that are not worse by 95 % confidence, flight by flight.

    The differences from the first are taken on the same seeds; an estimator is not worse if the exact interval of their median
    (``intervals.median_interval``) reaches 0 or less. Estimators with an infinite median are left out.
    """
    able = {name: centre(v) for name, v in values.items() if centre(v) < inf}
    if not able:
        return ()
    first = min(able, key=lambda name: able[name])
    others = [name for name in able if name != first and _apart(values[name], values[first]).low <= 0.0]
    return (first, *sorted(others, key=lambda name: able[name]))


def _apart(values: Values, others: Values) -> Interval:
    """Return the median of the differences, flight by flight, with its interval; from -inf to inf if there are none."""
    pairs = [(a, b) for a, b in zip(values, others, strict=True) if a is not None and b is not None]
    if not pairs:
        return Interval(nan, -inf, inf, 0)
    return median_interval([0.0 if a == b else a - b for a, b in pairs])  # inf - inf: neither happened


def by_flight(results: Results) -> Table:
    """Return the best estimators of each flight: least error of K, earliest alarm, best tracking of those that lose fewest aircraft."""
    rows = [
        [
            flight.name,
            _named(_of(results, flight, lambda e: e.rms), ".4f"),
            DASH
            if flight.name in results.steady
            else _named(_of(results, flight, lambda e: e.alarm_s, CHANGED), ".2f"),
            _flown(results, flight),
        ]
        for flight in results.flights
    ]
    head = ("flight", "least error of K", "earliest alarm, s", "best tracking of those that lose fewest, deg/s")
    return Table("choice", "Best estimators per flight", head, rows)


def _of(
    results: Results, flight: Flight, what: Callable[..., Values | None], alarm: str | None = None
) -> dict[str, Values]:
    wanted = [e.name for e in results.entrants if alarm in (None, e.alarm)]
    found = {name: results.estimates.get((flight.name, name)) for name in wanted}
    values = {name: what(one) for name, one in found.items() if one is not None}
    return {name: each for name, each in values.items() if each is not None}


def _named(values: Mapping[str, Values], spec: str) -> str:
    names = not_worse(values)
    if not names:
        return DASH
    first = f"{names[0]} {show(middle(values[names[0]], spec), spec)}"
    return first + (f"; not worse: {', '.join(names[1:])}" if names[1:] else "")


def fewest_lost(results: Results, flight: Flight) -> tuple[str, ...]:
    """Return the estimators that lose fewest aircraft in a flight; none if they all lose all."""
    counts = {
        e.name: lost(results.corrected[flight.name, e.name])
        for e in results.entrants
        if (flight.name, e.name) in results.corrected
    }
    fewest = min(counts.values(), default=results.runs)
    return tuple(name for name, count in counts.items() if count == fewest < results.runs)


def _flown(results: Results, flight: Flight) -> str:
    names = fewest_lost(results, flight)
    if not names:
        return "all lose all"
    return _named({name: results.corrected[flight.name, name].tracking_deg_s for name in names}, ".3f")


def reading(results: Results) -> list[str]:
    """Return the conclusions, one paragraph each, with their figures."""
    return [
        _one_for_all(results),
        *_cheap(results),
        *_quiet(results),
        _saved(results),
        *_blind(results),
        *_lucky(results),
    ]


def _one_for_all(results: Results) -> str:
    largest = {e.name: worst(results, e.name) for e in results.entrants}
    order = sorted(largest, key=lambda name: largest[name])
    errors = ", ".join(f"{name} {largest[name][0]:.3f} ({largest[name][1]})" for name in order)
    others = []
    for flight in changing(results) if len(changing(results)) > 1 else ():
        less = {e.name: worst(results, e.name, without=flight.name)[0] for e in results.entrants}
        first = min(less, key=lambda name: less[name])
        if first != order[0]:
            others.append(f"without {flight.name} {first}, {less[first]:.3f}")
    depends = f" It depends on the set of flights: {'; '.join(others)}." if others else ""
    return (
        f"Best for all flights in which K changes: {order[0]}, with the smallest of the largest errors. "
        f"Largest median RMS errors: {errors}.{depends}"
    )


def _saved(results: Results) -> str:
    names = [e.name for e in results.entrants]
    counts = ", ".join(f"{name} {'{} of {}'.format(*lost_of_all(results, name))}" for name in names)
    flights = ", ".join(f.name for f in survivable(results))
    return f"Aircraft lost over the flights without a loss under the true K ({flights}): {counts}."


def _quiet(results: Results) -> list[str]:
    """Return false alarms, missed losses of K, and alarms about something else."""
    total = sum(flown.runs for flown in results.healthy.values())
    tested = [e.name for e in results.entrants if e.name in results.tested]
    if not tested:
        return []
    counts = {name: sum(flown.alarmed.get(name, 0) for flown in results.healthy.values()) for name in tested}
    fewest = ", ".join(name for name, count in counts.items() if count == min(counts.values()))
    each = ", ".join(f"{name} {count}" for name, count in counts.items())
    changed, unexplained = ([e.name for e in results.entrants if e.alarm == about] for about in (CHANGED, UNEXPLAINED))
    raised = _raised(results)
    wrong = [(flight, name, n) for flight, name, n in raised if flight in results.steady and name in changed and n]
    missed = [
        (flight, name, results.runs - n)
        for flight, name, n in raised
        if flight not in results.steady and name in changed
    ]
    other = [(flight, name, n) for flight, name, n in raised if name in unexplained and n]
    return [
        f"Fewest alarms without a failure: {fewest}. Healthy flights with an alarm, of {total}: {each}.",
        f"No alarm although K changes: {_listed(results, [one for one in missed if one[2]])}. "
        f"Alarm '{CHANGED}' although K stays 1: {_listed(results, wrong)}.",
        f"Alarm '{UNEXPLAINED}': {_listed(results, other)}.",
    ]


def _raised(results: Results) -> list[tuple[str, str, int]]:
    """Return flight, estimator with a test, and in how many flights it raised an alarm after the failure."""
    return [
        (flight, name, sum(at is not None and at < inf for at in found.alarm_s))
        for (flight, name), found in results.estimates.items()
        if found.alarm_s is not None
    ]


def _listed(results: Results, found: list[tuple[str, str, int]]) -> str:
    return ", ".join(f"{name} in {count} of {results.runs} ({flight})" for flight, name, count in found) or "none"


def _cheap(results: Results) -> list[str]:
    """Name those of which no other is both cheaper and more accurate; nothing if no time was taken."""
    found = {name: (median(us), worst(results, name)[0]) for name, us in results.cost_us.items()}
    if not found:
        return []
    beaten = {
        a
        for a in found
        for b in found
        if found[b] != found[a] and all(x <= y for x, y in zip(found[b], found[a], strict=True))
    }
    best = ", ".join(
        f"{name} {us:.1f} us, {error:.3f}"
        for name, (us, error) in sorted(found.items(), key=lambda item: item[1])
        if name not in beaten
    )
    return [
        f"Where time on board is short: no estimator has both a cheaper update and a smaller largest error than {best}."
    ]


def _blind(results: Results) -> list[str]:
    """Name the flights in which no estimator finds K to a tenth, and those that are lost with the true K."""
    least = {
        f.name: min((centre(v) for v in _of(results, f, lambda e: e.rms).values()), default=inf)
        for f in results.flights
    }
    wrong = [f"{name} ({error:.2f})" for name, error in least.items() if error > 0.1]
    doomed = [f.name for f in results.flights if lost(results.corrected[f.name, TRUE_K]) == results.runs]
    found = []
    if wrong:
        found.append(
            f"No estimator where the least median error of K exceeds 0.1: {', '.join(wrong)}; their models do not contain this failure."
        )
    if doomed:
        found.append(f"No estimator in {', '.join(doomed)}: the aircraft is lost with the true K, too.")
    return found


def _lucky(results: Results) -> list[str]:
    """Name the flights in which, with 95 % confidence, some law tracks better than the law with the true K."""
    found = []
    for flight in survivable(results):
        best = results.corrected[flight.name, TRUE_K].tracking_deg_s
        flown = {
            name: results.corrected.get((flight.name, name)) for name in (FIXED, *(e.name for e in results.entrants))
        }
        whole = {name: one.tracking_deg_s for name, one in flown.items() if one is not None and not lost(one)}
        better = [name for name, values in whole.items() if _apart(values, best).high < 0.0]
        if better:
            found.append(f"{flight.name} ({', '.join(better)})")
    if not found:
        return []
    return [
        f"Good tracking does not show a good estimate in {'; '.join(found)}: these track better than the law with the true K, "
        "which restores the response of the healthy aircraft and no more."
    ]
