"""Scenario -> flight -> folder: flies what is planned, measures it, and writes what came of it, whole or not at all."""

from __future__ import annotations

import dataclasses
import time
from array import array
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from flightbed import factories
from flightbed.assembly import assemble, names_of, sensor_noise
from flightbed.blame import guarded, watched
from flightbed.bound import bound, design_models, schedule_models
from flightbed.errors import ExtensionError
from flightbed.estimation.base import estimate_names
from flightbed.excitation import with_excitation
from flightbed.extension import named_by
from flightbed.folder import check_target, shown, write_run
from flightbed.fused import ready, rows_of
from flightbed.linear_aircraft import LinearAircraft
from flightbed.live import Live
from flightbed.loop import Flight
from flightbed.loop import fly as _fly
from flightbed.margins import lateral_margin
from flightbed.metrics import Metrics, at_stop, measure, snr_db
from flightbed.pacing import Clock, paced, punctuality, with_timings
from flightbed.plan import Plan, plan
from flightbed.settings import Scenario
from flightbed.signals import Sample
from flightbed.telemetry.shown import Shown
from flightbed.trace import Trace, collect, from_rows
from flightbed.units import DEG
from flightbed.versions import versions

__all__ = ["Plan", "Result", "assemble", "fly", "plan", "run"]


@dataclass(frozen=True)
class Result:
    """A flown scenario.

    Attributes:
        folder: where it was written; None when it was not.
        summary: what metrics.json holds.

    """

    plan: Plan
    trace: Trace
    metrics: Metrics
    summary: dict[str, Any]
    folder: Path | None = None


def fly(scenario: Scenario) -> Iterator[Sample]:
    """Trim, design and fly a scenario, yielding one Sample per control tick."""
    samples = _fly(assemble(plan(scenario)))
    used = named_by(scenario)
    return guarded(samples, scenario.rates.control_hz, used) if used else samples


def run(
    scenario: Scenario,
    out: str | Path | None = None,
    *,
    rerun: bool = True,
    report: bool = True,
    replace: bool = True,
    pace: Clock | None = None,
    live: Live | None = None,
) -> Result:
    """Fly a scenario; with ``out``, leave a folder with scenario, trace, metrics, recording and report.

    Nothing is left behind when the flight is interrupted.

    Args:
        scenario: what to fly.
        out: folder to write; None writes nothing.
        rerun: whether the folder gets a Rerun recording.
        report: whether it gets a report page.
        replace: an ``out`` that holds an earlier run is replaced, whole, once the flight is done, and any other folder
            that is not empty is refused; if false, the first free one of OUT, OUT-2, OUT-3, ... is taken instead.
        pace: clock that the ticks keep to, ``flightbed.WallClock()`` for real time; the trace then has the columns of
            ``pacing.with_timings``, and the same others. None flies as fast as it can.
        live: shows the flight while it flies, ``flightbed.Live()`` in the viewer on this computer; used once.

    Raises:
        InputError, NotComputableError, as the parts do; OutputError when the folder cannot be written.

    """
    target = None if out is None else check_target(Path(out), replace=replace)
    planned = plan(scenario)
    flight = assemble(planned)
    try:
        if live is not None:
            live.start(Shown.of(planned, readings=_readings(flight, scenario)))
        ready()
        margins = _margins(planned, flight)  # of the laws as they are before the flight
        began = time.perf_counter()
        trace = collected(flight, scenario, pace, live)
        wall = time.perf_counter() - began
        trace, metrics = _measured(planned, flight, trace)
        result = Result(planned, trace, metrics, {**_summary(planned, trace, metrics, wall), "margins": margins})
        if target is not None:
            result = dataclasses.replace(
                result, folder=write_run(result, target, rerun=rerun, report=report, replace=replace)
            )
        if live is not None:
            live.finish(shown(result))
    finally:
        if live is not None:
            live.close()
    return result


def fly_plan(plan: Plan) -> tuple[Trace, Metrics]:
    """Fly what is planned, once, and measure it."""
    flight = assemble(plan)
    return _measured(plan, flight, collected(flight, plan.scenario))


def collected(flight: Flight, scenario: Scenario, pace: Clock | None = None, live: Live | None = None) -> Trace:
    """Fly, at the pace of a clock and before a viewer's eyes if there are any, and keep every sample.

    Where nobody looks on, and all parts are of the house, in compiled code: the samples are the same.
    """
    control_hz, names, timings = scenario.rates.control_hz, names_of(scenario, flight.estimators), array("q")
    if pace is None and live is None and not named_by(scenario):
        rows = rows_of(flight)
        if rows is not None:
            return from_rows(rows, estimators=names, control_hz=control_hz)
    samples = _fly(flight)
    if pace is not None:
        samples = paced(samples, control_hz=control_hz, clock=pace, record=timings.extend)
    if live is not None:
        samples = live.watched(samples)
    with watched(control_hz):
        trace = collect(samples, estimators=names, control_hz=control_hz)
    return trace if pace is None else with_timings(trace, timings)


def _measured(plan: Plan, flight: Flight, trace: Trace) -> tuple[Trace, Metrics]:
    left = np.column_stack([trace[c] for c in ("effectiveness_true", "elevator_force_true", "cg_shift_cbar")])
    if not np.all(np.isfinite(left)):
        at_s = trace["t_s"][np.argmin(np.all(np.isfinite(left), axis=1))]
        raise ExtensionError(
            f"failures: what is left of the aircraft is no number from {at_s:g} s on; give finite values"
        )
    trace = _with_margins(plan, _with_bound(plan, trace))
    trace = with_excitation(trace, m_delta=float(plan.design.b[1]), control_hz=plan.scenario.rates.control_hz)
    failed_at_s = _failed_at_s(plan.scenario, trace)
    readings = _readings(flight, plan.scenario)
    alpha_trim_deg = plan.trim.alpha_rad / DEG
    return trace, measure(trace, alpha_trim_deg=alpha_trim_deg, failed_at_s=failed_at_s, readings=readings)


def _readings(flight: Flight, scenario: Scenario) -> dict[str, float]:
    """Return of how many readings the NIS of each estimator is, of those that say so."""
    told = {
        name: getattr(flown, "readings", None)
        for e, flown in zip(scenario.estimators, flight.estimators, strict=True)
        for name in estimate_names(e.name, flown)
    }
    return {name: float(readings) for name, readings in told.items() if readings is not None}


def _failed_at_s(scenario: Scenario, trace: Trace) -> float | None:
    """Return the time of the first failure that the flight reached."""
    failed_at = first_failure_s(scenario)
    return failed_at if failed_at is not None and failed_at <= trace["t_s"][-1] else None


def _with_bound(plan: Plan, trace: Trace) -> Trace:
    """Add the Cramer-Rao bound of K, where there is a true model to compute it from."""
    hz, estimators = plan.scenario.rates.control_hz, plan.scenario.estimators
    if isinstance(plan.aircraft, LinearAircraft):
        models = design_models(trace, plan.aircraft.design, control_hz=hz)
    elif plan.schedule is not None:
        models = schedule_models(trace, plan.schedule, control_hz=hz)
    else:
        return trace
    window = next((e.window for e in estimators if e.memory == "window"), None)
    return trace.with_column("effectiveness_bound", bound(trace, models, sensor_noise(plan.scenario), window=window))


def _with_margins(plan: Plan, trace: Trace) -> Trace:
    """Add between which true K the pitch loop is stable while the law believes what it does."""
    if plan.margins is None:
        return trace
    adaptation = plan.scenario.adaptation
    believed = np.ones(len(trace))
    if adaptation.enabled:
        told = (
            trace["effectiveness_true"]
            if adaptation.oracle
            else trace[f"{adaptation.estimator}.effectiveness_smoothed"]
        )
        believed = np.maximum(told, adaptation.floor)
    low, high = plan.margins.at(believed)
    return trace.with_column("effectiveness_stable_min", low).with_column("effectiveness_stable_max", high)


def first_failure_s(scenario: Scenario) -> float | None:
    """Return the time of the tick at which the first failure acts, or None."""
    ticks = [factories.failure_tick(failure, scenario.rates.control_hz) for failure in scenario.failures]
    return min(ticks) / scenario.rates.control_hz if ticks else None


def _margins(plan: Plan, flight: Flight) -> dict[str, Any]:
    """Return of the healthy loops between which K of the elevator they are stable, and how far those of aileron and rudder may be off."""
    found: dict[str, Any] = {}
    if plan.margins is not None:
        found["elevator"] = [float(end[0]) for end in plan.margins.at(np.ones(1))]
    if plan.lateral is not None and flight.lateral is not None:
        hz = plan.scenario.rates.control_hz
        found["aileron_and_rudder"] = lateral_margin(flight.lateral.law, plan.lateral, control_hz=hz)
    return found


def _summary(plan: Plan, trace: Trace, metrics: Metrics, wall_s: float) -> dict[str, Any]:
    scenario, design = plan.scenario, plan.design
    failed_at = _failed_at_s(scenario, trace)
    kept = punctuality(trace, control_hz=scenario.rates.control_hz)
    flown_s = len(trace) / scenario.rates.control_hz
    alpha = np.abs(trace["alpha_deg"] - plan.trim.alpha_rad / DEG)
    before = trace["t_s"] < (failed_at or np.inf)  # a failure at 0 leaves no "before": then all of it
    q_max, alpha_max = (float(np.max(v[before])) for v in (np.abs(trace["q_deg_s"]), alpha))
    return {
        "scenario": scenario.name,
        "seed": scenario.seed,
        **metrics.to_dict(),
        "snr_db": snr_db(
            alpha_max=alpha_max,
            q_max=q_max,
            alpha_std=scenario.sensors.alpha_std_deg,
            q_std=scenario.sensors.q_std_deg_s,
            poles=design.poles,
        ),
        "ended": "departed" if metrics.departed else "time" if len(trace) == scenario.ticks else "ground",
        "failed_at_s": failed_at,
        "flown_s": flown_s,
        "elevator_at_stop_share": float(np.mean(at_stop(trace, plan.aircraft.actuator))),
        "bank_max_deg": float(np.max(np.abs(trace["phi_deg"]))),
        "trim": {
            "alpha_deg": plan.trim.alpha_rad / DEG,
            "elevator_deg": plan.trim.elevator_rad / DEG,
            "throttle_norm": plan.trim.throttle_norm,
            "residual": plan.trim.residual,
        },
        "short_period": {
            "A": design.A.tolist(),
            "b": design.b.tolist(),
            "poles_rad_s": [[p.real, p.imag] for p in design.poles.tolist()],
        },
        "gains": {} if plan.gains is None else vars(plan.gains),
        "extensions": [{"name": own.name, "sha256": own.sha256} for own in named_by(scenario)],
        "aircraft_sha256": plan.aircraft.sha256,
        "wall_time_s": wall_s,
        "real_time_factor": flown_s / wall_s,
        "realtime": None if kept is None else dataclasses.asdict(kept),
        "versions": {**versions(), "rerun-sdk": version("rerun-sdk")},
    }
