"""Three surfaces, one filter: isolation of the failed surface, error of K, false alarms, comparison with the scheduled filter.

    python tools/tables/surfaces.py [--runs 5] [--workers N]

1. Confusion: flights of `aileron-loss` with one surface losing its effectiveness (to 0.1 ... 0.7 of it), ``runs`` noise draws each;
   found is the surface whose test raises the first alarm after the failure.
2. No failure, calm and turbulent: share of ticks above the threshold, against the rate of the chi-square distribution; flights with
   an alarm.
3. `elevator-loss`, `ramp-loss`, `level-loss`, `transonic-loss` and `turbulent-loss` with two-stage filters beside the scheduled one, which
   flies the aircraft: error, delay, false alarms.
4. Losses that a fixed law does not survive: departures with the law unchanged, corrected and redesigned.
5. Failures of the actuator, which an effectiveness does not describe: the filter's estimates.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import Executor

import numpy as np

from flightbed.analysis.seeds import Flown, Job, fly_jobs, processes
from flightbed.document.document import show
from flightbed.estimation.two_stage.change_test import chi_square_threshold
from flightbed.scenario.reading import load_scenario
from flightbed.scenario.tables import Scenario
from flightbed.statistics.intervals import median_interval, share
from flightbed.studies.estimators.cost import costs_us

SURFACES = ("elevator", "aileron", "rudder")
NAMES = ("two-stage", "two-stage.aileron", "two-stage.rudder")
TO = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7)
FAILED_S = 5.2
RATES = (0.05, 0.01, 1e-3, 1e-6)
VARIABLE = '{name="two-stage", kind="two-stage", memory="variable", window=3}'
RIVALS = {
    "two-stage, variable": VARIABLE,
    "two-stage, constant": '{name="constant", kind="two-stage", memory="fading", forgetting=0.97, window=3}',
    "two-stage, none": '{name="none", kind="two-stage", memory="expanding", window=3}',
}


def _lost(surface: str, to: float, *more: str) -> Scenario:
    failure = f'failures=[{{surface="{surface}", at_s={FAILED_S}, to={to}}}]'
    return load_scenario("aileron-loss", [failure, "duration_s=10", *more])


def _alarms(flown: Flown, since_s: float) -> dict[str, float]:
    """Return the time of the first new alarm of each surface from a time on; infinite without one."""
    t, found = flown.columns["t_s"], {}
    for surface, name in zip(SURFACES, NAMES, strict=True):
        raised = np.flatnonzero((np.diff(flown.columns[f"{name}.alarms"], prepend=0.0) > 0.0) & (t >= since_s - 1e-9))
        found[surface] = float(t[raised[0]]) if raised.size else np.inf
    return found


def confusion(runs: int, executor: Executor | None) -> None:
    """Print the surface found, the delay, and the errors of K."""
    columns = ("t_s", *(f"{n}.{c}" for n in NAMES for c in ("alarms", "effectiveness", "effectiveness_smoothed")))
    cases = [(surface, to) for surface in SURFACES for to in TO]
    flights = fly_jobs([Job(_lost(*case), runs, columns) for case in cases], executor=executor)
    print(f"\n1. One surface loses effectiveness, to one of {TO}: {runs * len(cases)} flights")
    surfaces = " ".join(f"{s:>9}" for s in (*SURFACES, "nothing"))
    print(f"{'lost':>10} | found: {surfaces} | {'delay s':>20} | {'|K error| at 1 s':>22} | largest from 1 s on")
    for surface, name in zip(SURFACES, NAMES, strict=True):
        counted: Counter[str] = Counter()
        delays, at_once, always = [], [], []
        for (lost, to), flown in zip(cases, flights, strict=True):
            for flight in flown if lost == surface else ():
                times = _alarms(flight, FAILED_S)
                first = min(times, key=lambda s: times[s])
                counted[first if np.isfinite(times[first]) else "nothing"] += 1
                delays.append(times[surface] - FAILED_S)
                error = np.abs(flight.columns[f"{name}.effectiveness"] - to)
                k = round((FAILED_S + 1.0) * 100)
                at_once.append(error[min(k, len(error) - 1)])
                always.append(np.max(error[k:], initial=0.0))
        found = " ".join(f"{counted[s]:9d}" for s in (*SURFACES, "nothing"))
        middle = f"{np.median(delays):.2f} (to {np.max(delays):.2f})"
        print(
            f"{surface:>10} |        {found} | {middle:>20} | "
            f"{np.median(at_once):.3f} (95 %: {np.quantile(at_once, 0.95):.3f}) | "
            f"{np.median(always):.3f} (95 %: {np.quantile(always, 0.95):.3f})"
        )


def false_alarms(runs: int, executor: Executor | None) -> None:
    """Print the rate of test statistics above the threshold in flights without a failure, and the rate of alarms."""
    print(
        f"\n2. No failure: {runs} flights of 10 s each; share of ticks from 1 s on whose statistic is above the threshold of a nominal rate"
    )
    columns = tuple(f"{name}.{c}" for name in NAMES for c in ("alarms", "effectiveness_raw", "effectiveness_std"))
    base = load_scenario("aileron-loss", ["duration_s=10", "failures=[]"])
    window, nominal = base.estimators[0].window, base.estimators[0].false_alarm
    head = " ".join(f"{rate:>9g}" for rate in RATES)
    print(f"{'turbulence':>11} {'surface':<9} | nominal: {head} | flights with an alarm at {nominal:g}")
    for turbulence in ("none", "light", "moderate"):
        scenario = load_scenario(
            "aileron-loss", ["duration_s=10", "failures=[]", f"atmosphere.turbulence={turbulence}"]
        )
        flown = fly_jobs([Job(scenario, runs, columns)], executor=executor)[0]
        for surface, name in zip(SURFACES, NAMES, strict=True):
            statistics = []
            for flight in flown:
                terms = (
                    (flight.columns[f"{name}.effectiveness_raw"] - 1.0) / flight.columns[f"{name}.effectiveness_std"]
                ) ** 2
                statistics.append(np.convolve(terms, np.full(window, 1.0 / window), "valid")[100:])
            d = np.concatenate(statistics)
            above = " ".join(f"{np.mean(d > chi_square_threshold(window, rate)):>9.2g}" for rate in RATES)
            with_one = share(sum(bool(f.columns[f"{name}.alarms"][-1] > 0) for f in flown), runs)
            print(f"{turbulence:>11} {surface:<9} |          {above} | {show(with_one, '.2f')}")


def _costs() -> dict[str, float]:
    """Return the time of an update of each estimator, us, called from Python; medians of 9 rounds."""
    costs = {}
    for scenario, surfaces in (("elevator-loss", "elevator"), ("aileron-loss", "three surfaces")):
        added = [f"estimators.1={VARIABLE}"] if scenario == "elevator-loss" else []
        taken = costs_us(load_scenario(scenario, added), 9)
        costs |= {f"{name} ({surfaces})": float(np.median(values)) for name, values in taken.items()}
    return costs


def rivals(runs: int, executor: Executor | None) -> None:
    """Print two-stage filters beside the scheduled one on the scenarios of the elevator."""
    print(f"\n3. On the elevator's scenarios, {runs} flights each; the scheduled filter flies the aircraft")
    print("   An update takes, us: " + ", ".join(f"{name} {cost:.1f}" for name, cost in _costs().items()))
    print(
        f"{'scenario':<16} {'estimator':<22} {'median |K error|':>26} {'detected after s':>20} {'false alarms':>13} {'NIS':>6}"
    )
    for name in ("elevator-loss", "ramp-loss", "level-loss", "transonic-loss", "turbulent-loss"):
        added = [f"estimators.{i + 1}={table}" for i, table in enumerate(RIVALS.values())]
        scenario = load_scenario(name, added)
        flown = fly_jobs([Job(scenario, runs)], executor=executor)[0]
        for settings in scenario.estimators[:4]:
            found = [f.metrics.estimators[settings.name] for f in flown]
            errors = [f.median_abs_error_post for f in found if f.median_abs_error_post is not None]
            delays = [f.detected_at_s for f in found]
            reported = [d for d in delays if d is not None]
            nis = np.mean([f.nis_mean for f in found if f.nis_mean is not None])
            delay = f"{np.median(reported):.2f} ({len(reported)} of {runs})" if reported else f"never ({runs})"
            print(
                f"{name:<16} {settings.name:<22} {show(median_interval(errors), '.4f'):>26} {delay:>20} "
                f"{sum(f.false_alarms for f in found):>13d} {nis:>6.2f}"
            )


def survival(runs: int, executor: Executor | None) -> None:
    """Print departures with three reactions to a loss."""
    print(f"\n4. Departures, {runs} flights each, law lq")
    ways = {
        "as it is": ["adaptation.enabled=false"],
        "divided by K": ["adaptation.method=divide"],
        "designed anew": ["adaptation.method=redesign"],
    }
    losses = [(s, to) for s in SURFACES for to in (0.1, 0.2)]
    for surface, to in losses:
        jobs = [Job(_lost(surface, to, "control.law=lq", "duration_s=16.5", *more), runs) for more in ways.values()]
        counts = [sum(f.metrics.departed for f in flown) for flown in fly_jobs(jobs, executor=executor)]
        departures = ", ".join(f"{way} {count}" for way, count in zip(ways, counts, strict=True))
        print(f"  {surface} to {to}: {departures}")


FAULTS = {
    "stuck": 'kind="stuck"',
    "floating": 'kind="floating"',
    "hardover": 'kind="hardover", side="high"',
    "a tenth of the rate": 'kind="rate-limit", to=0.1',
    "biased by 1 deg": 'kind="bias", bias_deg=1.0',
}


def undescribed(runs: int, executor: Executor | None) -> None:
    """Print the filter's estimates in failures that an effectiveness does not describe."""
    print(
        f"\n5. Failures of the actuator at {FAILED_S} s, {runs} flights each: K-hat of the surface at the end, alarms in how many flights"
    )
    cases = [(surface, fault) for surface in SURFACES for fault in FAULTS]
    jobs = [
        Job(
            load_scenario("aileron-loss", [f'failures=[{{surface="{surface}", at_s={FAILED_S}, {FAULTS[fault]}}}]']),
            runs,
            tuple(f"{name}.{c}" for name in NAMES for c in ("alarms", "effectiveness")),
        )
        for surface, fault in cases
    ]
    for (surface, fault), flown in zip(cases, fly_jobs(jobs, executor=executor), strict=True):
        own = NAMES[SURFACES.index(surface)]
        K = np.median([f.columns[f"{own}.effectiveness"][-1] for f in flown])
        alarms = ", ".join(
            f"{s} {sum(f.columns[f'{n}.alarms'][-1] > 0 for f in flown)}" for s, n in zip(SURFACES, NAMES, strict=True)
        )
        departed = sum(f.metrics.departed for f in flown)
        print(f"  {surface:<9} {fault:<20} K {K:5.2f}; alarms: {alarms}; departed {departed}")


def main(arguments: Sequence[str]) -> None:
    """Run the requested parts."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    asked = parser.parse_args(arguments)
    began = time.perf_counter()
    with processes(asked.workers) as executor:
        confusion(asked.runs, executor)
        false_alarms(asked.runs * 10, executor)
        rivals(asked.runs * 4, executor)
        survival(asked.runs * 2, executor)
        undescribed(asked.runs * 2, executor)
    print(f"\n{time.perf_counter() - began:.0f} s")


if __name__ == "__main__":
    main(sys.argv[1:])
