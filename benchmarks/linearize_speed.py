"""Milliseconds per linear model: flightbed against JSBSim's own FGLinearization, on the same aircraft and condition.

    python benchmarks/linearize_speed.py [--rounds 7]

FGLinearization gives twelve states and four inputs; flightbed's full model has ten and four, the short period two
and one. They are timed in turn; medians and ranges over the rounds, ratios round by round.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from functools import partial

import jsbsim
import numpy as np

from flightbed.aircraft.overlay import load_aircraft
from flightbed.core.timing import interleaved, ratios, seconds, spread
from flightbed.core.units import DEG
from flightbed.models.linearize import linearize
from flightbed.models.survey.condition import Query, linearize_at
from flightbed.models.trim import trim
from flightbed.plant.airframe import JsbsimAirframe
from flightbed.plant.base import Controls, Motion


def main(rounds: int) -> None:
    """Print the comparison."""
    f16 = load_aircraft("f16")
    airframe = JsbsimAirframe(f16, mach=0.72, altitude_m=6248.4)
    point = trim(airframe)
    airframe.respond(point.motion, point.controls)
    fdm = airframe._fdm.exec
    dt = fdm.get_delta_t()

    def theirs() -> None:
        jsbsim.FGLinearization(fdm)
        fdm.set_dt(dt)  # it leaves 0 behind

    def short_period_alone() -> np.ndarray:
        x, u = point.motion, point.controls
        columns = []
        for plus, minus, step in (
            (
                (x._replace(alpha_rad=x.alpha_rad + 1e-3 * DEG), u),
                (x._replace(alpha_rad=x.alpha_rad - 1e-3 * DEG), u),
                1e-3 * DEG,
            ),
            ((x._replace(q_rad_s=1e-4), u), (x._replace(q_rad_s=-1e-4), u), 1e-4),
            ((x, Controls(u[0] + 1e-3 * DEG, u[1])), (x, Controls(u[0] - 1e-3 * DEG, u[1])), 1e-3 * DEG),
        ):
            up, down = airframe.respond(*plus).rates, airframe.respond(*minus).rates
            columns.append([(up.alpha - down.alpha) / (2 * step), (up.q - down.q) / (2 * step)])
        return np.array(columns).T

    assert isinstance(point.motion, Motion)
    ways: dict[str, tuple[Callable[[], object], int]] = {
        "FGLinearization": (theirs, 2),
        "full model, checked step and kinks": (lambda: linearize(airframe, point), 20),
        "short period alone, central differences": (short_period_alone, 50),
    }
    times = interleaved({name: partial(seconds, work, repeat) for name, (work, repeat) in ways.items()}, rounds)
    for name, values in times.items():
        faster = spread(ratios(times["FGLinearization"], values), ".0f")
        print(f"{name:43} {spread([1e3 * v for v in values], '.3f')} ms, {faster} x faster")
    sweep = [
        Query(altitude_ft=h, mach=m) for h in range(5500, 35500, 3000) for m in np.linspace(0.5, 0.95, 10).tolist()
    ]
    taken = seconds(lambda: [linearize_at(f16, query) for query in sweep])
    print(f"{len(sweep)} conditions, each with its own FDM, trimmed and linearized: {taken:.2f} s")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=7)
    main(parser.parse_args().rounds)
