"""How long ensembles of the adaptive loop take: linear and nonlinear, on one process and on all cores.

    python benchmarks/monte_carlo.py [--runs 500] [--rounds 3]

The cases are flown in turn, so that a change of the machine's mood meets all of them; medians over the rounds are printed with the
range. Times include starting the processes and planning. ``per flight`` is the time of all processes together.
"""

from __future__ import annotations

import argparse
import os
import statistics
import time

from flightbed.ensemble import Job, fly_jobs, processes
from flightbed.scenario import load_scenario

_CASES = {"linear, thesis-loss": "thesis-loss", "F-16, elevator-loss": "elevator-loss"}


def measure(runs: int, rounds: int) -> None:
    """Fly all cases and print their times."""
    cores = os.cpu_count() or 1
    workers = [1] if cores == 1 else [1, cores]
    taken: dict[tuple[str, int], list[float]] = {(name, count): [] for name in _CASES for count in workers}
    for scenario in _CASES.values():  # compiled code and the schedule are cached from now on
        fly_jobs([Job(load_scenario(scenario), 1)])
    print(f"load average before: {os.getloadavg()[0]:.2f} on {cores} cores")
    for _ in range(rounds):
        for name, count in taken:
            began = time.perf_counter()
            with processes(count) as executor:
                flown = fly_jobs([Job(load_scenario(_CASES[name]), runs)], executor=executor)
            taken[name, count].append(time.perf_counter() - began)
            assert len(flown[0]) == runs
    print(f"{runs} flights of 16.5 s, median and range of {rounds}")
    for (name, count), times in taken.items():
        median = statistics.median(times)
        print(
            f"  {name:<22} {count} {'process  ' if count == 1 else 'processes'} {median:6.1f} s ({min(times):.1f} to {max(times):.1f}); "
            f"{runs / median:6.1f} flights/s, {1000.0 * median * count / runs:5.1f} ms per flight"
        )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=500)
    parser.add_argument("--rounds", type=int, default=3)
    arguments = parser.parse_args()
    measure(arguments.runs, arguments.rounds)
