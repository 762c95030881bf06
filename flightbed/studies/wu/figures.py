"""Figures 2 to 8 in the paper's order, each from one noise draw (seed 0); Figure 1 is a block diagram."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flightbed.document import drawing
from flightbed.document.document import Picture, Section
from flightbed.studies.base import Part, Results, Trials
from flightbed.studies.wu import printed
from flightbed.studies.wu.measures import EARLY_S, LATE_S, SETTLED_S
from flightbed.studies.wu.simulate import (
    EXTERNAL,
    FORGETTING,
    LEFT,
    VARIABLE,
    Case,
    Law,
    Run,
    aircraft,
    simulate,
    unstable,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SEED = 0
_FILTERS = dict(zip(FORGETTING, (drawing.OTHER, drawing.COMMAND, drawing.ACTUAL), strict=True))
_LAWS = {"fixed": drawing.OTHER, "redesigned": drawing.COMMAND, "offset": drawing.ACTUAL}
_NO_FAILURE = "no failure"


@dataclass(frozen=True)
class Figure:
    """One figure.

    Attributes:
        number: number in the paper.
        title: title without the number.
        parameters: parameters of the runs, as a sentence.
        cases: cases to simulate, by the label of their line.
        rows: number of axes, one above the other.
        draw: draws on the axes and returns computed facts as a sentence.

    """

    number: int
    title: str
    parameters: str
    cases: Mapping[str, Case]
    rows: int
    draw: Callable[[list[Axes], Mapping[str, Run], Sequence[float]], str]


def figures() -> Part:
    """Draw all figures."""
    wanted = list(_figure_list())
    jobs = [Trials(simulate, (case,), 1, SEED) for figure in wanted for case in figure.cases.values()]

    def build(results: Results) -> Section:
        each, pictures = iter(results), []
        for figure in wanted:
            runs = {name: next(each)[0] for name in figure.cases}
            key = f"figure-{figure.number}"
            changes = sorted({change.at_s for case in figure.cases.values() for change in case.changes})
            with drawing.canvas(figure.rows, height=1.9 if figure.rows > 1 else 2.6) as (axes, svg):
                facts = figure.draw(axes, runs, changes)
                for axis in axes:
                    for at_s in changes:
                        drawing.mark(axis, at_s)
                    axis.set_xlim(0.0, printed.DURATION_S)
                drawing.legend(axes[0])
                axes[-1].set_xlabel("time, s")
                drawn = drawing.distinct(svg(), key)
            pictures.append(Picture(key, f"Figure {figure.number}: {figure.title}", drawn, figure.parameters, facts))
        text = (
            f"Every figure of the paper that shows a computation, in the paper's order, from one noise draw (seed {SEED}). Dotted lines "
            "mark changes of effectiveness. The parts (a), (b), (c) that the paper places side by side stand one below the other."
        )
        return Section("Figures", [text], pictures)

    return Part(jobs, build)


def _figure_list() -> Iterator[Figure]:
    external = f"Example 1, external input {EXTERNAL[0]:g}, {EXTERNAL[1]:g} rad, fixed law"
    for number, scenario in ((2, 1), (3, 5)):
        yield Figure(
            number, f"estimates of effectiveness{', d and inputs' if number == 2 else ''}, scenario {scenario}",
            f"{external}; without forgetting, with the constant and with the variable factors.",
            {name: aircraft(scenario, f) for name, f in FORGETTING.items()}, 4 if number == 2 else 2,
            _draw_estimates_and_test if number == 2 else _draw_estimates,
        )  # fmt: skip
    laws = {law.value: law for law in (Law.FIXED, Law.REDESIGNED, Law.OFFSET)}
    yield Figure(
        4, "alpha and theta with and without reconfiguration, scenario 1", f"{external.rpartition(',')[0]}; variable factors.",
        {**{name: aircraft(1, law=law) for name, law in laws.items()}, _NO_FAILURE: aircraft(None)}, 2, _draw_outputs,
    )  # fmt: skip
    lost = f"Example 2, K of the first input {LEFT:g} from {printed.FAILED_AT_S:g} s on; variable factors"
    cases = {name: unstable(LEFT, VARIABLE, law) for name, law in laws.items()}
    fixed, adapted = {"fixed": cases["fixed"]}, {name: cases[name] for name in ("redesigned", "offset")}
    yield Figure(5, "x1 and x3 without reconfiguration", f"{lost}.", fixed, 2, _draw_states)
    yield Figure(
        6, "x1 and x3 with reconfiguration", f"{lost}.", {**adapted, _NO_FAILURE: unstable(None)}, 2, _draw_states
    )
    yield Figure(7, "d of the first input", f"{lost}.", cases, 1, _draw_test)
    yield Figure(8, "estimates of effectiveness", f"{lost}.", cases, 2, _draw_estimates)


def _color(name: str) -> str:
    return {**_FILTERS, **_LAWS, _NO_FAILURE: drawing.REFERENCE}[name]


def _draw_estimates(axes: list[Axes], runs: Mapping[str, Run], changes: Sequence[float]) -> str:
    errors = []
    for name, run in runs.items():
        for i, axis in enumerate(axes[:2]):
            drawing.line(axis, run.t_s, run.estimate[:, i], color=_color(name), label=name)
        after = run.t_s > changes[0] + SETTLED_S
        error = np.sqrt(np.mean((run.estimate - run.effectiveness)[after] ** 2))
        errors.append(f"{name} {error:.3f}")
    names = printed.EXAMPLES[1 if "none" in runs else 2].inputs
    for i, axis in enumerate(axes[:2]):
        run = next(iter(runs.values()))
        axis.step(run.t_s, run.effectiveness[:, i], color=drawing.TRUTH, linewidth=1.4, label="true")
        axis.set_ylim(-0.8, 2.0)
        axis.set_ylabel(f"K, {names[i]}")
    return f"RMS error of K-hat over both inputs from {SETTLED_S:g} s after the first change on: {', '.join(errors)}."


def _draw_estimates_and_test(axes: list[Axes], runs: Mapping[str, Run], changes: Sequence[float]) -> str:
    words = _draw_estimates(axes, runs, changes)
    for name, run in runs.items():
        drawing.line(axes[2], run.t_s, np.maximum(run.statistic[:, 0], 1e-3), color=_color(name))
    axes[2].axhline(printed.THRESHOLD, color=drawing.FAILURE, linestyle="--", linewidth=0.8)
    axes[2].set_yscale("log")
    axes[2].set_ylabel("d, elevon")
    run = runs["variable"]
    for i, (name, style) in enumerate(zip(printed.AIRCRAFT.inputs, ("-", "--"), strict=True)):
        axes[3].plot(run.t_s, run.inputs[:, i], color=_color("variable"), linestyle=style, label=name)
    axes[3].set_ylabel("inputs, rad")
    drawing.legend(axes[3])
    before = run.t_s <= changes[0]
    return (
        f"{words} d of the elevon, variable factors: at most {np.max(run.statistic[before, 0]):.1f} before the change, "
        f"{np.max(run.statistic[~before, 0]):.0f} after the change; the dashed line is the paper's threshold. The inputs are those of the "
        "run with variable factors."
    )


def _draw_outputs(axes: list[Axes], runs: Mapping[str, Run], changes: Sequence[float]) -> str:
    words = []
    after = runs["fixed"].t_s > changes[0] + SETTLED_S
    for name, run in runs.items():
        for axis, column in zip(axes, (1, 3), strict=True):
            drawing.line(axis, run.t_s, run.state[:, column], color=_color(name), label=name)
        if name != _NO_FAILURE:
            off = np.sqrt(np.mean((run.state - runs[_NO_FAILURE].state)[after] ** 2, axis=0))
            words.append(f"{name} {off[1]:.3f} and {off[3]:.3f}")
    for axis, label in zip(axes, ("alpha, rad", "theta, rad"), strict=True):
        axis.set_ylabel(label)
    span = f"from {SETTLED_S:g} s after the change on"
    return f"RMS distance of alpha and theta from the run without failure, {span}, rad: {'; '.join(words)}."


def _draw_states(axes: list[Axes], runs: Mapping[str, Run], _changes: Sequence[float]) -> str:
    words = []
    for name, run in runs.items():
        for axis, column in zip(axes, (0, 2), strict=True):
            drawing.line(axis, run.t_s, run.state[:, column], color=_color(name), label=name)
            axis.set_ylabel(printed.UNSTABLE.states[column])
        late = run.state[run.t_s > printed.DURATION_S - LATE_S][:, [0, 2]]
        words.append(f"{name} {np.sqrt(np.mean(late**2)):.3g}")
    return f"RMS of x1 and x3 over the last {LATE_S:g} s: {', '.join(words)}."


def _draw_test(axes: list[Axes], runs: Mapping[str, Run], changes: Sequence[float]) -> str:
    words = []
    for name, run in runs.items():
        drawing.line(axes[0], run.t_s, np.maximum(run.statistic[:, 0], 1e-3), color=_color(name), label=name)
        soon = (run.t_s > changes[0]) & (run.t_s <= changes[0] + EARLY_S + 1e-9)
        words.append(f"{name} {np.max(run.statistic[soon, 0]):.0f}")
    axes[0].axhline(printed.THRESHOLD, color=drawing.FAILURE, linestyle="--", linewidth=0.8)
    axes[0].set_yscale("log")
    axes[0].set_ylabel("d, first input")
    return f"Largest d within {EARLY_S:g} s of the change: {', '.join(words)}."
