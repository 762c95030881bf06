"""Accuracy of the estimated effectiveness on the nonlinear aircraft: every table of docs/effectiveness.md.

    python tools/tables/effectiveness.py                       # all sections, 20 seeds, 200 random failures
    python tools/tables/effectiveness.py --seeds 3 conditions  # some, smaller

A cell is the median over the seeds, and in brackets the 5th and 95th percentile.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from flightbed import Result, load_scenario, run
from flightbed.analysis.metrics import SETTLING_S, Metrics
from flightbed.parallel.processes import local_processes
from flightbed.scenario.reading import Scenario

RIVALS: dict[str, dict[str, Any]] = {
    "scheduled": {},
    "absolute": {"model": "short-period"},
    "thesis": {"model": "short-period", "input": "deviation"},
    "baseline": {"kind": "differentiated-rls"},
}
THRESHOLDS = (9, 16, 25, 30, 36, 49, 64, 100)
Job = dict[str, Any]


def job(*, mach: float = 0.8, to: float | None = 0.2, seed: int = 0, **more: Any) -> Job:
    """Return the settings that identify a flight; ``to=None`` is a flight without a failure."""
    return {"mach": mach, "to": to, "seed": seed, **more}


def scenario(job: Job) -> Scenario:
    """Return the scenario of a job, on the shipped elevator-loss.

    Keys: mach, to, seed, at_s, adapt (True, False or "oracle"), rivals (names, or a table of estimators), set (overrides).
    """
    rivals = job.get("rivals", ("scheduled",))
    table: Mapping[str, Mapping[str, Any]] = rivals if isinstance(rivals, Mapping) else {r: RIVALS[r] for r in rivals}
    adapt = job.get("adapt", True)
    how = {"enabled": adapt is not False, "oracle": adapt == "oracle"}
    if how["enabled"] and not how["oracle"]:
        how["estimator"] = next(iter(table))
    failures = [] if job["to"] is None else [{"kind": "effectiveness", "at_s": job.get("at_s", 4.5), "to": job["to"]}]
    duration = max(16.5, float(job.get("at_s", 0.0)) + 4.5)
    raw = {
        "schema": 1, "name": "study", "duration_s": round(duration, 2), "seed": job["seed"], "condition": {"mach": job["mach"]},
        "failures": failures, "adaptation": how, "estimators": [{"name": n, **v} for n, v in table.items()],
    }  # fmt: skip
    return load_scenario(raw, job.get("set", ()))


@dataclass(frozen=True)
class Flight:
    """One flight of a job: its metrics, its length in s, and the tracking RMS from the failure and from ``SETTLING_S`` after it, deg/s."""

    metrics: Metrics
    flown_s: float
    since: float
    settled: float


def fly(job: Job) -> Flight:
    """Fly a job."""
    result = run(scenario(job))
    at = job.get("at_s", 4.5)
    return Flight(result.metrics, result.summary.flown_s, _tracked(result, at), _tracked(result, at + SETTLING_S))


def _tracked(result: Result, since_s: float) -> float:
    """Return the tracking RMS from a time on, deg/s, of a flight with or without a failure."""
    t = result.trace
    error = (t["q_deg_s"] - t["q_ref_deg_s"])[t["t_s"] >= since_s - 1e-9]
    return float(np.sqrt(np.mean(error**2))) if error.size else np.nan


def spread(values: Iterable[float | None], spec: str = ".3f") -> str:
    """Return "median (5 % - 95 %)"; an event that did not occur counts as infinite."""
    v = np.array([np.inf if x is None else x for x in values])
    low, middle, high = (float(x) for x in np.quantile(v, [0.05, 0.5, 0.95], method="nearest"))
    return f"{middle:{spec}} ({low:{spec}} - {high:{spec}})"


def _of(flights: Sequence[Flight], key: str, name: str = "scheduled") -> list[float | None]:
    return [getattr(f.metrics.estimators[name], key) for f in flights]


def _print(title: str, head: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    print(f"\n### {title}\n\n| {' | '.join(head)} |\n|{'---|' * len(head)}", flush=True)
    for row in rows:
        print(f"| {' | '.join(row)} |", flush=True)


Fly = Callable[[Sequence[Job]], list[Flight]]

CONDITIONS: tuple[tuple[str, Job], ...] = (
    ("M 0.80, K 0.4", job(to=0.4)),
    ("M 0.80, K 0.2", job(to=0.2)),
    ("M 0.76, K 0.25", job(mach=0.76, to=0.25)),
    ("M 0.84, K 0.35", job(mach=0.84, to=0.35)),
    ("M 0.90, K 0.4", job(mach=0.9, to=0.4)),
    ("M 0.80, K 0.2, level, no command", job(to=0.2, set=("command.kind=none",))),
    ("M 0.80, K 0.3, moderate turbulence", job(to=0.3, set=("atmosphere.turbulence=moderate",))),
)


def _tracking(flights: Sequence[Flight]) -> str:
    lost = sum(f.metrics.departed for f in flights)
    return f"departs, {lost} of {len(flights)}" if lost else spread((f.settled for f in flights), ".2f")


def conditions(fly_all: Fly, seeds: int) -> list[list[Flight]]:
    """Fly the table of the conditions; returns the adaptive flights, row by row."""
    rows, flown = [], []
    for name, base in CONDITIONS:
        jobs = [{**base, "seed": s} for s in range(seeds)]
        adaptive = fly_all([{**j, "rivals": tuple(RIVALS)} for j in jobs])
        others = [
            fly_all([{**j, **how} for j in jobs])
            for how in ({"adapt": False}, {"adapt": False, "to": None}, {"adapt": "oracle"})
        ]
        rows.append([
            name, spread(_of(adaptive, "median_abs_error_post"), ".4f"), spread(_of(adaptive, "rms_error_smoothed_post"), ".4f"),
            spread(_of(adaptive, "first_within_20pct_s"), ".2f"), spread(_of(adaptive, "first_within_20pct_smoothed_s"), ".2f"),
            _tracking(adaptive), *(_tracking(o) for o in others),
        ])  # fmt: skip
        flown.append(adaptive)
    _print(
        f"Conditions, {seeds} seeds",
        ("flight", "median error", "smoothed RMS", "into 20 %, s", "smoothed, s", "tracking, deg/s", "fixed law", "no failure", "oracle"),
        rows,
    )  # fmt: skip
    _print(
        "Rivals on the same flights: median error / smoothed RMS / efficiency, medians",
        ("flight", *RIVALS),
        [
            [name, *(" / ".join(f"{np.median([np.nan if x is None else x for x in _of(flights, k, r)]):.3f}"
             for k in ("median_abs_error_post", "rms_error_smoothed_post", "efficiency")) for r in RIVALS)]
            for (name, _), flights in zip(CONDITIONS, flown, strict=True)
        ],
    )  # fmt: skip
    return flown


def envelope(fly_all: Fly, seeds: int) -> list[list[float]]:
    """Fly Mach 0.72 to 0.84, 10,000 to 30,000 ft, K 0.25 to 0.7; returns medians: errors, ratios of tracking."""
    rows, medians = [], []
    for feet in (10000, 20000, 30000):
        for mach in (0.72, 0.76, 0.8, 0.84):
            where = (f"condition.altitude_ft={feet}",)
            healthy = fly_all([job(mach=mach, to=None, seed=s, adapt=False, set=where) for s in range(seeds)])
            for to in (0.25, 0.45, 0.7):
                jobs = [job(mach=mach, to=to, seed=s, set=where) for s in range(seeds)]
                found, oracle = fly_all(jobs), fly_all([{**j, "adapt": "oracle"} for j in jobs])
                values = [
                    _of(found, "median_abs_error_post"),
                    _of(found, "rms_error_smoothed_post"),
                    _ratio(found, healthy),
                    _ratio(oracle, healthy),
                    _ratio(found, oracle),
                ]
                specs = (".4f", ".4f", ".3f", ".3f", ".3f")
                cells = [spread(v, spec) for v, spec in zip(values, specs, strict=True)]
                rows.append([f"M {mach}, {feet:,} ft, K {to}", *cells])
                medians.append([float(np.median(np.array(v, dtype=float))) for v in values])
    head = (
        "flight",
        "median error",
        "smoothed RMS",
        "tracking / no failure",
        "oracle / no failure",
        "tracking / oracle",
    )
    _print(f"Envelope, {seeds} seeds", head, rows)
    return medians


def _ratio(flights: Sequence[Flight], others: Sequence[Flight]) -> list[float | None]:
    """Return tracking over that of other flights; infinite where one departs."""
    pairs = zip(flights, others, strict=True)
    return [np.inf if f.metrics.departed else float(f.settled / o.settled) for f, o in pairs]


def roc(fly_all: Fly, seeds: int) -> dict[int, float]:
    """Fly no-failure and failure flights with all thresholds side by side; returns false alarms per 10 min in moderate turbulence."""
    table = {f"t{t}": {"alarm_threshold": float(t)} for t in THRESHOLDS}
    rates: dict[int, float] = {}
    for air in ("none", "moderate"):
        sets = (f"atmosphere.turbulence={air}",)
        machs, commands = (0.72, 0.76, 0.8, 0.84), ((), ("command.kind=none",))
        quiet = fly_all([
            job(mach=m, to=None, seed=s, rivals=table, set=(*sets, *c)) for m in machs for c in commands for s in range(2 * seeds)
        ])  # fmt: skip
        at = np.random.default_rng(4).uniform(2.0, 12.0, seeds).round(2)
        hit = {
            to: fly_all([job(to=to, seed=s, at_s=float(at[s]), rivals=table, set=sets) for s in range(seeds)])
            for to in (0.7, 0.4, 0.2)
        }
        minutes = sum(f.flown_s for f in quiet) / 60.0
        rows = []
        for t in THRESHOLDS:
            alarms = sum(f.metrics.estimators[f"t{t}"].false_alarms for f in quiet)
            rate = 10.0 * alarms / minutes
            upper = 10.0 * _poisson_upper(alarms) / minutes
            if air == "moderate":
                rates[t] = rate
            cells = [
                f"{spread(_of(fs, 'detected_at_s', f't{t}'), '.2f')}; {spread(_of(fs, 'first_within_20pct_s', f't{t}'), '.2f')}"
                for fs in hit.values()
            ]
            rows.append([str(t), f"{rate:.2f} (< {upper:.2f})", *cells])
        _print(
            f"Alarms, turbulence {air}: {minutes:.0f} min without a failure (one-sided 95 % limit); "
            f"delay and entry into 20 %, s, {seeds} seeds",
            ("threshold", "false per 10 min", *(f"K {to}" for to in hit)),
            rows,
        )  # fmt: skip
    return rates


def _poisson_upper(count: int) -> float:
    from scipy.stats import chi2

    return float(chi2.ppf(0.95, 2 * (count + 1)) / 2.0)


def honesty(fly_all: Fly, seeds: int) -> dict[str, float]:
    """NEES of K in clean air and in turbulence; returns the medians."""
    rows, found = [], {}
    for air in ("none", "light", "moderate", "severe"):
        cells = []
        for mach, to in ((0.8, 0.4), (0.8, 0.2), (0.76, 0.25), (0.84, 0.35), (0.9, 0.4)):
            flights = fly_all(
                [job(mach=mach, to=to, seed=s, set=(f"atmosphere.turbulence={air}",)) for s in range(seeds)]
            )
            nees = _of(flights, "nees_mean_post")
            found[f"{air} {mach} {to}"] = float(np.median(np.array(nees, dtype=float)))
            cells.append(spread(nees, ".2f"))
        rows.append([air, *cells])
    head = ("turbulence", "M 0.80, K 0.4", "M 0.80, K 0.2", "M 0.76, K 0.25", "M 0.84, K 0.35", "M 0.90, K 0.4")
    _print(f"NEES of K (1: sigma is honest), {seeds} seeds", head, rows)
    return found


ROBUSTNESS: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("nothing", ()),
    ("light turbulence", ("atmosphere.turbulence=light",)),
    ("moderate turbulence", ("atmosphere.turbulence=moderate",)),
    ("severe turbulence", ("atmosphere.turbulence=severe",)),
    ("noise x 5", ("sensors.alpha_std_deg=0.15", "sensors.q_std_deg_s=0.554")),
    ("alpha bias +0.5 deg", ("sensors.alpha_bias_deg=0.5",)),
    ("alpha bias -0.5 deg", ("sensors.alpha_bias_deg=-0.5",)),
    ("gyro bias +0.2 deg/s", ("sensors.q_bias_deg_s=0.2",)),
    ("gyro bias -0.2 deg/s", ("sensors.q_bias_deg_s=-0.2",)),
    ("Mach error +2 %", ("sensors.mach_error=0.02",)),
    ("Mach error -2 %", ("sensors.mach_error=-0.02",)),
    *((f"on-board {c} {100 * (f - 1):+.0f} %", (f"model_error.{c}={f}",)) for c in ("cm_alpha", "cm_q", "cm_delta") for f in (0.8, 1.2)),
    ("2,000 lb less fuel", ("model_error.fuel_lbs=-2000",)),
    ("c.g. 2 % aft", ("model_error.cg_shift_cbar=0.02",)),
    ("c.g. 2 % forward", ("model_error.cg_shift_cbar=-0.02",)),
    ("one tick of delay", ("rates.delay_ticks=1",)),
)  # fmt: skip


def robustness(fly_all: Fly, seeds: int) -> dict[str, tuple[int, int]]:
    """Fly with every error; returns departures (adaptive, oracle)."""
    rows, lost = [], {}
    for name, sets in ROBUSTNESS:
        jobs = [job(to=to, seed=s, set=sets) for to in (0.4, 0.2) for s in range(seeds)]
        adaptive, oracle = fly_all(jobs), fly_all([{**j, "adapt": "oracle"} for j in jobs])
        lost[name] = tuple(sum(f.metrics.departed for f in fs) for fs in (adaptive, oracle))
        rows.append([
            name, spread(_of(adaptive, "median_abs_error_post")), spread(_of(adaptive, "rms_error_smoothed_post")),
            spread(_of(adaptive, "first_within_20pct_s"), ".2f"), spread(_of(adaptive, "false_alarms"), ".0f"),
            _tracking(adaptive), _tracking(oracle), f"{lost[name][0]} / {lost[name][1]}",
        ])  # fmt: skip
    _print(
        f"Robustness, M 0.8, K 0.4 and 0.2, {seeds} seeds each",
        ("error", "median error", "smoothed RMS", "into 20 %, s", "false alarms", "tracking, deg/s", "oracle", "departures / oracle's"),
        rows,
    )  # fmt: skip
    return lost


def _cg(shift_cbar: float) -> tuple[str, ...]:
    return ("failures.1.kind=cg-shift", "failures.1.at_s=4.5", f"failures.1.shift_cbar={shift_cbar}")


DAMAGE: tuple[tuple[str, Job], ...] = (
    *((f"moment {to}, force {force}", job(to=to, set=("failures.0.kind=structural", f"failures.0.force_to={force}")))
      for to in (0.4, 0.2) for force in (to, 0.8, 1.0)),
    *((f"K {to}, c.g. {shift:+.0%}", job(to=to, set=_cg(shift)))
      for to in (0.4, 0.2) for shift in (-0.04, -0.02, 0.01, 0.02, 0.03, 0.04, 0.06, 0.08)),
    *((f"K 1, c.g. {shift:+.0%}", job(to=1.0, set=_cg(shift))) for shift in (-0.03, 0.03, 0.06)),
    *((f"K 0.2, gust {up} ft/s in {rise} s at {at} s",
       job(to=0.2, set=(f"gusts.0.at_s={at}", f"gusts.0.up_fps={up}", f"gusts.0.rise_s={rise}", "gusts.0.hold_s=0.5")))
      for at in (2.0, 6.0) for up, rise in ((10, 0.5), (30, 0.5), (30, 0.1), (-30, 0.1))),
)  # fmt: skip


def damage(fly_all: Fly, seeds: int) -> dict[str, tuple[int, int]]:
    """Fly failures outside the on-board model: structural damage, a c.g. shift, gusts; returns departures (adaptive, oracle)."""
    rows, lost = [], {}
    for name, base in DAMAGE:
        jobs = [{**base, "seed": s} for s in range(seeds)]
        adaptive, oracle = fly_all(jobs), fly_all([{**j, "adapt": "oracle"} for j in jobs])
        lost[name] = (sum(f.metrics.departed for f in adaptive), sum(f.metrics.departed for f in oracle))
        rows.append([
            name, spread(_of(adaptive, "median_abs_error_post")), spread(_of(adaptive, "rms_error_smoothed_post")),
            spread(_of(adaptive, "final")), spread(_of(adaptive, "nees_mean_post"), ".1f"), spread(_of(adaptive, "false_alarms"), ".0f"),
            spread(_of(adaptive, "detected_at_s"), ".2f"), _tracking(adaptive), _tracking(oracle), f"{lost[name][0]} / {lost[name][1]}",
        ])  # fmt: skip
    _print(
        f"Damage and gusts that the model on board does not know of, M 0.8, {seeds} seeds",
        ("flight", "median error", "smoothed RMS", "K-hat at the end", "NEES", "false alarms", "alarm after, s",
         "tracking, deg/s", "oracle", "departures / oracle's"),
        rows,
    )  # fmt: skip
    return lost


def regret(fly_all: Fly, failures: int) -> tuple[Any, int]:
    """Fly random failures against the oracle; returns the regrets and the departures that the oracle does not have."""
    rng = np.random.default_rng(1999)
    jobs = [
        job(mach=float(rng.uniform(0.72, 0.9)), to=float(rng.uniform(0.15, 0.8)), at_s=round(float(rng.uniform(2, 14)), 2), seed=s)
        for s in range(failures)
    ]  # fmt: skip
    adaptive, oracle = fly_all(jobs), fly_all([{**j, "adapt": "oracle"} for j in jobs])
    needless = sum(a.metrics.departed and not o.metrics.departed for a, o in zip(adaptive, oracle, strict=True))
    regrets = np.array(
        [a.since / o.since - 1.0 for a, o in zip(adaptive, oracle, strict=True) if not o.metrics.departed]
    )
    draws = np.random.default_rng(2000).choice(regrets, (2000, len(regrets)))
    rows = []
    for name, share in (("median", 0.5), ("90th percentile", 0.9), ("95th percentile", 0.95), ("worst", 1.0)):
        low, high = np.quantile(np.quantile(draws, share, axis=1), [0.025, 0.975])
        rows.append([name, f"{100 * np.quantile(regrets, share):.1f} %", f"{100 * low:.1f} - {100 * high:.1f} %"])
    rows.append(["departures that the oracle avoids", str(needless), ""])
    title = f"Regret to the oracle, {failures} random failures: tracking RMS from the tick of the failure on"
    _print(title, ("", "regret", "95 % bootstrap interval"), rows)
    return regrets, needless


def main() -> None:
    """Fly the requested sections."""
    sections: dict[str, Callable[[Fly, int], Any]] = {
        "conditions": conditions, "envelope": envelope, "roc": roc, "honesty": honesty, "robustness": robustness, "damage": damage,
        "regret": regret,
    }  # fmt: skip
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("section", nargs="*", help=", ".join(sections), default=[])
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--failures", type=int, default=200, help="of the regret")
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    asked = parser.parse_args()
    if unknown := set(asked.section) - set(sections):
        parser.error(f"no section {', '.join(sorted(unknown))}; there is: {', '.join(sections)}")
    with local_processes(asked.workers) as pool:
        for name in asked.section or sections:
            count = asked.failures if name == "regret" else asked.seeds
            sections[name](lambda jobs: list(pool.map(fly, jobs)), count)


if __name__ == "__main__":
    main()
