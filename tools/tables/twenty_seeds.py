"""The table of the README: each flight over 20 seeds, medians and 5-95 % ranges.

python tools/tables/twenty_seeds.py [--seeds 20]
"""

from __future__ import annotations

import argparse
from collections.abc import Callable

import numpy as np
from cells import likely

from flightbed.analysis.metrics import EstimatorMetrics, Metrics
from flightbed.analysis.result import Result
from flightbed.runs.run import run
from flightbed.scenario.reading import load_scenario

FLIGHTS: dict[str, tuple[str, list[str]]] = {
    "nothing fails": ("nominal", []),
    "K = 0.2, fixed law": ("elevator-loss-fixed", []),
    "K = 0.2, adaptive": ("elevator-loss", []),
    "K = 0.2, adaptive, proportional-integral": ("elevator-loss", ["control.law=proportional-integral"]),
    "K = 0.2, adaptive by the expanding filter": ("elevator-loss", ["adaptation.estimator=expanding"]),
    "K = 0.5, adaptive": ("elevator-loss", ["failures.0.to=0.5"]),
    "K = 0.15, adaptive": ("elevator-loss", ["failures.0.to=0.15"]),
    "K = 0.1, adaptive": ("elevator-loss", ["failures.0.to=0.1"]),
    "K = 0.2, adaptive, light turbulence": ("elevator-loss", ["atmosphere.turbulence=light"]),
    "K = 0.2, adaptive, moderate turbulence": ("elevator-loss", ["atmosphere.turbulence=moderate"]),
    "K = 0.2, adaptive, severe turbulence": ("elevator-loss", ["atmosphere.turbulence=severe"]),
    "K = 0.2, adaptive, straight and level, no command": ("straight-and-level", []),
}


def _share(results: list[Result], inside: Callable[[Result, np.ndarray], np.ndarray]) -> str:
    """Share of the ticks from 0.3 s after the failure (from 0.3 s on without one) for which a condition holds."""
    shares: list[float | None] = []
    for result in results:
        since = result.trace["t_s"] >= (result.summary.failed_at_s or 0.0) + 0.3 - 1e-9
        shares.append(float(np.mean(inside(result, since))))
    return likely(shares, ".2f")


def _in_band(result: Result, since: np.ndarray) -> np.ndarray:
    t = result.trace
    error = np.abs(t["scheduled.effectiveness"] - t["effectiveness_true"])
    inside: np.ndarray = (error <= 0.2 * t["effectiveness_true"])[since]
    return inside


def _covered(result: Result, since: np.ndarray) -> np.ndarray:
    t = result.trace
    error = np.abs(t["scheduled.effectiveness_raw"] - t["effectiveness_true"])
    inside: np.ndarray = (error <= 2.0 * t["scheduled.effectiveness_std"])[since]
    return inside


def main(seeds: int) -> None:
    """Print the table."""
    print(f"{seeds} seeds, 0 to {seeds - 1}; estimator: the 30-sample window; median (5 % - 95 %)")
    for label, (scenario, overrides) in FLIGHTS.items():
        results = [run(load_scenario(scenario, [*overrides, f"seed={seed}"])) for seed in range(seeds)]

        def column(get: Callable[[Metrics], float | None], spec: str, flown: list[Result] = results) -> str:
            return likely([get(r.metrics) for r in flown], spec)

        def window(get: Callable[[EstimatorMetrics], float | None], spec: str, flown: list[Result] = results) -> str:
            return likely([get(r.metrics.estimators["scheduled"]) for r in flown], spec)

        print(f"\n{label}: departed {sum(r.metrics.departed for r in results)} / {seeds}")
        print(f"  departed at, s                  {column(lambda m: m.departed_at_s, '.2f')}")
        print(f"  tracking before, deg/s          {column(lambda m: m.tracking_rms_pre_deg_s, '.2f')}")
        print(f"  tracking after, deg/s           {column(lambda m: m.tracking_rms_post_deg_s, '.2f')}")
        print(f"  median |error| of K             {window(lambda e: e.median_abs_error_post, '.3f')}")
        print(f"  RMS error of smoothed K         {window(lambda e: e.rms_error_smoothed_post, '.3f')}")
        print(f"  first within 20 %, s            {window(lambda e: e.first_within_20pct_s, '.2f')}")
        print(f"  share of time within 20 %       {_share(results, _in_band)}")
        print(f"  share covered by 2 sigma        {_share(results, _covered)}")
        print(f"  mean NIS (2)                    {window(lambda e: e.nis_mean, '.2f')}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=20)
    main(parser.parse_args().seeds)
