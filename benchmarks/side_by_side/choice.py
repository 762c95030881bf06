"""Which estimator to choose: sentences that follow from the results, and say from which figures."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import inf, nan
from statistics import median

from flightbed.document import Table
from flightbed.statistics import Interval, median_interval

from .entrants import CHANGED, FIXED, TOLD, UNEXPLAINED
from .flights import Flight
from .measures import Results, Values
from .tables import DASH, centre, changing, lost, lost_of_all, middle, survivable, worst


def not_worse(values: Mapping[str, Values]) -> tuple[str, ...]:
    """Return the name with the least median first, then those that are not worse by 95 % confidence, flight by flight.

    Of each other's difference from the first, on the same seeds, the median has an exact interval (``statistics.median_interval``): one
    that holds 0 or less is not worse. Nobody whose value never happens in half of the flights is named.
    """
    able = {name: centre(v) for name, v in values.items() if centre(v) < inf}
    if not able:
        return ()
    first = min(able, key=lambda name: able[name])
    others = [name for name in able if name != first and _apart(values[name], values[first]).low <= 0.0]
    return (first, *sorted(others, key=lambda name: able[name]))


def _apart(values: Values, others: Values) -> Interval:
    """Return the median of the differences, flight by flight, with its interval; infinite both ways if there are none."""
    pairs = [(a, b) for a, b in zip(values, others, strict=True) if a is not None and b is not None]
    if not pairs:
        return Interval(nan, -inf, inf, 0)
    return median_interval([0.0 if a == b else a - b for a, b in pairs])  # inf - inf: neither happened


def by_flight(results: Results) -> Table:
    """Return who is best in each flight: least error of K, earliest alarm, best tracking of those that lose fewest aircraft."""
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
    return Table("choice", "Who is best in which flight", head, rows)


def _of(
    results: Results, flight: Flight, what: Callable[..., Values | None], alarm: str | None = None
) -> dict[str, Values]:
    wanted = [e.name for e in results.entrants if alarm in (None, e.alarm)]
    found = {name: results.estimates.get((flight.name, name)) for name in wanted}
    told = {name: what(one) for name, one in found.items() if one is not None}
    return {name: values for name, values in told.items() if values is not None}


def _named(values: Mapping[str, Values], spec: str) -> str:
    names = not_worse(values)
    if not names:
        return DASH
    first = f"{names[0]} {middle(values[names[0]], spec)}"
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
    """Return what follows, a sentence each, with the figures that it follows from."""
    return [
        _one_for_all(results),
        _cheap(results),
        *_quiet(results),
        _saved(results),
        *_blind(results),
        *_lucky(results),
    ]


def _one_for_all(results: Results) -> str:
    largest = {e.name: worst(results, e.name) for e in results.entrants}
    order = sorted(largest, key=lambda name: largest[name])
    told = ", ".join(f"{name} {largest[name][0]:.3f} ({largest[name][1]})" for name in order)
    others = []
    for flight in changing(results) if len(changing(results)) > 1 else ():
        less = {e.name: worst(results, e.name, without=flight.name)[0] for e in results.entrants}
        first = min(less, key=lambda name: less[name])
        if first != order[0]:
            others.append(f"without {flight.name} {first}, {less[first]:.3f}")
    depends = f" It hangs on the set of flights: {'; '.join(others)}." if others else ""
    return (
        f"One for all flights in which K changes: **{order[0]}**, whose error is smallest where it is largest. "
        f"Largest median RMS errors: {told}.{depends}"
    )


def _saved(results: Results) -> str:
    names = [e.name for e in results.entrants]
    told = ", ".join(f"{name} {'{} of {}'.format(*lost_of_all(results, name))}" for name in names)
    flights = ", ".join(f.name for f in survivable(results))
    return f"Aircraft lost over the flights that a law which is told K survives without a loss ({flights}): {told}."


def _quiet(results: Results) -> list[str]:
    """Say who raises no alarm without a failure, which losses of K are missed, and which alarms are about something else."""
    total = sum(flown.runs for flown in results.healthy.values())
    tested = [e.name for e in results.entrants if e.name in results.tested]
    if not tested:
        return []
    counts = {name: sum(flown.alarmed.get(name, 0) for flown in results.healthy.values()) for name in tested}
    quietest = ", ".join(f"**{name}**" for name, count in counts.items() if count == min(counts.values()))
    told = ", ".join(f"{name} {count}" for name, count in counts.items())
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
        f"Where an alarm must not come without a failure: {quietest}. Healthy flights with an alarm, of {total}: {told}.",
        f"No alarm although K changes: {_listed(results, [one for one in missed if one[2]])}. "
        f"An alarm that K has changed although it stays: {_listed(results, wrong)}.",
        f"An alarm that no K explains what acts: {_listed(results, other)}.",
    ]


def _raised(results: Results) -> list[tuple[str, str, int]]:
    """Return flight, estimator with a test, and in how many flights it raised an alarm after the failure."""
    return [
        (flight, name, sum(at is not None and at < inf for at in found.alarm_s))
        for (flight, name), found in results.estimates.items()
        if found.alarm_s is not None
    ]


def _listed(results: Results, found: list[tuple[str, str, int]]) -> str:
    return ", ".join(f"{name} in {count} of {results.runs} ({flight})" for flight, name, count in found) or "nowhere"


def _cheap(results: Results) -> str:
    """Name those of which no other is both cheaper and more accurate."""
    found = {e.name: (median(results.cost_us[e.name]), worst(results, e.name)[0]) for e in results.entrants}
    beaten = {
        a
        for a in found
        for b in found
        if found[b] != found[a] and all(x <= y for x, y in zip(found[b], found[a], strict=True))
    }
    told = ", ".join(
        f"**{name}** {us:.1f} us, {error:.3f}"
        for name, (us, error) in sorted(found.items(), key=lambda item: item[1])
        if name not in beaten
    )
    return (
        f"Where time on board is short: no estimator has both a cheaper update and a smaller largest error than {told}."
    )


def _blind(results: Results) -> list[str]:
    """Say in which of the flights nobody knows K to a tenth, and in which nobody saves the aircraft."""
    least = {
        f.name: min((centre(v) for v in _of(results, f, lambda e: e.rms).values()), default=inf)
        for f in results.flights
    }
    wrong = [f"{name} ({error:.2f})" for name, error in least.items() if error > 0.1]
    doomed = [f.name for f in results.flights if lost(results.corrected[f.name, TOLD]) == results.runs]
    said = []
    if wrong:
        said.append(
            f"None of them where the least median error of K exceeds 0.1: {', '.join(wrong)}; what happens there is not in their models."
        )
    if doomed:
        said.append(
            f"None of them, for another reason, in {', '.join(doomed)}: the aircraft is lost even if the law is told K."
        )
    return said


def _lucky(results: Results) -> list[str]:
    """Say where good tracking is no sign of a good estimate: with 95 % confidence somebody tracks better than a law that is told K."""
    told = []
    for flight in survivable(results):
        best = results.corrected[flight.name, TOLD].tracking_deg_s
        flown = {
            name: results.corrected.get((flight.name, name)) for name in (FIXED, *(e.name for e in results.entrants))
        }
        whole = {name: one.tracking_deg_s for name, one in flown.items() if one is not None and not lost(one)}
        better = [name for name, values in whole.items() if _apart(values, best).high < 0.0]
        if better:
            told.append(f"{flight.name} ({', '.join(better)})")
    if not told:
        return []
    return [
        f"Tracking is no sign of a good estimate in {'; '.join(told)}: those track better than a law that is told K, "
        "which does what it does on a healthy aircraft and no more."
    ]
