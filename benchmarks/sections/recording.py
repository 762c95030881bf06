"""Cost of the products of a flight, beside that of the flight: trace, metrics, the bound, files; and the size of the files.

Files are timed by the wall clock, because threads of libraries help to write them; all else by processor time.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from measuring import Column, Effort, Table

from flightbed.analysis.cramer_rao import bound, schedule_models
from flightbed.analysis.metrics import measure as metrics_of
from flightbed.analysis.result import Result, fly_plan
from flightbed.core.files import frozen_heap
from flightbed.core.timing import differences, interleaved, ratios, seconds
from flightbed.core.units import DEG
from flightbed.document.html import render
from flightbed.flight.assembly import assemble, sensor_noise
from flightbed.flight.computer import rows_of
from flightbed.report.flight_report import run_report
from flightbed.runs.run import run
from flightbed.scenario.reading import load_scenario
from flightbed.telemetry.flight_info import result_info
from flightbed.telemetry.recording import write_recording

from .loop import SCENARIO, into_trace

_TRACE, _PARQUET, _RRD, _REPORT = "flown into a trace", "trace.parquet", "flight.rrd", "report.html"
_DROPPED = "flown, no trace made of it"


def measure(effort: Effort) -> list[Table]:
    """Return the table of the parts."""
    result = run(load_scenario(SCENARIO, effort.overrides))
    scenario, trace = result.plan.scenario, result.trace
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        ways: dict[str, Callable[[], float]] = {
            "parts put together, a fresh FDM among them": lambda: _alone(lambda: assemble(result.plan)),
            _DROPPED: lambda: _flying(result, keep=False),
            _TRACE: lambda: _flying(result, keep=True),
            "planned flight put together, flown and measured": lambda: _alone(lambda: fly_plan(result.plan)),
            "metrics": lambda: _alone(lambda: _metrics(result)),
            "Cramer-Rao bound": lambda: _alone(lambda: _bound(result)),
            _PARQUET: lambda: seconds(lambda: trace.write(folder / _PARQUET)),
            _RRD: lambda: seconds(lambda: write_recording(folder / _RRD, trace, result_info(result))),
            _REPORT: lambda: seconds(lambda: _report(result, folder / _REPORT)),
        }
        taken = interleaved(ways, effort.rounds)
        sizes = {file: [(folder / file).stat().st_size / 1e3] for file in (_PARQUET, _RRD, _REPORT)}
    sizes[_TRACE] = [sum(column.nbytes for column in trace.columns.values()) / 1e3]
    taken["the trace alone"] = differences(taken[_TRACE], taken[_DROPPED])
    return [
        Table(
            f"One flight of {SCENARIO}, {scenario.duration_s:g} s, {len(trace)} ticks, {len(trace.columns)} columns",
            (Column("time", "ms", ".2f"), Column("over flying into a trace", "1", ".2f"), Column("size", "kB", ".0f")),
            {
                name: [
                    [1e3 * t for t in times],
                    None if name == _TRACE else ratios(times, taken[_TRACE]),
                    sizes.get(name),
                ]
                for name, times in taken.items()
            },
        )
    ]


def _flying(result: Result, *, keep: bool) -> float:
    """Fly a fresh flight, into a trace or into nothing; returns seconds of the processor."""
    flight, scenario = assemble(result.plan), result.plan.scenario
    if keep:
        return _alone(lambda: into_trace(flight, scenario))
    return _alone(lambda: rows_of(flight))


def _alone(work: Callable[[], object]) -> float:
    return seconds(work, clock=time.thread_time)


def _metrics(result: Result) -> None:
    summary, alpha_trim_deg = result.summary, result.plan.trim.alpha_rad / DEG
    metrics_of(result.trace, alpha_trim_deg=alpha_trim_deg, failed_at_s=summary.failed_at_s)


def _bound(result: Result) -> None:
    scenario, schedule = result.plan.scenario, result.plan.schedule
    assert schedule is not None
    models = schedule_models(result.trace, schedule, control_hz=scenario.rates.control_hz)
    bound(result.trace, models, sensor_noise(scenario), window=scenario.estimators[0].window)


def _report(result: Result, path: Path) -> None:
    with frozen_heap():
        page = render(run_report(result))
    path.write_text(page, encoding="utf-8")
