"""The study: all estimators on the same flights, at the user's wish with estimators of the user's own."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from flightbed.document.document import Section
from flightbed.studies.base import Part, Study, keyed_part
from flightbed.studies.estimators.choice import by_flight, reading
from flightbed.studies.estimators.comparison import Comparison, Key
from flightbed.studies.estimators.measures import Results, measured
from flightbed.studies.estimators.own import own_entrants
from flightbed.studies.estimators.tables import assumed, courses, definitions, false_alarms, one_flight, short

RUNS = 20


def estimators() -> Study:
    """All estimators on the same flights: errors of K, alarms, tracking, losses, cost; with --use your own beside them."""
    return study(Comparison())


def study(compared: Comparison, *, options: str = "") -> Study:
    """Return the study of some estimators and flights.

    Args:
        compared: estimators and flights.
        options: of the command that reproduces it, for estimators of the user's own.

    """
    return Study(
        "estimators",
        "Estimators side by side",
        RUNS,
        partial(parts, compared=compared),
        options=options,
        with_own=partial(_with_own, compared),
    )


def _with_own(compared: Comparison, use: Sequence[str], settings: Sequence[Path]) -> Study:
    """Return the study with estimators of the user's own; see ``own.own_entrants`` for arguments and errors."""
    own = own_entrants(use, settings, compared)
    words = [word for name in use for word in ("--use", name)]
    words += [word for file in settings for word in ("--settings", str(file))]
    return study(replace(compared, entrants=(*compared.entrants, *own)), options=f" {shlex.join(words)}")


def parts(runs: int, compared: Comparison) -> Sequence[Part]:
    """Return all parts, in the order of the report; they share all flights.

    Args:
        runs: flights of each kind.
        compared: estimators and flights.

    """
    unfit = compared.unfit()
    jobs = compared.jobs(runs, unfit)

    def part(section: Callable[[Results], Section]) -> Part:
        def build(found: Mapping[Key, Sequence[Any]]) -> Section:
            return section(measured(compared, runs, unfit, found))

        return keyed_part(jobs, build)

    return [part(section) for section in SECTIONS]


def _glance(results: Results) -> Section:
    return Section("At a glance", (), [short(results)])


def _assumptions(results: Results) -> Section:
    text = (
        "The column 'known' lists the conditions under which the estimate is right. All settings that are not named have their defaults.",
        "Time of an update: processor time of one estimator that is called from Python with the readings of one flight; median and "
        "range over the rounds. It is the only figure of this report that depends on the computer and differs from run to run.",
    )
    return Section("Assumptions and cost", text, [assumed(results)])


def _flights(results: Results) -> Section:
    text = (
        "In parallel: one flight carries all estimators, which read the same measurements; the law is corrected by the true K, by none "
        "of them. Errors, delays and alarms come from these flights.",
        "Correcting: one estimator corrects the law. Tracking and losses come from these flights; they are compared with a law that is "
        "corrected by the true K, with a law that is not corrected, and with the same flight without its failure.",
        definitions(results.runs),
    )
    return Section("Flights", text, [courses(results)])


def _results(results: Results) -> Section:
    text = (
        "Medians over the flights with exact 95 % intervals; fewer than six values have no such interval, it is then infinite.",
        "RMS error of K: of K-hat - K from 1 s after the failure. Final error of K: |K-hat - K| at the last tick. Within 20 % to stay: "
        "time from the failure after which the smoothed K-hat stays within 20 % of K. Alarm after: time from the failure to the first "
        "alarm; - for an estimator without a test. Tracking: RMS of q - q_ref of the flights that were not lost. Lost: share of flights "
        "that departed (alpha more than 25 deg from trim), %.",
    )
    return Section("Results", text, [one_flight(results, flight) for flight in results.flights])


def _alarms(results: Results) -> Section:
    return Section("False alarms", (), [false_alarms(results)])


def _choice(results: Results) -> Section:
    return Section("Which to choose", reading(results), [by_flight(results)])


SECTIONS: tuple[Callable[[Results], Section], ...] = (_glance, _assumptions, _flights, _results, _alarms, _choice)
