"""Scenario -> flight -> folder: fly a scenario and write the folder of the run, atomically."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path

from flightbed.analysis.result import Result, Watch, fly_scenario
from flightbed.config.tracebacks import with_error_context
from flightbed.core.files import check_target
from flightbed.core.signals import Sample
from flightbed.flight.assembly import assemble
from flightbed.flight.computer import computer_of
from flightbed.flight.loop import fly as fly_loop
from flightbed.flight.pacing import Clock
from flightbed.flight.plan import Plan, plan
from flightbed.runs.folder import RUN, write_run
from flightbed.scenario.own_code import named_extensions
from flightbed.scenario.tables import Scenario
from flightbed.telemetry.flight_info import FlightInfo, result_info
from flightbed.telemetry.live import Live


def fly(scenario: Scenario) -> Iterator[Sample]:
    """Trim, design and fly a scenario, yielding one Sample per control tick."""
    flight, used = assemble(plan(scenario)), named_extensions(scenario)
    if not used:
        return fly_loop(flight, computer_of(flight))
    return with_error_context(fly_loop(flight), scenario.rates.control_hz, used)


def _watch(live: Live, planned: Plan, readings: Mapping[str, float]) -> Watch:
    """Show the plan in the viewer; returns the function that shows the samples."""
    live.start(FlightInfo.of(planned, readings=readings))
    return live.forward


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
    """Fly a scenario; with ``out``, write a folder with scenario, trace, metrics, recording and report.

    The folder is written atomically; an interrupted flight writes nothing.

    Args:
        scenario: the settings of the flight.
        out: folder to write; None writes nothing.
        rerun: write a Rerun recording into the folder.
        report: write a report page into the folder.
        replace: replace an earlier run in ``out`` when the flight is over, and refuse any other folder that is not empty; if false, write
            the first of OUT, OUT-2, OUT-3, ... that does not exist.
        pace: clock that releases the ticks, ``flightbed.WallClock()`` for real time; the trace then also has the columns of
            ``punctuality.with_timings``. None flies as fast as possible.
        live: viewer that shows the flight as it flies, ``flightbed.Live()`` on this computer; each object serves one flight.

    Raises:
        InputError, NotComputableError: from the plan or the flight.
        OutputError: the folder cannot be written.

    """
    target = None if out is None else check_target(Path(out), RUN, replace=replace)
    try:
        result = fly_scenario(scenario, pace=pace, watch=None if live is None else partial(_watch, live))
        if target is not None:
            result = dataclasses.replace(
                result, folder=write_run(result, target, rerun=rerun, report=report, replace=replace)
            )
        if live is not None:
            live.finish(result_info(result))
    finally:
        if live is not None:
            live.close()
    return result
