"""Real-time performance of a paced flight: alone, and with every core kept busy by other processes.

    python benchmarks/realtime.py [--scenario elevator-loss] [--set KEY=VALUE ...] [--rounds 5] [--spin-us 200 ...]

The cases are flown in turn, so that a change of the machine's load affects all of them; medians over the rounds are printed with the
range. ``--spin-us`` compares how long a wait spins before its end. ``collections`` counts runs of the garbage collector in flight. On a
shared machine "alone" does not hold: the load average before the first flight, which should be near 0, is printed.
"""

from __future__ import annotations

import argparse
import gc
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from functools import partial
from typing import Any

from measuring import machine

from flightbed.core.timing import interleaved, spread
from flightbed.flight.pacing import WallClock
from flightbed.runs.run import run
from flightbed.scenario.reading import Scenario, load_scenario


@contextmanager
def _busy(processes: int) -> Iterator[None]:
    """Keep so many cores busy."""
    started = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(processes)]
    try:
        yield
    finally:
        for process in started:
            process.kill()
            process.wait()


def _fly(scenario: Scenario, spin_ns: int, busy: int) -> dict[str, Any]:
    """Fly once; returns the real-time performance of metrics.json, and the number of garbage collections in flight."""
    collected = []

    def collecting(phase: str, _: dict[str, int]) -> None:
        if phase == "start" and gc.get_freeze_count():  # the heap is set aside: the flight is on
            collected.append(1)

    gc.callbacks.append(collecting)
    with _busy(busy):
        kept = run(scenario, pace=WallClock(spin_ns)).summary.realtime
    gc.callbacks.remove(collecting)
    assert kept is not None
    return {**asdict(kept), "collections": len(collected)}


def measure(scenario: Scenario, rounds: int, spins_us: list[int]) -> None:
    cases = [(spin, busy) for spin in spins_us for busy in (0, machine()["cores"])]
    print(f"load average before: {machine()['load_average']:.2f} on {machine()['cores']} cores")
    flown = interleaved({case: partial(_fly, scenario, case[0] * 1000, case[1]) for case in cases}, rounds, warm=0)
    print(f"{scenario.name}, {scenario.ticks} ticks at {scenario.rates.control_hz} Hz; median and range of {rounds}")
    for (spin, busy), kept in flown.items():
        print(f"{f'{busy} busy processes' if busy else 'alone'}, spinning {spin} us")
        print(f"  late ticks        {spread([k['late_ticks'] for k in kept], '.0f')}")
        print(f"  worst overrun, ms {spread([k['worst_overrun_ms'] or 0.0 for k in kept], '.2f')}")
        for key, name in (("jitter_ms", "jitter"), ("compute_ms", "compute")):
            for percentile in ("p50", "p95", "p99", "max"):
                label = f"{name} {percentile}, ms"
                print(f"  {label:<17} {spread([k[key][percentile] for k in kept], '.4f')}")
        print(f"  achieved, Hz      {spread([k['achieved_hz'] for k in kept], '.4f')}")
        print(f"  collections       {spread([k['collections'] for k in kept], '.0f')}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenario", default="elevator-loss")
    parser.add_argument("--set", action="append", default=[])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--spin-us", type=int, nargs="+", default=[200])
    arguments = parser.parse_args()
    measure(load_scenario(arguments.scenario, arguments.set), arguments.rounds, arguments.spin_us)
