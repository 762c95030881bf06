"""Result -> the report of a flight: settings, failures, outcome, figures, all numbers, and the command that repeats it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from flightbed.analysis.events import events, failures, gusts
from flightbed.analysis.metrics import PHASES
from flightbed.analysis.pull_up import PULL_UP_METRICS
from flightbed.analysis.summary_text import correction, followed, outcome, pace_text, settings_rows
from flightbed.analysis.trace import true_share
from flightbed.avionics.short_period import ShortPeriod
from flightbed.config.own_code import names_without_option, use_options
from flightbed.core.estimate_names import estimator_of
from flightbed.document.document import Cell, Document, Listing, Section, Table
from flightbed.report.figures import pictures

if TYPE_CHECKING:
    from flightbed.analysis.result import Result

# metric of an estimator -> (unit, meaning); "the failure" is the first change of K, see analysis/metrics.py
ESTIMATOR_METRICS = MappingProxyType(
    {
        "final": ("1", "last K-hat"),
        "median_abs_error_post": ("1", "median |K-hat - K| from 0.3 s after the failure"),
        "rms_error_smoothed_post": ("1", "RMS error of the smoothed K-hat from 0.3 s after the failure"),
        "std_pre": ("1", "standard deviation of K-hat before the failure"),
        "first_within_20pct_s": ("s", "from the failure to the first K-hat within +-20 % of K"),
        "first_within_20pct_smoothed_s": ("s", "the same of the smoothed K-hat"),
        "nis_mean": ("1", "mean normalized innovation squared"),
        "nis_expected": ("1", "its expectation under the estimator's model: the number of predicted readings"),
        "detected_at_s": ("s", "from the failure to the first alarm after it"),
        "false_alarms": ("1", "alarms before the failure"),
        "nees_mean_post": ("1", "mean of ((K-hat - K)/sigma)^2 from 0.3 s after the failure; 1 for a consistent sigma"),
        "efficiency": ("1", "mean square of the Cramer-Rao bound over the mean square error"),
    }
)
_MOST_EVENTS = 100  # in the event log of the page
_GAINS = MappingProxyType(
    {"alpha": "rad/rad", "q": "s", "elevator": "rad/rad", "reference": "s", "integral": "rad/rad"}
)


def run_report(result: Result) -> Document:
    """Return the report of a flight; equal flights give an equal report, apart from the wall time.

    Args:
        result: the flight, as ``runs.run.run`` returns it, written to a folder or not.

    """
    scenario, summary = result.plan.scenario, result.summary
    facts = {
        "flown": f"{summary.flown_s:g} s in {summary.wall_time_s:.2f} s, {summary.real_time_factor:.0f} times real time",
        **({"real time": pace_text(summary.realtime, summary.flown_s)} if summary.realtime else {}),
        "aircraft": f"{result.plan.aircraft.name}, SHA-256 {summary.aircraft_sha256}",
        **({"notes": "; ".join(result.plan.notes)} if result.plan.notes else {}),
        **{f"own code {own.name}": f"SHA-256 {own.sha256 or 'unknown'}" for own in summary.extensions},
        "versions": summary.versions,
    }
    sections = [
        Section("Settings", (), [_pairs("flown", "The flight", settings_rows(scenario, result.plan.aircraft.name))]),
        Section("Figures", (), pictures(result)),
        _numbers(result),
        Section("Events", (), [_events(result)]),
        _design(result),
        rerun_command(
            scenario.to_toml(), use_options(summary.own_code), summary.versions, names_without_option(summary.own_code)
        ),
    ]
    condition = f"Mach {scenario.condition.mach:g}, {scenario.condition.altitude_ft:,.0f} ft"
    title = f"{scenario.name}: {result.plan.aircraft.name} at {condition}, seed {scenario.seed}"
    return Document(title, sections, facts, _lead(result))


def headline(result: Result) -> str:
    """Return failures, law, correction and outcome in a few sentences."""
    scenario, summary = result.plan.scenario, result.summary
    happened = "; ".join([*failures(scenario), *gusts(scenario)]) or "nothing fails"
    return (
        f"{happened[0].upper()}{happened[1:]}. The {scenario.control.law} law is {correction(scenario)}. "
        f"Outcome: {outcome(summary)}."
    )


def _lead(result: Result) -> Section:
    """Return the first section: headline and the main numbers."""
    scenario, summary, trace = result.plan.scenario, result.summary, result.trace
    away = np.abs(trace["alpha_deg"] - summary.trim.alpha_deg)
    failed = summary.failed_at_s is not None
    columns = ["departed", "largest |alpha - trim|, deg", "elevator at a stop"]
    gone = f"at {summary.ended_s:.2f} s" if summary.metrics.departed else "no"
    cells: list[Cell] = [gone, float(np.max(away)), summary.elevator_at_stop_share]
    words = ("before the failure", "after it") if failed else ("whole flight",)
    for when, phase in zip(words, PHASES, strict=False):
        for what, of, unit in followed(scenario):
            columns.append(f"RMS {what.partition(' ')[0]} - reference {when}, {unit}")
            cells.append(summary.metrics.tracking_rms(phase, of))
    tables = [Table("key", "", columns, [cells], {"elevator at a stop": ".1%"})]
    if trace.estimators:
        tables.append(_estimates(result))
    return Section("", [t for t in (headline(result), scenario.description) if t], tables)


def _estimates(result: Result) -> Table:
    adaptation = result.plan.scenario.adaptation
    used = adaptation.estimator if adaptation.enabled and not adaptation.oracle else ""
    columns = (
        "estimator", "corrects the law", "K at end", "true K", "median |K-hat - K|", "within 20 % after, s", "alarm after, s",
        "mean NIS", "expected NIS",
    )  # fmt: skip
    rows: list[list[Cell]] = []
    for name, m in result.metrics.estimators.items():
        truth = float(result.trace[true_share(name)][-1])
        rows.append(
            [
                name, "yes" if estimator_of(name) == used else "no", m.final, truth, m.median_abs_error_post, m.first_within_20pct_s,
                m.detected_at_s, m.nis_mean, m.nis_expected,
            ]
        )  # fmt: skip
    return Table("estimates", "", columns, rows, dict.fromkeys(columns[2:4], ".3f") | {columns[4]: ".2g"})


def _numbers(result: Result) -> Section:
    summary, metrics, names = result.summary, result.metrics, result.trace.estimators
    sideslip = ", sideslip more than 25 deg" if result.plan.scenario.lateral.enabled else ""
    flight = [
        ("departed_at_s", metrics.departed_at_s, "s", f"alpha more than 25 deg from trim{sideslip}, or a state that is not finite"),
        ("flown_s", summary.flown_s, "s", f"time flown; ended by: {summary.ended}"),
        ("failed_at_s", summary.failed_at_s, "s", "first failure, of any kind, that the flight reached"),
        ("estimators_since_s", metrics.estimators_since_s, "s", "first change of K, the origin of the estimators' times"),
        *(
            (f"tracking_rms_{phase}_{key}", metrics.tracking_rms(phase, key), unit, text)
            for what, key, unit in followed(result.plan.scenario)
            for phase, text in zip(PHASES, (f"RMS of {what} before the first failure", "the same from 0.3 s after it"), strict=True)
        ),
        *(
            (key, getattr(metrics, key), unit, text)
            for key, (unit, text) in PULL_UP_METRICS.items()
            if metrics.pull_up_overshoot is not None
        ),
        ("elevator_at_stop_share", summary.elevator_at_stop_share, "1", "share of the ticks with the command cut at a stop"),
        ("bank_max_deg", summary.bank_max_deg, "deg", "largest bank"),
        ("snr_db", summary.snr_db, "dB", "signal to noise, Sillence eq (82), before the failure"),
    ]  # fmt: skip
    tables = [Table("flight", "The flight", ("metric", "value", "unit", "meaning"), flight)]
    if names:
        rows = [
            [key, *(getattr(metrics.estimators[name], key) for name in names), unit, meaning]
            for key, (unit, meaning) in ESTIMATOR_METRICS.items()
        ]
        note = '"-": never, or not defined for this flight.'
        tables.append(Table("estimators", "Estimators", ("metric", *names, "unit", "meaning"), rows, note=note))
    text = () if names else ("No estimator flew.",)
    return Section("Numbers", (*text, "The names are the keys of metrics.json."), tables)


def _events(result: Result) -> Table:
    """Return the event log; of more than ``_MOST_EVENTS`` only the severe ones and the first others."""
    happened = events(result.plan.scenario, result.trace, result.summary, result.plan.actuators)
    others = [i for i, (_, _, severe) in enumerate(happened) if not severe]
    left_out = set(others[_MOST_EVENTS:])
    rows = [(float(t), text) for i, (t, text, _) in enumerate(happened) if i not in left_out]
    note = f"{len(left_out)} more events are not listed." if left_out else ""
    return Table("events", "Event log", ("time, s", "event"), rows or [("-", "nothing")], {"time, s": ".2f"}, note)


def _design(result: Result) -> Section:
    design, summary, hz = result.plan.design, result.summary, result.plan.scenario.rates.control_hz
    trim, gains = summary.trim, summary.gains
    poles = ", ".join(f"{p.real:+.4g}{f' {p.imag:+.4g}j' if p.imag else ''}" for p in summary.short_period.poles_rad_s)
    point: list[tuple[str, Cell, str]] = [
        ("alpha", trim.alpha_deg, "deg"),
        ("elevator", trim.elevator_deg, "deg"),
        ("throttle", trim.throttle_norm, "1"),
        ("residual", trim.residual, "g, rad/s^2"),
    ]
    tables = [
        Table("trim", "Trim point", ("", "value", "unit"), point),
        *_matrices(design, hz),
        Table("gains", "Gains of the law", ("of", "value", "unit"),
              [(name, value, _GAINS.get(name, "")) for name, value in (asdict(gains) if gains else {}).items()]),
    ]  # fmt: skip
    text = (
        "x' = A x + K b u, x = (alpha, q), u the elevator, all in deviations from trim, in SI and radians. "
        f"Poles of A: {poles} rad/s. The actuator lags with {design.actuator_rad_s:g} rad/s; "
        f"the discrete model holds u for a tick, at {hz} Hz.",
    )
    return Section("Trim, model and law", text, [t for t in tables if t.rows])


def _matrices(design: ShortPeriod, hz: int) -> list[Table]:
    discrete = design.discrete(hz)

    def table(key: str, title: str, names: Sequence[str], units: Sequence[Sequence[str]], A: Any, b: Any) -> Table:
        rows = [
            [name, *(f"{v:.5g} {u}".strip() for v, u in zip((*row, gain), unit, strict=True))]
            for name, unit, row, gain in zip(names, units, A.tolist(), b.tolist(), strict=True)
        ]
        return Table(key, title, ("", "alpha, rad", "q, rad/s", "elevator, rad"), rows)

    return [
        table("model", "Short period: A, b", ("alpha'", "q'"), (("1/s", "", "1/s"), ("1/s^2", "1/s", "1/s^2")), design.A, design.b),
        table("discrete", f"The same, discrete at {hz} Hz", ("alpha+", "q+"), (("", "s", ""), ("1/s", "", "1/s")), *discrete),
    ]  # fmt: skip


def rerun_command(toml: str, override: str, versions: Mapping[str, str], own: Sequence[str]) -> Section:
    """Return the section with the command that repeats a flight, the scenario, and the versions.

    Args:
        toml: the complete scenario.
        override: options of the command, such as ``" --set KEY=VALUE"``.
        versions: package -> version.
        own: names of own code that no command line can permit.

    """
    packages = " ".join(f"{name}=={value}" for name, value in versions.items() if name not in ("flightbed", "python"))
    commands = (
        f"flightbed run FOLDER/scenario.toml{override}\n\n"
        f"# from scratch: Python {versions['python']}, flightbed {versions['flightbed']}, and\n"
        f"pip install {packages}"
    )
    text = (
        "FOLDER is the folder of this page. With the same scenario, aircraft and versions the command reproduces the flight bit for bit; "
        "the scenario below, saved as a file, can replace the folder's.",
        *(
            f"The code '{name}' was given in Python, and no command can name it: permit it there, with flightbed.using(...)."
            for name in own
        ),
    )
    return Section(
        "Repeat this flight", text, [Listing("Commands", commands), Listing("scenario.toml, complete", toml)]
    )


def _pairs(key: str, title: str, rows: Sequence[Sequence[Cell]]) -> Table:
    return Table(key, title, ("", ""), rows)
