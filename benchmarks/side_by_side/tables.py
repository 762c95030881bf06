"""Results -> tables: a table a flight, false alarms, what is assumed, and the short one."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf
from statistics import median

from measuring import spread

from flightbed.document import Table, show
from flightbed.metrics import SETTLING_S
from flightbed.statistics import Interval, median_interval, share

from .entrants import CHANGED, FIXED, HEALTHY, TOLD, UNEXPLAINED, Entrant
from .flights import Flight
from .measures import SETTLED_S, Corrected, Estimates, Results, Values

DASH = "-"
_HEAD = (
    "estimator",
    "RMS error of K",
    "final error of K",
    "within 20 % to stay, s",
    "alarm after, s",
    "tracking, deg/s",
    "lost",
)


def middle(values: Values, spec: str) -> str:
    """Return the median of the values that there are with its 95 % interval, and in how many it never happened."""
    had = [v for v in values if v is not None]
    if not had:
        return DASH
    never = sum(v == inf for v in had)
    if never == len(had):
        return "never"
    told = show(median_interval(had), spec) if never * 2 < len(had) else ""
    return ", ".join(filter(None, [told, f"never in {never} of {len(had)}" if never else ""]))


def percent(successes: int, runs: int) -> str:
    """Return a share with its exact 95 % interval, %."""
    found = share(successes, runs)
    return show(Interval(*(100.0 * v for v in (found.estimate, found.low, found.high)), runs), ".1f")


def lost(flown: Corrected) -> int:
    """Return how many departed."""
    return sum(at is not None for at in flown.lost_s)


def assumed(results: Results) -> Table:
    """Return what each estimator takes for granted, and what it costs."""
    rows = [
        [
            e.name,
            _settings(e),
            e.known,
            e.unknown,
            e.noise,
            e.alarm or "nothing",
            spread(results.cost_us[e.name], ".2f"),
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
    """Return what the flights are."""
    rows = [[f.name, f"`{f.scenario}`{_also(f)}", f.what, f.without] for f in results.flights]
    return Table("flights", "The flights", ("flight", "scenario", "what happens", "without its failure"), rows)


def _also(flight: Flight) -> str:
    return "".join(f", `{override}`" for override in flight.overrides)


def one_flight(results: Results, flight: Flight) -> Table:
    """Return one flight of the set, a row an estimator, and rows of aircraft that no estimator corrects."""
    rows = [
        [e.name, *_estimated(results, flight, e.name), *_corrected(results, flight, e.name)] for e in results.entrants
    ]
    rows += [[name, *[DASH] * 4, *_corrected(results, flight, name)] for name in (TOLD, FIXED, HEALTHY)]
    refused = [f"{name}: {why}" for (where, name), why in results.unfit.items() if where == flight.name]
    steady = (
        f"K stays 1 here: an alarm that says '{CHANGED}' is wrong, and one that says '{UNEXPLAINED}' is not."
        if flight.name in results.steady
        else f"An alarm that says '{UNEXPLAINED}' need not come here."
    )
    return Table(
        flight.name, f"{flight.name}: {flight.what}", _HEAD, rows, note=" ".join(filter(None, [steady, *refused]))
    )


def _estimated(results: Results, flight: Flight, name: str) -> list[str]:
    found: Estimates | None = results.estimates.get((flight.name, name))
    if found is None:
        return [DASH] * 4
    alarm = DASH if found.alarm_s is None else middle(found.alarm_s, ".2f")
    return [middle(found.rms, ".4f"), middle(found.final, ".4f"), middle(found.settled_s, ".2f"), alarm]


def _corrected(results: Results, flight: Flight, name: str) -> list[str]:
    flown = results.corrected.get((flight.name, name))
    if flown is None:
        return [DASH] * 2
    return [middle(flown.tracking_deg_s, ".3f"), percent(lost(flown), results.runs) + " %"]


def false_alarms(results: Results) -> Table:
    """Return in which share of flights without a failure each estimator raised an alarm."""
    rows = []
    for entrant in results.entrants:
        counts = [(flown.alarmed.get(entrant.name), flown.runs) for flown in results.healthy.values()]
        rows.append([entrant.name, *(DASH if n is None else percent(n, runs) + " %" for n, runs in counts)])
    hours = ", ".join(f"{flown.hours:.2f} h of {name}" for name, flown in results.healthy.items())
    note = f"Flown: {hours}."
    return Table(
        "alarms", "Flights without a failure that had an alarm", ("estimator", *results.healthy), rows, note=note
    )


def survivable(results: Results) -> tuple[Flight, ...]:
    """Return the flights of which none is lost if the law is told K: what an estimate of K can save."""
    return tuple(f for f in results.flights if lost(results.corrected[f.name, TOLD]) == 0)


def lost_of_all(results: Results, name: str) -> tuple[int, int]:
    """Return how many aircraft were lost that an estimator corrected, of how many, over the flights that the true K survives."""
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
    """Return the largest median RMS error over the flights in which K changes, and where; infinite where it cannot serve."""
    found = [(results.estimates.get((f.name, name)), f.name) for f in changing(results) if f.name != without]
    return max((inf if one is None else centre(one.rms), where) for one, where in found)


def short(results: Results) -> Table:
    """Return a row an estimator: cost, error and alarm in the first flight, its largest error, false alarms, lost aircraft."""
    first = results.flights[0].name
    healthy = results.healthy.values()
    rows = []
    for entrant in results.entrants:
        found = results.estimates.get((first, entrant.name))
        told = [flown.alarmed[entrant.name] for flown in healthy if entrant.name in flown.alarmed]
        error, where = worst(results, entrant.name)
        rows.append([
            entrant.name,
            f"{median(results.cost_us[entrant.name]):.1f}",
            DASH if found is None else middle(found.rms, ".4f"),
            DASH if error == inf else f"{error:.3f} ({where})",
            DASH if found is None or found.alarm_s is None else middle(found.alarm_s, ".2f"),
            f"{sum(told)} of {sum(flown.runs for flown in healthy)}" if told else DASH,
            DASH if (first, entrant.name) not in results.corrected
            else middle(results.corrected[first, entrant.name].tracking_deg_s, ".3f"),
            "{} of {}".format(*lost_of_all(results, entrant.name)),
        ])  # fmt: skip
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
    return Table("short", "", head, rows)


def markdown(table: Table) -> str:
    """Return a table in Markdown: its title, its rows, its note."""
    lines = [table.columns, ["---"] * len(table.columns), *map(table.shown, table.rows)]
    rows = "\n".join(_row(line) for line in lines)
    title = f"**{table.title[0].upper()}{table.title[1:]}**\n\n" if table.title else ""
    return title + rows + (f"\n\n{table.note}" if table.note else "")


def _row(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def definitions(results: Results) -> str:
    """Return what all figures rest on: how many flights, and the times from which they count."""
    last = results.runs - 1
    return (
        f"{results.runs} flights of each kind, seeds 0 to {last}: sensor noise and turbulence differ, all else is the same. "
        f"Errors count from {SETTLED_S:g} s after the failure, tracking from {SETTLING_S:g} s."
    )
