"""Tables of both examples: errors of K-hat, responses, and stability margins of the laws."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product
from typing import Any

import numpy as np

from flightbed.control.gain_margin import stability_margin
from flightbed.control.lq import offset_weights, redesign, spectral_radius
from flightbed.document.document import Section, Table
from flightbed.statistics.intervals import spread
from flightbed.studies.base import Part, Trials, keyed_part
from flightbed.studies.wu import printed
from flightbed.studies.wu.measures import (
    EARLY_S,
    LATE_S,
    ON_RAMP_S,
    SETTLED_S,
    RunMeasures,
    early_statistic,
    measure,
    time_to_within_s,
)
from flightbed.studies.wu.simulate import FLOOR, FORGETTING, LEFT, PERIOD_S, VARIABLE, Law, aircraft, model, unstable

LEFT_VALUES = (0.0, 0.1, 0.2, 0.25, 0.3, 0.5)  # K of the first input of example 2 after the failure
ADAPTED = (Law.REDESIGNED, Law.OFFSET)
LAWS = (Law.FIXED, *ADAPTED)
_Runs = Mapping[Any, list[Any]]
_RANGE = "median [5 %, 95 %]"


def accuracy(runs: int) -> Part:
    """Simulate all scenarios with all filters and return the errors of K-hat."""
    jobs = {
        (s, name): Trials(measure, (aircraft(s, forgetting),), runs)
        for s in printed.SCENARIOS
        for name, forgetting in FORGETTING.items()
    }

    def build(found: _Runs) -> Section:
        return Section(
            "Example 1: accuracy",
            [
                "The five scenarios of Table I with a fixed law and a constant external input: without forgetting, with the constant "
                "factor and with the variable factors.",
                "The advantage of the constant factor over none comes from the time after the transient of the change, and from the "
                "canard: from the change on, its error of the elevon's K-hat alone exceeds that without forgetting in most scenarios.",
            ],
            [_glance(found), _by_input(found)],
        )

    return keyed_part(jobs, build)


def _glance(found: _Runs) -> Table:
    rows: list[list[Any]] = []
    for s in printed.SCENARIOS:
        by_filter: list[list[RunMeasures]] = [found[s, name] for name in FORGETTING]
        rows.append([s, *(spread([run.error_settled for run in each]) for each in by_filter)])
    columns = ("scenario", *FORGETTING)
    return Table(
        "accuracy", "RMS error of K-hat, both inputs", columns, rows, dict.fromkeys(FORGETTING, ".3f"),
        note=f"{_RANGE} of {len(found[1, 'none'])} draws; from {SETTLED_S:g} s after the first change to the end.",
    )  # fmt: skip


def _by_input(found: _Runs) -> Table:
    rows: list[list[Any]] = []
    for s, name in product(printed.SCENARIOS, FORGETTING):
        each: list[RunMeasures] = found[s, name]
        rows.append(
            [
                s,
                name,
                spread([run.error for run in each]),
                *(spread([float(run.errors[i]) for run in each]) for i in range(2)),
                *(spread([float(run.errors_settled[i]) for run in each]) for i in range(2)),
                spread([run.ramp for run in each]) if np.isfinite(each[0].ramp) else None,
                spread([run.nis for run in each]),
            ]
        )
    names = printed.AIRCRAFT.inputs
    columns = (
        "scenario",
        "forgetting",
        "both",
        *names,
        *(f"{n}, settled" for n in names),
        "elevon on the ramp",
        "mean NIS",
    )
    return Table(
        "accuracy_by_input", "RMS error of K-hat, input by input", columns, rows, dict.fromkeys(columns[2:8], ".3f") | {"mean NIS": ".2f"},
        note=f"{_RANGE}; from the first change on; settled: from {SETTLED_S:g} s after it on; on the ramp: from {ON_RAMP_S:g} s after its "
        "start. The mean NIS from the change on is 2 for a filter with a correct model: larger where the filter does not follow the "
        "change, smaller where it assumes more noise than acts.",
    )  # fmt: skip


def example_2(runs: int) -> Part:
    """Simulate example 2 with all laws and several losses of the first input."""
    few = max(1, runs // 5)
    jobs: dict[Any, Trials] = {
        (left, law): Trials(measure, (unstable(left, VARIABLE, law),), runs if left == LEFT else few)
        for left, law in product(LEFT_VALUES, LAWS)
    }
    jobs["healthy", Law.FIXED] = Trials(measure, (unstable(None),), runs)

    def build(found: _Runs) -> Section:
        return Section(
            "Example 2: adaptation",
            [
                f"The paper does not specify the loss of the first input; figures and claims use {1 - LEFT:.0%}. The filter has variable "
                "factors.",
                "The loop with the fixed law diverges, and the divergence excites the plant: in the end no other law gives a more "
                "accurate K-hat or a larger d. The law by eqs (47)-(49) uses the weakened input less and so gives less information on "
                "it; with offset weights the law amplifies the command of the input in proportion to its weakness, and d rises fastest. "
                "In this case the paper's account of a more responsive control signal holds. No weight offsets a total loss; there only "
                "eqs (47)-(49) give a settled response. d is at most gamma^2 / alpha_min, because no reading has yet reduced the "
                "variance that forgetting adds.",
            ],
            [_example_2_table(found)],
        )

    return keyed_part(jobs, build)


def _example_2_table(found: _Runs) -> Table:
    rows: list[list[Any]] = []
    for (left, law), each in found.items():
        K = 1.0 if left == "healthy" else float(left)
        runs: list[RunMeasures] = each
        failed = left != "healthy"
        rows.append(
            [
                K,
                law.value,
                closed_loop_radius(K, law),
                spread([run.late for run in runs]),
                spread([run.largest for run in runs]) if failed else None,
                spread([early_statistic(run, PERIOD_S) for run in runs]) if failed else None,
                spread([float(np.max(run.statistic[run.failed :])) for run in runs]) if failed else None,
                spread([run.error_settled for run in runs]) if failed else None,
                len(runs),
            ]
        )
    columns = (
        "K of the first input", "law", "spectral radius", f"RMS of x1, x3, last {LATE_S:g} s", "largest state", f"largest d, {EARLY_S:g} s",
        "largest d", "RMS error of K-hat", "runs",
    )  # fmt: skip
    formats = {
        "spectral radius": ".4f",
        columns[3]: ".3g",
        "largest state": ".3g",
        columns[5]: ".1f",
        "largest d": ".1f",
    }
    return Table(
        "example_2", "Example 2 by remaining effectiveness of the first input", columns, rows, formats | {"RMS error of K-hat": ".3f"},
        note=f"{_RANGE}. Spectral radius: of the loop with state feedback, the law redesigned for the true K, at least {FLOOR:g}. d: "
        f"first input, from the failure on; error: both inputs, from {SETTLED_S:g} s after the failure.",
    )  # fmt: skip


def gain(example: int, K: np.ndarray[Any, np.dtype[np.float64]], law: Law) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return the state feedback gain, (2, n), of a law designed for effectiveness ``K``, (2,), at least ``FLOOR``."""
    A, B, _, Q, R = model(example)
    designed = np.ones(len(K)) if law is Law.FIXED else np.clip(K, FLOOR, 1.0)
    return redesign(A, B, Q, offset_weights(R, designed) if law is Law.OFFSET else R, designed)


def closed_loop_radius(left: float, law: Law) -> float:
    """Return the spectral radius of example 2 with state feedback and effectiveness ``left`` of the first input."""
    A, B, *_ = model(2)
    K = np.array([left, 1.0])
    return spectral_radius(A - B @ (K[:, None] * gain(2, K, law)))


def margins(runs: int) -> Part:
    """Compute the margins of eq (46) for the laws of both examples, and the times at which K-hat of example 2 is within them."""
    jobs = {law: Trials(measure, (unstable(LEFT, VARIABLE, law),), runs) for law in ADAPTED}

    def build(found: Mapping[Law, list[RunMeasures]]) -> Section:
        return Section(
            "Margins",
            [
                "The margin of eq (46) with equal weights: the largest difference between the true gamma of both inputs and the estimate "
                "in the design at which the loop with state feedback is still stable, proved by the mapping theorem. It includes errors "
                "in both directions, although a healthy input can only lose effectiveness.",
                "Example 1 is a stable aircraft with a low-gain law: its margin is limited by more effectiveness than estimated, not by "
                "less. Offset weights make the gain of an input inversely proportional to its remaining effectiveness, and the margin "
                "proportional to it: an error of K-hat of a few hundredths exceeds the margin. The runs of example 2 settle "
                "nevertheless: the margin refers to the worst direction, and the law follows the estimate.",
            ],
            [_margins(), _convergence(found)],
        )

    return keyed_part(jobs, build)


def _convergence(found: Mapping[Law, list[RunMeasures]]) -> Table:
    A, B, *_ = model(2)
    K = np.array([LEFT, 1.0])
    rows: list[list[Any]] = []
    for law, runs in found.items():
        margin = stability_margin(A, B, gain(2, K, law), K - 1.0).smallest
        settled = round(SETTLED_S / PERIOD_S)
        rows.append(
            [
                law.value,
                margin,
                spread([time_to_within_s(run, margin, PERIOD_S) for run in runs]),
                spread([float(np.mean(run.worst[run.failed + settled :] < margin)) for run in runs]),
            ]
        )
    columns = ("law", "margin", "first within, s", "share of the time within")
    return Table(
        "convergence", f"Example 2, K of the first input {LEFT:g}: estimates within the margin", columns, rows,
        {"margin": ".3f", "first within, s": ".1f", columns[-1]: ".2f"},
        note=f"{_RANGE} of {len(next(iter(found.values())))} draws: time after the failure at which both errors of K-hat are first below "
        f"the margin of the law designed for the true K, and share of the time with both below it, from {SETTLED_S:g} s after the failure "
        "on.",
    )  # fmt: skip


def _margins() -> Table:
    healthy = (1.0, 1.0)
    losses: dict[int, Sequence[tuple[float, float]]] = {
        1: (healthy, (0.25, 1.0), (0.1, 0.5)),
        2: (healthy, (0.5, 1.0), (LEFT, 1.0)),
    }
    rows: list[list[Any]] = []
    for example, left in ((e, pair) for e, pairs in losses.items() for pair in pairs):
        for law in ADAPTED:
            if left == healthy and law is Law.OFFSET:
                continue  # the same law
            A, B, *_ = model(example)
            K = np.array(left)
            F = gain(example, K, law)
            found = stability_margin(A, B, F, K - 1.0)
            at = ", ".join(f"{1.0 + g:.3f}" for g in found.gamma)
            only = stability_margin(A, B, F, K - 1.0, weights=np.array([1.0, 0.0]))
            name = "healthy" if left == healthy else law.value
            rows.append([example, f"{left[0]:g}, {left[1]:g}", name, found.largest, found.smallest, at, only.largest])
    columns = ("example", "K as estimated", "law", "margin", "proved", "lost at K", "margin of the first input alone")
    return Table(
        "margins", "Largest error of K-hat with a stable loop", columns, rows,
        {"margin": ".4f", "proved": ".4f", columns[-1]: ".4f"},
        note="Last column: the effectiveness of the second input is known exactly.",
    )  # fmt: skip
