"""Sensitivity of the order of the filters to the choices that the paper leaves open."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from flightbed.document.document import Section, Table
from flightbed.estimation.two_stage.filter import ConstantForgetting, Forgetting, VariableForgetting
from flightbed.statistics.intervals import median_interval
from flightbed.studies.base import Part, Trials, keyed_part
from flightbed.studies.wu import printed
from flightbed.studies.wu.measures import SETTLED_S, RunMeasures, measure
from flightbed.studies.wu.simulate import CONSTANT, EXTERNAL, FORGETTING, PERIOD_S, VARIABLE, Case, aircraft

_Runs = Mapping[Any, list[Any]]


def variants() -> dict[str, tuple[Case, Mapping[str, Forgetting]]]:
    """Return the variants, each with one choice changed, by name: a case of example 1 without scenario, and the filters by name."""
    ours = aircraft(None)
    found: dict[str, tuple[Case, Mapping[str, Forgetting]]] = {"ours": (ours, FORGETTING)}
    for external in ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, -1.0), (5.0, 5.0)):
        found[f"external input {external[0]:g}, {external[1]:g} rad"] = (replace(ours, external=external), FORGETTING)
    for period_s in (0.05, 0.02):
        found[f"period {period_s:g} s"] = (replace(ours, period_s=period_s), FORGETTING)
        found[f"period {period_s:g} s, forgetting per second"] = (
            replace(ours, period_s=period_s),
            _per_second(period_s),
        )
    for factor in (0.98, 0.9, 0.8):
        found[f"lambda {factor:g}"] = (ours, {**FORGETTING, "constant": ConstantForgetting(factor)})
    for low, high in ((0.0001, 1.0), (0.01, 1.0), (0.001, 0.1)):
        found[f"alpha from {low:g} to {high:g}"] = (ours, {**FORGETTING, "variable": VariableForgetting(low, high)})
    found["prior variance of gamma 0.01"] = (replace(ours, prior_variance=0.01), FORGETTING)
    return found


def _per_second(period_s: float) -> dict[str, Forgetting]:
    """Return filters with our forgetting per second at another period, s: lambda to the power of the ratio, alpha_min times the ratio."""
    ratio = period_s / PERIOD_S
    faded = ConstantForgetting(CONSTANT.factor**ratio)
    return {
        **FORGETTING,
        "constant": faded,
        "variable": VariableForgetting(VARIABLE.variance_min * ratio, VARIABLE.variance_max),
    }


def choices(runs: int) -> Part:
    """Simulate all scenarios with ``runs`` draws per variant."""
    jobs: dict[Any, Trials] = {}
    for name, (case, filters) in variants().items():
        for scenario, changes in printed.SCENARIOS.items():
            for which, forgetting in filters.items():
                one = replace(case, changes=changes, forgetting=forgetting)
                jobs[name, scenario, which] = Trials(measure, (one,), runs)

    def build(found: _Runs) -> Section:
        ours = (
            f"period {PERIOD_S:g} s, external input {EXTERNAL[0]:g}, {EXTERNAL[1]:g} rad, lambda {CONSTANT.factor:g}, alpha from "
            f"{VARIABLE.variance_min:g} to {VARIABLE.variance_max:g}, P_0 = {printed.PRIOR_VARIANCE:g} I"
        )
        return Section(
            "Choices",
            [
                "The paper prints no sample period, external input, lambda, alpha_min and alpha_max; it prints the prior as "
                f"{printed.PRIOR_VARIANCE:g} I, but S 2 calls the prior small. Ours: {ours}. Each choice is changed alone.",
                "Variable factors are the best of the three unless alpha_min, which they add at every sample, is large for the period: "
                "0.01 at 0.1 s, 0.001 at 0.02 s. The constant factor is better than none only with a suitable factor, and with inputs "
                "that are neither absent nor far above the noise.",
            ],
            [_table(found, runs)],
        )

    return keyed_part(jobs, build)


def _table(found: _Runs, runs: int) -> Table:
    rows: list[list[Any]] = []
    for name in variants():
        medians = {
            which: float(
                np.median(
                    [np.median([r.error_settled for r in _runs(found, name, s, which)]) for s in printed.SCENARIOS]
                )
            )
            for which in FORGETTING
        }
        orders = [
            _order_counts(found, name, worse, better) for worse, better in (*pairwise(FORGETTING), ("none", "variable"))
        ]
        rows.append([name, *medians.values(), *orders])
    columns = ("choice", *FORGETTING, "constant < none", "variable < constant", "variable < none")
    return Table(
        "choices", "RMS error of K-hat with other choices", columns, rows, dict.fromkeys(FORGETTING, ".3f"),
        note=f"{runs} draws each; median over the scenarios of the median over the draws, both inputs, from {SETTLED_S:g} s after the "
        "first change on. Per second: lambda and alpha_min scaled to the same forgetting per second as ours. Last columns: number of the "
        "five scenarios in which the order holds, and in which the opposite order holds, with 95 % confidence.",
    )  # fmt: skip


def _runs(found: _Runs, name: str, scenario: int, which: str) -> list[RunMeasures]:
    return found[name, scenario, which]


def _median(found: _Runs, name: str, which: str) -> float:
    return float(
        np.median([np.median([r.error_settled for r in _runs(found, name, s, which)]) for s in printed.SCENARIOS])
    )


def _order_counts(found: _Runs, name: str, worse: str, better: str) -> str:
    less = more = 0
    for scenario in printed.SCENARIOS:
        pairs = zip(_runs(found, name, scenario, worse), _runs(found, name, scenario, better), strict=True)
        interval = median_interval([b.error_settled - a.error_settled for a, b in pairs])
        less, more = less + (interval.high < 0.0), more + (interval.low > 0.0)
    return f"{less}, opposite {more}"
