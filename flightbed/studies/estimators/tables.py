"""Results -> tables: assumptions, flights, one table per flight, false alarms, and the short one."""

from __future__ import annotations

from math import inf
from statistics import median

from flightbed.analysis.metrics import SETTLING_S
from flightbed.core.timing import spread
from flightbed.document.document import Cell, Table, show
from flightbed.statistics.intervals import Interval, median_interval, share
from flightbed.studies.estimators.entrants import CHANGED, FIXED, HEALTHY, TRUE_K, UNEXPLAINED, Entrant
from flightbed.studies.estimators.flights import Flight
from flightbed.studies.estimators.measures import SETTLED_S, Corrected, Estimates, Results, Values

DASH = "-"
_HEAD = (
    "estimator",
    "RMS error of K",
    "final error of K",
    "within 20 % to stay, s",
    "alarm after, s",
    "tracking, deg/s",
    "lost, %",
)
_FORMATS = dict(zip(_HEAD[1:], (".4f", ".4f", ".2f", ".2f", ".3f", ".1f"), strict=True))


def middle(values: Values, spec: str) -> Cell:
    """Return the median with its 95 % interval; as text, with their number, if some flights never reached the event.

    Flights without a value (None) do not count.
    """
    had = [v for v in values if v is not None]
    if not had:
        return DASH
    never = sum(v == inf for v in had)
    if never == len(had):
        return "never"
    if not never:
        return median_interval(had)
    median_s = [show(median_interval(had), spec)] if never * 2 < len(had) else []
    return ", ".join([*median_s, f"never in {never} of {len(had)}"])


def percent(successes: int, runs: int) -> Interval:
    """Return a share with its exact 95 % interval, %."""
    found = share(successes, runs)
    return Interval(100.0 * found.estimate, 100.0 * found.low, 100.0 * found.high, runs)


def lost(flown: Corrected) -> int:
    """Return the number of flights that departed."""
    return sum(at is not None for at in flown.lost_s)


def assumed(results: Results) -> Table:
    """Return settings, assumptions and cost of each estimator."""
    rows = [
        [
            e.name,
            _settings(e),
            e.known,
            e.unknown,
            e.noise,
            e.alarm or "nothing",
            spread(results.cost_us[e.name], ".2f") if e.name in results.cost_us else DASH,
        ]
        for e in results.entrants
    ]
    head = ("estimator", "settings", "known", "unknown", "noise", "its alarms say", "an update, us")
    return Table("assumed", "What each assumes, and what it costs", head, rows)


def _settings(entrant: Entrant) -> str:
    return ", ".join(
        f"{key} {value}" if isinstance(value, int | float) else str(value) for key, value in entrant.settings.items()
    )


def courses(results: Results) -> Table:
    """Return scenario and events of each flight."""
    rows = [[f.name, ", ".join([f.scenario, *f.overrides]), f.what, f.without] for f in results.flights]
    return Table("flights", "The flights", ("flight", "scenario", "what happens", "without its failure"), rows)


def one_flight(results: Results, flight: Flight) -> Table:
    """Return one flight of the set: one row per estimator, and rows of flights that no estimator corrects."""
    rows = [
        [e.name, *_estimated(results, flight, e.name), *_corrected(results, flight, e.name)] for e in results.entrants
    ]
    rows += [[name, *[DASH] * 4, *_corrected(results, flight, name)] for name in (TRUE_K, FIXED, HEALTHY)]
    refused = [f"{name}: {why}" for (where, name), why in results.unfit.items() if where == flight.name]
    steady = (
        f"K stays 1 here: an alarm that says '{CHANGED}' is wrong, and one that says '{UNEXPLAINED}' is not."
        if flight.name in results.steady
        else f"An alarm that says '{UNEXPLAINED}' need not come here."
    )
    note = " ".join(filter(None, [steady, *refused]))
    return Table(flight.name, f"{flight.name}: {flight.what}", _HEAD, rows, _FORMATS, note)


def _estimated(results: Results, flight: Flight, name: str) -> list[Cell]:
    found: Estimates | None = results.estimates.get((flight.name, name))
    if found is None:
        return [DASH] * 4
    alarm = DASH if found.alarm_s is None else middle(found.alarm_s, ".2f")
    return [middle(found.rms, ".4f"), middle(found.final, ".4f"), middle(found.settled_s, ".2f"), alarm]


def _corrected(results: Results, flight: Flight, name: str) -> list[Cell]:
    flown = results.corrected.get((flight.name, name))
    if flown is None:
        return [DASH] * 2
    return [middle(flown.tracking_deg_s, ".3f"), percent(lost(flown), results.runs)]


def false_alarms(results: Results) -> Table:
    """Return the share of flights without a failure in which each estimator raised an alarm."""
    rows: list[list[Cell]] = []
    for entrant in results.entrants:
        counts = [(flown.alarmed.get(entrant.name), flown.runs) for flown in results.healthy.values()]
        rows.append([entrant.name, *(DASH if n is None else percent(n, runs) for n, runs in counts)])
    hours = ", ".join(f"{flown.hours:.2f} h of {name}" for name, flown in results.healthy.items())
    title = "Flights without a failure that had an alarm, %"
    formats = dict.fromkeys(results.healthy, ".1f")
    return Table("alarms", title, ("estimator", *results.healthy), rows, formats, f"Flown: {hours}.")


def survivable(results: Results) -> tuple[Flight, ...]:
    """Return the flights of which none is lost if the law uses the true K: those that an estimate of K can save."""
    return tuple(f for f in results.flights if lost(results.corrected[f.name, TRUE_K]) == 0)


def lost_of_all(results: Results, name: str) -> tuple[int, int]:
    """Return the number of aircraft that were lost with an estimator, and of their flights, over ``survivable`` flights."""
    flown = [results.corrected[f.name, name] for f in survivable(results) if (f.name, name) in results.corrected]
    return sum(map(lost, flown)), results.runs * len(flown)


def changing(results: Results) -> tuple[Flight, ...]:
    """Return the flights in which K changes."""
    return tuple(flight for flight in results.flights if flight.name not in results.steady)


def centre(values: Values) -> float:
    """Return the median; infinite if there is none."""
    had = [v for v in values if v is not None]
    return float(median(had)) if had else inf


def worst(results: Results, name: str, *, without: str = "") -> tuple[float, str]:
    """Return the largest median RMS error over the flights in which K changes, and its flight; infinite where it cannot fly."""
    found = [(results.estimates.get((f.name, name)), f.name) for f in changing(results) if f.name != without]
    return max((inf if one is None else centre(one.rms), where) for one, where in found)


def short(results: Results) -> Table:
    """Return one row per estimator: cost, error and alarm in the first flight, its largest error, false alarms, lost aircraft."""
    first = results.flights[0].name
    head = (
        "estimator",
        "an update, us",
        f"RMS error of K, {first}",
        "the largest, and where",
        f"alarm, {first}, s",
        "healthy flights with an alarm",
        f"tracking, {first}, deg/s",
        "aircraft lost",
    )
    formats = {head[1]: ".1f", head[2]: ".4f", head[4]: ".2f", head[6]: ".3f"}
    rows = [_in_short(results, first, entrant) for entrant in results.entrants]
    return Table("short", "At a glance", head, rows, formats, definitions(results.runs))


def _in_short(results: Results, first: str, entrant: Entrant) -> list[Cell]:
    name, healthy = entrant.name, results.healthy.values()
    found, flown = results.estimates.get((first, name)), results.corrected.get((first, name))
    alarmed = [flown.alarmed[name] for flown in healthy if name in flown.alarmed]
    error, where = worst(results, name)
    lost_in, of = lost_of_all(results, name)
    return [
        name,
        median(results.cost_us[name]) if name in results.cost_us else DASH,
        DASH if found is None else middle(found.rms, ".4f"),
        DASH if error == inf else f"{error:.3f} ({where})",
        DASH if found is None or found.alarm_s is None else middle(found.alarm_s, ".2f"),
        f"{sum(alarmed)} of {sum(flown.runs for flown in healthy)}" if alarmed else DASH,
        DASH if flown is None else middle(flown.tracking_deg_s, ".3f"),
        f"{lost_in} of {of}",
    ]


def definitions(runs: int) -> str:
    """Return number of flights and the times from which the figures count."""
    return (
        f"{runs} flights of each kind, seeds 0 to {runs - 1}: sensor noise and turbulence differ, all else is the same. "
        f"Errors count from {SETTLED_S:g} s after the failure, tracking from {SETTLING_S:g} s."
    )
