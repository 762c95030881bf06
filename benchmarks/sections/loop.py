"""The whole loop against bare stepping of the same FDM, at equal plant rate.

Bare stepping is ``FGFDMExec.run()`` alone, called from Python. The loop is what `flightbed run` flies: sensors, estimators, law,
correction, plant and trace; neither includes construction before the first tick. Times are processor times.
"""

from __future__ import annotations

import time
import tomllib
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

from measuring import Column, Effort, Table

from flightbed.analysis.result import fly_trace
from flightbed.analysis.trace import Trace
from flightbed.core.timing import differences, interleaved, ratios, seconds
from flightbed.core.units import DEG
from flightbed.flight.assembly import assemble
from flightbed.flight.parts import Flight
from flightbed.flight.plan import Plan, plan
from flightbed.plant.nonlinear import JsbsimPlant
from flightbed.scenario.reading import Scenario, load_scenario

SCENARIO = "elevator-loss"
PLANT_HZ = (200, 100)
_SPANS = 2  # bare stepping begins afresh so often: without a law the aircraft leaves its trim in a quarter of a minute
_NEAR_RAD = 5.0 * DEG
_BARE, _ALONE = "bare stepping", "loop, no estimator"

ESTIMATORS: Mapping[str, Mapping[str, Any]] = {
    "window of 30, scheduled": {},
    "window of 30, short period": {"model": "short-period"},
    "expanding, scheduled": {"memory": "expanding"},
    "expanding, short period (the thesis's filter)": {"model": "short-period", "memory": "expanding"},
    "differentiated-rls": {"kind": "differentiated-rls"},
}


def into_trace(flight: Flight, scenario: Scenario) -> Trace:
    """Fly an assembled flight, as ``flightbed run`` does; the only function of the benchmarks that does."""
    return fly_trace(flight, scenario)


def measure(effort: Effort) -> list[Table]:
    """Return a table for each plant rate."""
    return [_measure(plant_hz, effort) for plant_hz in PLANT_HZ]


def _measure(plant_hz: int, effort: Effort) -> Table:
    scenario = load_scenario(SCENARIO, [f"rates.plant_hz={plant_hz}", *effort.overrides])
    raw = tomllib.loads(scenario.to_toml())
    cases = {
        _ALONE: _with(raw, []),
        **{f"loop, {name}": _with(raw, [{"name": "x", **given}]) for name, given in ESTIMATORS.items()},
        f"loop, both estimators of {SCENARIO}": scenario,
    }
    plans = {name: plan(case) for name, case in cases.items()}
    ways = {_BARE: partial(_bare, plans[_ALONE]), **{name: partial(_loop, case) for name, case in plans.items()}}
    taken = interleaved(ways, effort.rounds)
    ticks, rows = scenario.ticks, {}
    for name, times in taken.items():
        rows[name] = [
            [scenario.duration_s / t for t in times],
            None if name == _BARE else ratios(taken[_BARE], times),
            None if name == _BARE else [1e6 * t / ticks for t in differences(times, taken[_BARE])],
            None if name in (_BARE, _ALONE) else [1e6 * t / ticks for t in differences(times, taken[_ALONE])],
        ]
    hz = scenario.rates.control_hz
    return Table(
        f"Plant at {plant_hz} Hz, control at {hz} Hz, {SCENARIO}, {scenario.duration_s:g} s",
        (
            Column("flight per second", "s", ".0f"),
            Column("speed over bare", "1", ".2f"),
            Column("a tick above bare", "us", ".1f"),
            Column("a tick above no estimator", "us", ".1f"),
        ),
        rows,
    )


def _with(raw: Mapping[str, Any], estimators: Sequence[Mapping[str, Any]]) -> Scenario:
    """Return the scenario with these estimators, the first of which corrects the law; without any the law gets the true K."""
    if estimators:
        adaptation = {**raw["adaptation"], "estimator": estimators[0]["name"]}
    else:
        adaptation = {"enabled": True, "oracle": True, "floor": raw["adaptation"]["floor"]}
    return load_scenario({**raw, "estimators": list(estimators), "adaptation": adaptation})


def _bare(planned: Plan) -> float:
    """Step the FDMs of fresh flights through the scenario's time; returns seconds of the processor."""
    rates, total = planned.scenario.rates, 0.0
    steps = planned.scenario.ticks * rates.plant_hz // rates.control_hz
    for span in range(_SPANS):
        plant = assemble(planned).plant
        assert isinstance(plant, JsbsimPlant)
        repeat = steps * (span + 1) // _SPANS - steps * span // _SPANS
        total += repeat * seconds(plant._fdm.exec.run, repeat, clock=time.thread_time)
        if abs(plant.sense().alpha_rad - planned.trim.alpha_rad) > _NEAR_RAD:
            raise RuntimeError("the FDM that is stepped alone left its trim: not the same flight")
    return total


def _loop(planned: Plan) -> float:
    """Fly a fresh flight into a trace; returns seconds of the processor."""
    flight, scenario = assemble(planned), planned.scenario
    traces: list[Trace] = []
    taken = seconds(lambda: traces.append(into_trace(flight, scenario)), clock=time.thread_time)
    if len(traces[0]) != scenario.ticks:
        raise RuntimeError(
            f"the flight ended after {len(traces[0])} of {scenario.ticks} ticks: not the same time flown"
        )
    return taken
