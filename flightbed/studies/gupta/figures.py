"""Figures 2 to 19 in the paper's order; Figure 1 is a block diagram."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from flightbed.document import drawing
from flightbed.document.document import Picture, Section
from flightbed.studies.base import Part, Results, Trials
from flightbed.studies.gupta import printed
from flightbed.studies.gupta.tables import SMALL
from flightbed.studies.gupta.trials import (
    EXAMPLES,
    LAST,
    Array,
    Case,
    History,
    as_printed,
    damping_history,
    forgetful,
    history,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_STATES = {"5": ("A_z, g", "q, rad/s", "fin, rad")}
_MECHANICAL = ("position, m", "velocity, m/s")
_TAIL_SAMPLES = 200  # samples in the lower plot of the input, from the end of the run


@dataclass(frozen=True)
class Figure:
    """One figure.

    Attributes:
        number: number in the paper.
        title: title without the number.
        case: case to run.
        rows: number of axes, one above the other.
        draw: draws a run as printed and the same run with forgetting, and returns computed facts as sentences.
        share_x: whether all axes show the same samples.

    """

    number: int
    title: str
    case: Case
    rows: int
    draw: Callable[[Sequence[Axes], History, History], str]
    share_x: bool = True


def figures() -> Part:
    """Draw all figures, each from one run (seed 0)."""
    wanted = list(_figures())
    jobs = [Trials(history, (case,), 1) for figure in wanted for case in (figure.case, forgetful(figure.case))]

    def build(results: Results) -> Section:
        each, pictures = iter(results), []
        for figure in wanted:
            printed_run, forgetting_run = next(each)[0], next(each)[0]
            key = f"figure-{figure.number}"
            with drawing.canvas(figure.rows, height=1.9 if figure.rows > 1 else 2.6, share_x=figure.share_x) as (
                axes,
                svg,
            ):
                facts = figure.draw(axes, printed_run, forgetting_run)
                axes[-1].set_xlabel("sample")
                drawn = drawing.distinct(svg(), key)
            pictures.append(
                Picture(key, f"Figure {figure.number}: {figure.title}", drawn, _case_words(figure.case), facts)
            )
        return Section(
            "Figures",
            [
                "One run each (seed 0), with the printed settings and with initial states of our choice, which the paper does not print. "
                "A second line, where present, has lambda = 0.99.",
            ],
            pictures,
        )

    return Part(jobs, build)


def _case_words(case: Case) -> str:
    return (
        f"n_c = {case.order}, P(0) = {case.initial_covariance:g} I, eta_0 = {case.regularization:g}, T = {case.period_s:g} s, "
        f"{case.samples} samples."
    )


def _figures() -> Iterator[Figure]:
    three = replace(as_printed("3"), initial_scale=SMALL)
    numbers = {
        "1 rigid body": (2, 3, 4),
        "2 damped rigid body": (5, 6, 7),
        "4 oscillator, c_0 = 4": (11, 12, 13),
        "4 oscillator, c_0 = 10": (14, 15, 16),
        "5 missile": (17, 18, 19),
    }
    for name, (first, second, third) in numbers.items():
        case = EXAMPLES[name]
        yield Figure(first, f"performance and gains, example {name}", case, 2, _draw_performance)
        yield Figure(second, f"input, example {name}", case, 2, _draw_input, share_x=False)
        yield Figure(
            third, f"states, example {name}", case, 3 if case.example == "5" else 2, _states_of(case, case.samples)
        )
        if second == 6:
            words = f"example 3, initial states of about {SMALL:g} m"
            yield Figure(8, f"performance and gains, {words}", three, 2, _draw_performance)
            yield Figure(9, f"states, {words}", three, 2, _states_of(three, three.samples))
            yield Figure(10, f"damping, {words}", three, 1, _draw_damping)


def _draw_performance(axes: Sequence[Axes], run: History, again: History) -> str:
    k = np.arange(len(run.input), dtype=np.float64)
    for made, color, words in ((run, drawing.ACTUAL, "lambda = 1"), (again, drawing.COMMAND, "lambda = 0.99")):
        drawing.line(axes[0], k, np.maximum(np.abs(made.performance), 1e-16), color=color, label=words)
    axes[0].set_yscale("log")
    axes[0].set_ylabel("|z|")
    drawing.legend(axes[0])
    for gain in run.gains.T:
        drawing.line(axes[1], k, gain, linewidth=0.9)
    axes[1].set_ylabel("theta")
    lasts = [_rms(made.performance) for made in (run, again)]
    return f"|z| over the last {LAST} samples: {lasts[0]:.2g} with lambda = 1, {lasts[1]:.2g} with 0.99, RMS."


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values[-LAST:] ** 2)))


def _draw_input(axes: Sequence[Axes], run: History, again: History) -> str:
    total, unit = len(run.input), printed.AMPLITUDE
    k = np.arange(total, dtype=np.float64)
    for axis, span in ((axes[0], slice(0, total)), (axes[1], slice(total - _TAIL_SAMPLES, total))):
        for made, color, words in ((run, drawing.ACTUAL, "u-hat, lambda = 1"), (again, drawing.COMMAND, "0.99")):
            drawing.line(axis, k[span], made.input[span], color=color, label=words)
        drawing.line(axis, k[span], run.signals.input[span], color=drawing.TRUTH, linewidth=0.8, label="u")
        axis.set_ylabel("u")
    axes[0].set_ylim(-3.0 * unit, 3.0 * unit)
    drawing.legend(axes[0])
    parts = []
    for made, words in ((run, "lambda = 1"), (again, "0.99")):
        off, equivalent = (_rms(made.input - truth) / unit for truth in (made.signals.input, made.signals.equivalent))
        parts.append(f"{words}: {off:.2g} of the amplitude, {equivalent:.2g} against the equivalent input")
    peak = float(np.max(np.abs(run.input)))
    return (
        f"Above the whole run, cut at three amplitudes (peak {peak:.3g}); below its end. RMS error: {'; '.join(parts)}."
    )


def _states_of(case: Case, samples: int) -> Callable[[Sequence[Axes], History, History], str]:
    def draw(axes: Sequence[Axes], run: History, _again: History) -> str:
        k, facts = np.arange(samples, dtype=np.float64), []
        for i, (axis, name) in enumerate(zip(axes, _STATES.get(case.example, _MECHANICAL), strict=True)):
            truth, found = run.signals.states[:, i], run.states[:, i]
            drawing.line(axis, k, found, color=drawing.ACTUAL, label="estimate")
            drawing.line(axis, k, truth, color=drawing.TRUTH, linewidth=0.8, label="state")
            room = 0.1 * float(np.ptp(truth)) + 1e-12
            axis.set_ylim(float(np.min(truth)) - room, float(np.max(truth)) + room)
            axis.set_ylabel(name)
            facts.append(f"{name.partition(',')[0]} {_rms(found - truth):.2g}")
        drawing.legend(axes[0])
        return f"RMS error over the last {LAST} samples: {', '.join(facts)}."

    return draw


def _draw_damping(axes: Sequence[Axes], run: History, _again: History) -> str:
    found = damping_history(run, printed.MODEL_DAMPING_3)
    k = np.arange(len(found), dtype=np.float64)
    drawing.line(axes[0], k, found, color=drawing.ACTUAL, label="damping of (54)")
    axes[0].axhline(printed.DAMPING, color=drawing.TRUTH, linewidth=0.8, label="true")
    axes[0].set_ylim(0.0, 2.0 * printed.DAMPING)
    axes[0].set_ylabel("c, N s/m")
    drawing.legend(axes[0])
    return f"Final value {found[-1]:.4f} N s/m."
