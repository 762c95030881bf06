"""Numbers of both examples: errors of K-hat, responses, and the margins of the laws."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product
from typing import Any

import numpy as np

from flightbed.control.lq import offset_weights, redesign, spectral_radius
from flightbed.control.margin import stability_margin
from flightbed.document import Section, Table
from flightbed.statistics import spread
from flightbed.studies.base import Part, Trials, keyed
from flightbed.studies.wu import printed
from flightbed.studies.wu.measures import EARLY_S, LATE_S, ON_RAMP_S, SETTLED_S, Measured, early, measure, within_s
from flightbed.studies.wu.simulate import FLOOR, FORGETTING, LEFT, PERIOD_S, VARIABLE, Law, aircraft, model, unstable

LEFT_OVER = (0.0, 0.1, 0.2, 0.25, 0.3, 0.5)  # of the first input of example 2
ADAPTED = (Law.REDESIGNED, Law.OFFSET)
LAWS = (Law.FIXED, *ADAPTED)
_Runs = Mapping[Any, list[Any]]
_RANGE = "median [5 %, 95 %]"


def accuracy(runs: int) -> Part:
    """Simulate all scenarios with all filters: how well K is estimated."""
    jobs = {
        (s, name): Trials(measure, (aircraft(s, forgetting),), runs)
        for s in printed.SCENARIOS
        for name, forgetting in FORGETTING.items()
    }

    def build(found: _Runs) -> Section:
        return Section(
            "Example 1: accuracy",
            [
                "The five scenarios of Table I with the law fixed, under a constant external input: without forgetting, with the "
                "constant and with the variable factors.",
                "What the constant factor gains over none it gains once the transient of the change is over, and with the canard: the "
                "elevon alone, from the change on, it estimates worse than none in most scenarios.",
            ],
            [_glance(found), _by_input(found)],
        )

    return keyed(jobs, build)


def _glance(found: _Runs) -> Table:
    rows: list[list[Any]] = []
    for s in printed.SCENARIOS:
        by_filter: list[list[Measured]] = [found[s, name] for name in FORGETTING]
        rows.append([s, *(spread([run.error_settled for run in each]) for each in by_filter)])
    columns = ("scenario", *FORGETTING)
    return Table(
        "accuracy", "RMS error of K-hat, both inputs", columns, rows, dict.fromkeys(FORGETTING, ".3f"),
        note=f"{_RANGE} of {len(found[1, 'none'])} draws; from {SETTLED_S:g} s after the first change to the end.",
    )  # fmt: skip


def _by_input(found: _Runs) -> Table:
    rows: list[list[Any]] = []
    for s, name in product(printed.SCENARIOS, FORGETTING):
        each: list[Measured] = found[s, name]
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
        note=f"{_RANGE}; from the first change on, and, settled, from {SETTLED_S:g} s after it; on the ramp from {ON_RAMP_S:g} s after its "
        "start. NIS, from the change on, is 2 on the average for a filter whose model holds: more where it does not follow, less where "
        "it takes more noise for granted than there is.",
    )  # fmt: skip


def second(runs: int) -> Part:
    """Simulate example 2 with all laws and several losses."""
    few = max(1, runs // 5)
    jobs: dict[Any, Trials] = {
        (left, law): Trials(measure, (unstable(left, VARIABLE, law),), runs if left == LEFT else few)
        for left, law in product(LEFT_OVER, LAWS)
    }
    jobs["healthy", Law.FIXED] = Trials(measure, (unstable(None),), runs)

    def build(found: _Runs) -> Section:
        return Section(
            "Example 2: adaptation",
            [
                f"What of the first input is lost the paper does not say; the figures and claims are of {1 - LEFT:.0%}. The filter has "
                "variable factors.",
                "The fixed law's loop diverges, and in diverging excites itself: in the end nothing estimates K better, or makes d "
                "larger. The law by eqs (47)-(49) relies less on the weakened input and so tells less of it; with offset weights it "
                "commands the input as much more as it is weaker, and d rises fastest. That is where the text's account of a more "
                "responsive control signal holds. A total loss no weight offsets; only eqs (47)-(49) settle that. d is at most gamma^2 "
                "/ alpha_min, because the variance that forgetting adds is in no reading yet.",
            ],
            [_second(found)],
        )

    return keyed(jobs, build)


def _second(found: _Runs) -> Table:
    rows: list[list[Any]] = []
    for (left, law), each in found.items():
        K = 1.0 if left == "healthy" else float(left)
        runs: list[Measured] = each
        failed = left != "healthy"
        rows.append(
            [
                K,
                law.value,
                closed_loop_radius(K, law),
                spread([run.late for run in runs]),
                spread([run.largest for run in runs]) if failed else None,
                spread([early(run, PERIOD_S) for run in runs]) if failed else None,
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
        "example_2", "Example 2 by what is left of the first input", columns, rows, formats | {"RMS error of K-hat": ".3f"},
        note=f"{_RANGE}. Spectral radius: of the loop with the state fed back, the law redesigned for the true K, but for no less than "
        f"{FLOOR:g}. d: of the first input, from the failure on; error: over both, from {SETTLED_S:g} s after it.",
    )  # fmt: skip


def gain(example: int, K: np.ndarray[Any, np.dtype[np.float64]], law: Law) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return the gain of a law that is told the effectiveness."""
    A, B, _, Q, R = model(example)
    told = np.ones(len(K)) if law is Law.FIXED else np.clip(K, FLOOR, 1.0)
    return redesign(A, B, Q, offset_weights(R, told) if law is Law.OFFSET else R, told)


def closed_loop_radius(left: float, law: Law) -> float:
    """Return the spectral radius of example 2, its state fed back, with so much left of the first input."""
    A, B, *_ = model(2)
    K = np.array([left, 1.0])
    return spectral_radius(A - B @ (K[:, None] * gain(2, K, law)))


def margins(runs: int) -> Part:
    """Compute the margins of eq (46) for the laws of both examples, and how soon the estimates of example 2 are within them."""
    jobs = {law: Trials(measure, (unstable(LEFT, VARIABLE, law),), runs) for law in ADAPTED}

    def build(found: Mapping[Law, list[Measured]]) -> Section:
        return Section(
            "Margins",
            [
                "How far the true gamma of both inputs may be from the estimate that the law was designed for before the loop with the "
                "state fed back loses stability: eq (46) with equal weights, proved by the mapping theorem. It counts errors in both "
                "directions, though a healthy input can only lose.",
                "Example 1 is a stable aircraft under a soft law: what ends its margin is more effectiveness than believed, not less. "
                "Offset weights make the gain of an input inversely proportional to what is left of it, and the margin proportional: "
                "an estimate that is off by a few hundredths is beyond it. The runs of example 2 settle all the same: the margin is "
                "that of the worst direction, and the law follows the estimate.",
            ],
            [_margins(), _convergence(found)],
        )

    return keyed(jobs, build)


def _convergence(found: Mapping[Law, list[Measured]]) -> Table:
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
                spread([within_s(run, margin, PERIOD_S) for run in runs]),
                spread([float(np.mean(run.worst[run.failed + settled :] < margin)) for run in runs]),
            ]
        )
    columns = ("law", "margin", "first within, s", "share of the time within")
    return Table(
        "convergence", f"Example 2, K of the first input {LEFT:g}: estimates within the margin", columns, rows,
        {"margin": ".3f", "first within, s": ".1f", columns[-1]: ".2f"},
        note=f"{_RANGE} of {len(next(iter(found.values())))} draws: when after the failure both errors of K-hat first are below the "
        f"margin of the law designed for the true K, and for how much of the time from {SETTLED_S:g} s after it on.",
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
        "margins", "Largest error of K-hat that leaves the loop stable", columns, rows,
        {"margin": ".4f", "proved": ".4f", columns[-1]: ".4f"},
        note="The last column: the second input's effectiveness is known.",
    )  # fmt: skip
