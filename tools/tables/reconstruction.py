"""Reconstructed elevator and gust: error, K from it, failures that no K explains, effect of noise.

    python tools/tables/reconstruction.py [--runs 100] [--workers N] [--only nearness faults healthy noise gusts costs]

Both methods, retrospective cost and a Kalman filter with the input as a random walk, beside the scheduled filter, which flies the aircraft.

1. Error of the reconstruction against the deflection that acts, and of K against the scheduled filter's, with its own window and one as
   long as their memory; a tenth of ``runs``.
2. Failures of the actuator, at ten times spread over a doublet, ``runs`` flights of each: share recognised, delay, and verdict.
3. Flights in which K explains all: number with a declaration; ``runs`` of the first three, a fifth of ``runs`` of the others.
4. elevator-loss with less and more noise of the sensors; a tenth.
5. Harmonic gusts of several frequencies; a tenth.
6. Microseconds per update.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Sequence
from concurrent.futures import Executor

import numpy as np
from cells import likely

from flightbed.analysis.seeds import Flown, Job, fly_jobs, processes
from flightbed.core.timing import spread
from flightbed.document.document import show
from flightbed.estimation.base import Commanded, SurfacesEstimator
from flightbed.flight.assembly import assemble
from flightbed.flight.loop import fly
from flightbed.flight.plan import plan
from flightbed.scenario.reading import load_scenario
from flightbed.scenario.tables import Scenario
from flightbed.statistics.intervals import median_interval, share

NAMES = ("retrospective", "random-walk")
KINDS = ("retrospective-cost", "input-kalman")
FULLY = 3  # cases of which all ``runs`` are flown
# Stuck also near zero, where no deflection acts: the c.g. is not so far ahead, and the trim nearer to it.
FAULTS: dict[str, tuple[str, tuple[str, ...]]] = {
    "elevator-stuck": ("elevator-stuck", ()),
    "elevator-stuck, c.g. 3 % ahead": ("elevator-stuck", ("aircraft.cg_shift_cbar=-0.03",)),
    "elevator-floating": ("elevator-floating", ()),
    "elevator-hardover": ("elevator-hardover", ()),
    "elevator-bias": ("elevator-bias", ()),
}
LONG = 'estimators.3={name="scheduled-100",kind="loop-gain",window=100}'  # remembers as long as a forgetting of 0.98
TIMES_S = tuple(4.5 + 0.47 * i for i in range(10))  # no multiple of the distance at which windows end, 0.15 s
BEGINNING_TICKS = 30  # for which an error is not yet counted: the reconstruction has to begin
ALL = (
    "t_s", "elevator_acting_deg", "effectiveness_true", "scheduled.effectiveness",
    *(f"{name}.{column}" for name in NAMES for column in ("reconstructed_deg", "effectiveness", "verdict")),
)  # fmt: skip


def _with_both(name: str, *settings: str) -> Scenario:
    if name in [fault for fault, _ in FAULTS.values()]:
        return load_scenario(name, settings)
    added = [
        f'estimators.{1 + i}={{name="{n}", kind="{k}"}}' for i, (n, k) in enumerate(zip(NAMES, KINDS, strict=True))
    ]
    return load_scenario(name, [*added, *settings])


def _errors(flown: Flown, name: str) -> tuple[float, int, float, float]:
    """Return RMS error, deg; the delay, ticks, at which it is smallest, and that RMS; RMS of the acting deflection about its mean."""
    found, acted = (flown.columns[c][BEGINNING_TICKS:] for c in (f"{name}.reconstructed_deg", "elevator_acting_deg"))
    by_delay = [float(np.sqrt(np.mean((found[delay:] - acted[: len(acted) - delay]) ** 2))) for delay in range(15)]
    best = int(np.argmin(by_delay))
    return by_delay[0], best, by_delay[best], float(np.std(acted))


def nearness(runs: int, executor: Executor | None) -> None:
    """Print the errors of the reconstruction and of K."""
    cases = {
        "elevator-loss": (), "level-loss": (), "ramp-loss": (), "transonic-loss": (), "turbulent-loss": (),
        "elevator-bias": (), "elevator-stuck": (),
    }  # fmt: skip
    jobs = [Job(_with_both(name, LONG, *settings), runs, ALL) for name, settings in cases.items()]
    print(
        f"\n1. Error of the reconstruction, deg, and of K from 0.3 s after the loss; {runs} flights, medians (95 % interval);"
        " of K the median error, and the RMS error of the smoothed K, which includes the transient"
    )
    print(
        "| flight | acting deflection, RMS | method | RMS error | smallest, at a delay of ticks | error of K | "
        "scheduled filter | window of 100 |"
    )
    print("|---|---|---|---|---|---|---|---|")
    for name, flights in zip(cases, fly_jobs(jobs, executor=executor), strict=True):
        for estimator in NAMES:
            rms, delays, least, acts = zip(*(_errors(f, estimator) for f in flights), strict=True)
            of_k = []
            for compared in (estimator, "scheduled", "scheduled-100"):
                known = [f.metrics.estimators[compared] for f in flights]
                errors = [e.median_abs_error_post for e in known if e.median_abs_error_post is not None]
                whole = [e.rms_error_smoothed_post for e in known if e.rms_error_smoothed_post is not None]
                of_k.append(f"{show(median_interval(errors), '.4f')}; {np.median(whole):.4f}")
            print(
                f"| {name} | {np.median(acts):.2f} | {estimator} | {show(median_interval(list(rms)), '.3f')} "
                f"| {np.median(least):.3f}, {np.median(delays):.0f} | {' | '.join(of_k)} |"
            )


def _first(flown: Flown, name: str, since_s: float) -> tuple[float, float]:
    """Return the time of the first verdict from a time on, s, infinite without one, and the verdict."""
    verdict, t = flown.columns[f"{name}.verdict"], flown.columns["t_s"]
    raised = np.flatnonzero((verdict > 0.0) & (t >= since_s - 1e-9))
    return (float(t[raised[0]]), float(verdict[raised[0]])) if raised.size else (np.inf, 0.0)


def faults(runs: int, executor: Executor | None) -> None:
    """Print the recognition of actuator failures."""
    each = max(1, runs // len(TIMES_S))
    print(f"\n2. Failures of the actuator at {TIMES_S[0]:g} to {TIMES_S[-1]:g} s; {each * len(TIMES_S)} flights each")
    print(
        "| failure | method | recognised | not position, not command | delay, s: median (5 % - 95 %) | before it | lost | after, s |"
    )
    print("|---|---|---|---|---|---|---|---|")
    cases = [(fault, at_s) for fault in FAULTS for at_s in TIMES_S]
    jobs = [
        Job(_with_both(name, f"failures.0.at_s={at_s}", *settings), each, ALL, first_seed=each * i)
        for name, settings in FAULTS.values()
        for i, at_s in enumerate(TIMES_S)
    ]
    flights = list(zip(cases, fly_jobs(jobs, executor=executor), strict=True))
    for fault in FAULTS:
        flown = [(at_s, f) for (name, at_s), some in flights if name == fault for f in some]
        lost = [f.metrics.departed_at_s - at_s for at_s, f in flown if f.metrics.departed_at_s is not None]
        for estimator in NAMES:
            found = [(_first(f, estimator, at_s), at_s) for at_s, f in flown]
            delays = [first - at_s for (first, _), at_s in found if np.isfinite(first)]
            said = [sum(what == verdict for (_, what), _ in found) for verdict in (1.0, 2.0)]
            early = sum(
                bool(np.any(f.columns[f"{estimator}.verdict"][f.columns["t_s"] < at_s] > 0.0)) for at_s, f in flown
            )
            print(
                f"| {fault} | {estimator} | {len(delays)} of {len(flown)} | {said[0]}, {said[1]} | {likely(delays, '.2f')} "
                f"| {early} | {len(lost)} | {likely(lost, '.2f')} |"
            )


def healthy(runs: int, executor: Executor | None) -> None:
    """Print the number of flights with a declaration although K explains all."""
    print("\n3. K explains all: share of the flights in which something is declared (95 % interval)")
    cases: dict[str, tuple[str, tuple[str, ...]]] = {
        "nothing fails": ("elevator-loss", ("failures=[]",)),
        "..., moderate turbulence": ("elevator-loss", ("failures=[]", "atmosphere.turbulence=moderate")),
        "..., straight and level": ("level-loss", ("failures=[]",)),
        "..., light turbulence": ("elevator-loss", ("failures=[]", "atmosphere.turbulence=light")),
        "..., severe turbulence": ("elevator-loss", ("failures=[]", "atmosphere.turbulence=severe")),
        "elevator-loss": ("elevator-loss", ()),
        "ramp-loss": ("ramp-loss", ()),
        "transonic-loss": ("transonic-loss", ()),
        "structural-damage": ("structural-damage", ()),
        "C_m_delta 10 % off": ("elevator-loss", ("failures=[]", "model_error.cm_delta=1.1")),
        "C_m_alpha 10 % off": ("elevator-loss", ("failures=[]", "model_error.cm_alpha=1.1")),
        "c.g. 1 % of the chord aft of where it is believed": ("elevator-loss", ("failures=[]", "model_error.cg_shift_cbar=0.01")),
        "alpha 0.5 deg off": ("elevator-loss", ("failures=[]", "sensors.alpha_bias_deg=0.5")),
    }  # fmt: skip
    print(f"| flight | of | {' | '.join(NAMES)} |\n|---|---|---|---|")
    counts = [runs if i < FULLY else max(1, runs // 5) for i in range(len(cases))]
    jobs = [
        Job(_with_both(name, *settings), n, ALL) for (name, settings), n in zip(cases.values(), counts, strict=True)
    ]
    for case, flights in zip(cases, fly_jobs(jobs, executor=executor), strict=True):
        declared = [sum(np.isfinite(_first(f, estimator, 0.0)[0]) for f in flights) for estimator in NAMES]
        cells = [show(share(int(n), len(flights)), ".2f") for n in declared]
        print(f"| {case} | {len(flights)} | {' | '.join(cells)} |")


def noise(runs: int, executor: Executor | None) -> None:
    """Print the error over the sensors' noise."""
    print(f"\n4. elevator-loss with other noise of alpha and q; RMS error of the reconstruction, deg; {runs} flights")
    print(f"| noise, times that of the scenario | {' | '.join(NAMES)} |\n|---|---|---|")
    factors = (0.1, 0.3, 1.0, 3.0, 10.0)
    jobs = [
        Job(
            _with_both("elevator-loss", f"sensors.alpha_std_deg={0.03 * x}", f"sensors.q_std_deg_s={0.1108 * x}"),
            runs,
            ALL,
        )
        for x in factors
    ]
    for factor, flights in zip(factors, fly_jobs(jobs, executor=executor), strict=True):
        cells = [show(median_interval([_errors(f, name)[0] for f in flights]), ".3f") for name in NAMES]
        print(f"| {factor:g} | {' | '.join(cells)} |")


def gusts(runs: int, executor: Executor | None) -> None:
    """Print the error of a reconstructed harmonic gust."""
    columns = ("gust_alpha_deg", *(f"{name}.reconstructed_deg" for name in NAMES))
    print(
        f"\n5. harmonic-gust, amplitude 0.72 deg: RMS error, deg, from 3 s after it began, its tick's delay taken off; {runs} flights"
    )
    print(f"| frequency, Hz | {' | '.join(NAMES)} |\n|---|---|---|")
    frequencies = (0.1, 0.3, 0.7, 1.5, 3.0, 6.0)
    jobs = [Job(load_scenario("harmonic-gust", [f"gusts.0.frequency_hz={hz}"]), runs, columns) for hz in frequencies]
    for hz, flights in zip(frequencies, fly_jobs(jobs, executor=executor), strict=True):
        cells = []
        for name in NAMES:
            errors = [
                f.columns[f"{name}.reconstructed_deg"][501:] - f.columns["gust_alpha_deg"][500:-1] for f in flights
            ]
            cells.append(show(median_interval([float(np.sqrt(np.mean(e**2))) for e in errors]), ".3f"))
        print(f"| {hz:g} | {' | '.join(cells)} |")


def costs() -> None:
    """Print the processor time of an update, called from Python."""
    planned = plan(load_scenario("elevator-bias"))
    samples = list(fly(assemble(planned)))
    print("\n6. Microseconds an update, median (lowest to highest) of 9 flights")
    for i, settings in enumerate(planned.scenario.estimators):
        taken = []
        for _ in range(9):
            estimator = assemble(planned).estimators[i]
            assert not isinstance(estimator, SurfacesEstimator)
            hears = estimator.commanded if isinstance(estimator, Commanded) else None
            began = time.thread_time()
            for sample in samples:
                estimator.update(sample.measurement)
                if hears is not None:
                    hears(sample.elevator_cmd_rad)
            taken.append((time.thread_time() - began) / len(samples) * 1e6)
        print(f"   {settings.name}: {spread(taken, '.1f')}")


def main(arguments: Sequence[str]) -> None:
    """Run the requested parts."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=100)
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    sections = {
        "nearness": lambda executor: nearness(max(1, asked.runs // 10), executor),
        "faults": lambda executor: faults(asked.runs, executor),
        "healthy": lambda executor: healthy(asked.runs, executor),
        "noise": lambda executor: noise(max(1, asked.runs // 10), executor),
        "gusts": lambda executor: gusts(max(1, asked.runs // 10), executor),
        "costs": lambda _executor: costs(),
    }
    parser.add_argument("--only", nargs="+", choices=sections, default=list(sections))
    asked = parser.parse_args(arguments)
    began = time.perf_counter()
    with processes(asked.workers) as executor:
        for section in asked.only:
            sections[section](executor)
    print(f"\n{time.perf_counter() - began:.0f} s")


if __name__ == "__main__":
    main(sys.argv[1:])
