"""Seconds of flight per wall second: the whole adaptive loop against bare stepping of the same FDM.

    python benchmarks/loop_speed.py [--plant-hz 200] [--rounds 5]

Bare stepping is `FGFDMExec.run()` alone, from Python, on the same trimmed aircraft at the same plant rate. Bare and loop
are flown in turn, so that a change of the machine's speed meets both; the medians over the rounds are printed with the
range, and so is the ratio taken round by round.
"""

from __future__ import annotations

import argparse
import statistics
import time

from flightbed.loop import fly
from flightbed.mission import Plan, assemble, plan
from flightbed.scenario import load_scenario
from flightbed.trace import collect


def _bare(planned: Plan) -> float:
    """Step the FDM of a fresh flight through the scenario's time; returns wall seconds."""
    flight = assemble(planned)
    run = flight.plant._fdm.exec.run
    steps = planned.scenario.ticks * planned.scenario.rates.plant_hz // planned.scenario.rates.control_hz
    began = time.perf_counter()
    for _ in range(steps):
        run()
    return time.perf_counter() - began


def _loop(planned: Plan) -> float:
    """Fly a fresh flight into a trace; returns wall seconds."""
    names = [e.name for e in planned.scenario.estimators]
    flight = assemble(planned)
    began = time.perf_counter()
    trace = collect(fly(flight), estimators=names, control_hz=planned.scenario.rates.control_hz)
    elapsed = time.perf_counter() - began
    assert len(trace) == planned.scenario.ticks, "the flight departed: not the same time flown"
    return elapsed


def _spread(values: list[float], spec: str) -> str:
    return f"{statistics.median(values):{spec}} ({min(values):{spec}} to {max(values):{spec}})"


def measure(plant_hz: int, rounds: int) -> None:
    """Print one comparison."""
    scenario = load_scenario("elevator-loss", [f"rates.plant_hz={plant_hz}"])
    for label, estimators in (
        ("30-sample window", scenario.estimators[:1]),
        ("no estimator", ()),
    ):
        adaptation = scenario.adaptation.model_copy(update={"enabled": bool(estimators)})
        failures = scenario.failures if estimators else ()
        flown = scenario.model_copy(update={"estimators": estimators, "adaptation": adaptation, "failures": failures})
        planned = plan(flown)
        seconds = flown.duration_s
        _bare(planned), _loop(planned)  # warm up
        bare, loop = [], []
        for _ in range(rounds):
            bare.append(_bare(planned))
            loop.append(_loop(planned))
        overhead = [(x - b) / flown.ticks * 1e6 for b, x in zip(bare, loop, strict=True)]
        print(f"plant {plant_hz} Hz, control 100 Hz, {label}; median and range of {rounds}")
        print(f"  bare stepping       {_spread([seconds / b for b in bare], '7.0f')} s of flight per s")
        print(f"  whole loop          {_spread([seconds / x for x in loop], '7.0f')} s of flight per s")
        print(f"  loop / bare         {_spread([b / x for b, x in zip(bare, loop, strict=True)], '7.2f')}")
        print(f"  harness per tick    {_spread(overhead, '7.1f')} us")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--plant-hz", type=int, nargs="+", default=[200, 100])
    parser.add_argument("--rounds", type=int, default=5)
    arguments = parser.parse_args()
    for rate in arguments.plant_hz:
        measure(rate, arguments.rounds)
