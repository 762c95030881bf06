"""Flight of a plan -> Result: the trace with its Cramer-Rao bound and margins, the metrics, and the summary of metrics.json.

Nothing here writes a folder, draws, or imports a viewer; a function given as ``watch`` sees the samples in flight.
"""

from __future__ import annotations

import time
from array import array
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import numpy as np

from flightbed.analysis.cramer_rao import bound, design_models, schedule_models
from flightbed.analysis.excitation import with_excitation
from flightbed.analysis.metrics import Metrics, at_stop, measure, snr_db
from flightbed.analysis.punctuality import punctuality, with_timings
from flightbed.analysis.summary import (
    Ending,
    ExtensionSummary,
    MarginSummary,
    RunSummary,
    ShortPeriodSummary,
    TrimSummary,
)
from flightbed.analysis.trace import Trace, collect, from_rows
from flightbed.config.tracebacks import error_context
from flightbed.control.stability_margins import lateral_margin
from flightbed.core.environment import environment
from flightbed.core.errors import ExtensionError
from flightbed.core.signals import Sample
from flightbed.core.sources import source_sha256
from flightbed.core.units import DEG
from flightbed.core.versions import versions
from flightbed.estimation.base import estimate_names
from flightbed.failures.base import failure_tick
from flightbed.flight.assembly import assemble, names_of, sensor_noise
from flightbed.flight.composed import Composed
from flightbed.flight.computer import computer_of, ready, rows_of
from flightbed.flight.loop import fly as fly_loop
from flightbed.flight.pacing import Clock, paced
from flightbed.flight.parts import Flight
from flightbed.flight.plan import Plan, plan
from flightbed.models.linear_aircraft import LinearAircraft
from flightbed.scenario.own_code import named_extensions, named_plug_ins
from flightbed.scenario.tables import Scenario

Watch = Callable[[Iterator[Sample]], Iterator[Sample]]  # yields the samples unchanged


@dataclass(frozen=True)
class Result:
    """A flown scenario.

    Attributes:
        plan: aircraft, trim and design.
        trace: one row per control tick.
        metrics: tracking and estimation; also in the summary.
        summary: content of metrics.json.
        folder: path of the run's folder; None where none is written.

    """

    plan: Plan
    trace: Trace
    metrics: Metrics
    summary: RunSummary
    folder: Path | None = None


def fly_scenario(
    scenario: Scenario,
    *,
    pace: Clock | None = None,
    watch: Callable[[Plan, Mapping[str, float]], Watch] | None = None,
) -> Result:
    """Plan, fly and measure a scenario; writes nothing.

    Args:
        scenario: the settings of the flight.
        pace: clock that the ticks keep to; None flies as fast as possible.
        watch: called before the flight with the plan and the predicted readings of each estimate; returns the function that watches
            the samples.

    Raises:
        InputError, NotComputableError: from the plan or the flight.

    """
    source_sha256()  # of the sources as they are now: they may be edited during the flight
    planned = plan(scenario)
    flight = assemble(planned)
    watcher = None if watch is None else watch(planned, predicted_readings(flight, scenario))
    ready(flight)
    margins = margins_of(planned, flight)
    began = time.perf_counter()
    trace = fly_trace(flight, scenario, pace, watcher)
    wall_s = time.perf_counter() - began
    trace, metrics = evaluate(planned, flight, trace)
    return Result(planned, trace, metrics, summarize(planned, trace, metrics, margins, wall_s))


def fly_plan(plan: Plan) -> tuple[Trace, Metrics]:
    """Fly a plan once; returns the trace and its metrics."""
    flight = assemble(plan)
    return evaluate(plan, flight, fly_trace(flight, plan.scenario))


def fly_trace(flight: Flight, scenario: Scenario, pace: Clock | None = None, watch: Watch | None = None) -> Trace:
    """Fly; return the trace of all samples.

    The flight computer is compiled if all parts of the flight are built in; the samples are equal bit for bit.

    Args:
        flight: assembled, at its start.
        scenario: the settings of the flight.
        pace: clock that the ticks keep to; None flies as fast as possible.
        watch: receives the samples in flight and yields them unchanged.

    """
    control_hz, names, timings = scenario.rates.control_hz, names_of(scenario, flight.estimators), array("q")
    own = bool(named_extensions(scenario))
    if pace is None and watch is None and not own:
        rows = rows_of(flight)
        if rows is not None:
            has = {"lateral": flight.lateral is not None, "load_factor": flight.load_factor is not None}
            return from_rows(rows, estimators=names, control_hz=control_hz, **has)
    samples = fly_loop(flight, Composed(flight) if own else computer_of(flight))
    if pace is not None:
        samples = paced(samples, control_hz=control_hz, clock=pace, record=timings.extend)
    if watch is not None:
        samples = watch(samples)
    with error_context(control_hz):
        trace = collect(samples, estimators=names, control_hz=control_hz)
    return trace if pace is None else with_timings(trace, timings)


def evaluate(plan: Plan, flight: Flight, trace: Trace) -> tuple[Trace, Metrics]:
    """Return the trace with bound, margins and excitation, and its metrics. Raises ExtensionError for a health that is not finite."""
    health = {c: trace[c] for c in ("effectiveness_true", "elevator_force_true", "cg_shift_cbar")}
    bad = ~np.all(np.isfinite(np.column_stack(list(health.values()))), axis=1)
    if bad.any():
        tick = int(np.argmax(bad))
        got = ", ".join(f"{c} = {values[tick]:g}" for c, values in health.items() if not np.isfinite(values[tick]))
        raise ExtensionError(
            f"failures: the health is not finite from t = {trace['t_s'][tick]:g} s on (got {got}); return finite values"
        )
    trace = _with_margins(plan, _with_bound(plan, trace))
    trace = with_excitation(trace, m_delta=float(plan.design.b[1]), control_hz=plan.scenario.rates.control_hz)
    failed_at_s = _failed_at_s(plan.scenario, trace)
    readings = predicted_readings(flight, plan.scenario)
    alpha_trim_deg = plan.trim.alpha_rad / DEG
    return trace, measure(trace, alpha_trim_deg=alpha_trim_deg, failed_at_s=failed_at_s, readings=readings)


def predicted_readings(flight: Flight, scenario: Scenario) -> dict[str, float]:
    """Return the number of readings that each estimate predicts, the mean of its NIS under its own model; others are left out."""
    readings = {
        name: getattr(estimator, "readings", None)
        for settings, estimator in zip(scenario.estimators, flight.estimators, strict=True)
        for name in estimate_names(settings.name, estimator)
    }
    return {name: float(count) for name, count in readings.items() if count is not None}


def first_failure_s(scenario: Scenario) -> float | None:
    """Return the time of the tick at which the first failure acts, s; None without a failure."""
    ticks = [failure_tick(failure, scenario.rates.control_hz) for failure in scenario.failures]
    return min(ticks) / scenario.rates.control_hz if ticks else None


def _failed_at_s(scenario: Scenario, trace: Trace) -> float | None:
    """Return the time of the first failure, if the flight reached it."""
    failed_at = first_failure_s(scenario)
    return failed_at if failed_at is not None and failed_at <= trace["t_s"][-1] else None


def _with_bound(plan: Plan, trace: Trace) -> Trace:
    """Add the Cramer-Rao bound of K, where a true model is known."""
    hz, estimators = plan.scenario.rates.control_hz, plan.scenario.estimators
    if isinstance(plan.aircraft, LinearAircraft):
        models = design_models(trace, plan.aircraft.design, control_hz=hz)
    elif plan.schedule is not None:
        models = schedule_models(trace, plan.schedule, control_hz=hz)
    else:
        return trace
    window = next((e.constant_over for e in estimators if e.constant_over is not None), None)
    return trace.with_column("effectiveness_bound", bound(trace, models, sensor_noise(plan.scenario), window=window))


def _with_margins(plan: Plan, trace: Trace) -> Trace:
    """Add the smallest and the largest true K with a stable pitch loop, for the K-hat that corrects the law at each tick."""
    if plan.margins is None:
        return trace
    adaptation = plan.scenario.adaptation
    used = np.ones(len(trace))
    if adaptation.enabled:
        effectiveness = (
            trace["effectiveness_true"]
            if adaptation.oracle
            else trace[f"{adaptation.estimator}.effectiveness_smoothed"]
        )
        used = np.maximum(effectiveness, adaptation.floor)
    low, high = plan.margins.at(used)
    return trace.with_column("effectiveness_stable_min", low).with_column("effectiveness_stable_max", high)


def margins_of(plan: Plan, flight: Flight) -> MarginSummary:
    """Return the margins of the loops with healthy surfaces, before the flight changes the laws."""
    elevator, turning = None, None
    if plan.margins is not None:
        low, high = plan.margins.at(np.ones(1))
        elevator = (float(low[0]), float(high[0]))
    if plan.lateral is not None and flight.lateral is not None:
        hz = plan.scenario.rates.control_hz
        turning = lateral_margin(flight.lateral.law, plan.lateral, control_hz=hz)
    return MarginSummary(elevator, turning)


def summarize(plan: Plan, trace: Trace, metrics: Metrics, margins: MarginSummary, wall_s: float) -> RunSummary:
    """Return the summary of a flight.

    Args:
        plan: aircraft, trim and design.
        trace, metrics: as ``evaluate`` returns them.
        margins: as ``margins_of`` returns them before the flight.
        wall_s: time that the flight took, s.

    """
    scenario, design = plan.scenario, plan.design
    failed_at = _failed_at_s(scenario, trace)
    flown_s = len(trace) / scenario.rates.control_hz
    alpha = np.abs(trace["alpha_deg"] - plan.trim.alpha_rad / DEG)
    before = trace["t_s"] < (failed_at or np.inf)  # a failure at 0 s: the whole flight counts
    q_max, alpha_max = (float(np.max(v[before])) for v in (np.abs(trace["q_deg_s"]), alpha))
    ended: Ending = "departed" if metrics.departed else "time" if len(trace) == scenario.ticks else "ground"
    return RunSummary(
        scenario=scenario.name,
        seed=scenario.seed,
        metrics=metrics,
        snr_db=snr_db(
            alpha_max=alpha_max,
            q_max=q_max,
            alpha_std=scenario.sensors.alpha_std_deg,
            q_std=scenario.sensors.q_std_deg_s,
            poles=design.poles,
        ),
        ended=ended,
        failed_at_s=failed_at,
        flown_s=flown_s,
        elevator_at_stop_share=float(np.mean(at_stop(trace, plan.aircraft.actuator))),
        bank_max_deg=float(np.max(np.abs(trace["phi_deg"]))),
        trim=TrimSummary(
            plan.trim.alpha_rad / DEG, plan.trim.elevator_rad / DEG, plan.trim.throttle_norm, plan.trim.residual
        ),
        short_period=ShortPeriodSummary(
            tuple(map(tuple, design.A.tolist())), tuple(design.b.tolist()), tuple(design.poles.tolist())
        ),
        gains=plan.gains,
        extensions=tuple(ExtensionSummary(own.name, own.sha256, own.imports) for own in named_extensions(scenario)),
        aircraft_sha256=plan.aircraft.sha256,
        wall_time_s=wall_s,
        real_time_factor=flown_s / wall_s,
        realtime=punctuality(trace, control_hz=scenario.rates.control_hz),
        versions={**versions(), "rerun-sdk": version("rerun-sdk")},
        source_sha256=source_sha256(),
        environment=dict(environment()),
        plug_ins=named_plug_ins(scenario),
        margins=margins,
    )
