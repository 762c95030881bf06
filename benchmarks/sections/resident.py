"""Memory of a fresh process: run by memory.py, prints JSON. Imports nothing from the benchmarks.

python resident.py held|grown FLIGHTS KEY=VALUE ...
"""

from __future__ import annotations

import gc
import json
import os
import sys
from pathlib import Path

_SETTLING = 5  # flights before memory is looked at: what the first ones load stays
_MARKS = 10


def resident_b() -> int:
    """Return the resident memory of this process, bytes, after a garbage collection."""
    gc.collect()
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def held(flights: int, overrides: list[str]) -> dict[str, float]:
    """Return memory step by step: the interpreter, flightbed and a plan, ``flights`` evaluated traces, ``flights`` assembled flights."""
    memory = {"python": resident_b()}
    from flightbed.analysis.result import fly_plan
    from flightbed.flight.assembly import assemble
    from flightbed.flight.plan import plan
    from flightbed.scenario.reading import load_scenario

    planned = plan(load_scenario("elevator-loss", overrides))
    memory["planned"] = resident_b()
    for _ in range(_SETTLING):
        fly_plan(planned)
    memory["flown"] = resident_b()
    traces = [fly_plan(planned) for _ in range(flights)]
    memory["traces"] = resident_b()
    aloft = [assemble(planned) for _ in range(flights)]
    memory["aloft"] = resident_b()
    assert len(traces) == len(aloft)
    return {
        **memory,
        "trace": (memory["traces"] - memory["flown"]) / flights,
        "flight": (memory["aloft"] - memory["traces"]) / flights,
    }


def grown(flights: int, overrides: list[str]) -> dict[str, list[int]]:
    """Return memory after the first flights, and after each tenth of the flights, each with its own seed; none is kept."""
    from dataclasses import replace

    from flightbed.analysis.result import fly_plan
    from flightbed.flight.plan import plan
    from flightbed.scenario.reading import load_scenario

    planned = plan(load_scenario("elevator-loss", overrides))

    def fly(seed: int) -> None:
        fly_plan(replace(planned, scenario=planned.scenario.with_seed(seed)))

    for seed in range(_SETTLING):
        fly(seed)
    memory, done = [resident_b()], 0
    for mark in range(1, _MARKS + 1):
        while done < flights * mark // _MARKS:
            fly(_SETTLING + done)
            done += 1
        memory.append(resident_b())
    return {"memory": memory}


if __name__ == "__main__":
    what, number, *rest = sys.argv[1:]
    print(json.dumps({"held": held, "grown": grown}[what](int(number), rest)))
