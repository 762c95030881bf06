"""Figures 3.1 to 3.34, 4.1 to 4.4, 5.3 to 5.13 and 7.1 of the thesis, from one draw (seed 0)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from flightbed.document import drawing
from flightbed.document.document import Picture, Section
from flightbed.studies.base import Part, Results, Trials
from flightbed.studies.kemp import methods, plants, printed
from flightbed.studies.kemp.adaptive import FIRST, PLACED, controllers
from flightbed.studies.kemp.methods import PLID, RML
from flightbed.studies.kemp.trials import F_SAMPLES, LoopRun, control, plant_f, reference

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = npt.NDArray[np.float64]

_COLORS = (drawing.ACTUAL, drawing.COMMAND, drawing.REFERENCE, drawing.OTHER, drawing.FAILURE, drawing.TRUTH)
_CLIP = 3.5  # estimates are clipped at this multiple of the largest parameter
_RML_FIGURES = ((29, "A", 1), (30, "A", 2), (31, "C", 3), (32, "A", 5), (33, "A", 6), (34, "C", 7))


@dataclass(frozen=True)
class Figure:
    """One figure of the thesis.

    Attributes:
        number: number in the thesis.
        title: title without the number.
        parameters: parameters of the run, as a sentence.
        trials: the run to simulate.
        draw: draws the result of the run and returns computed facts as sentences.

    """

    number: str
    title: str
    parameters: str
    trials: Trials
    draw: Callable[[Axes, Any], str]


def history(seed: int, plant: str, r: float, q: float, samples: int, method: str) -> tuple[Array, Array]:
    """Return estimated and true parameters at every sample, (samples, 2n) each."""
    record = plants.record(plant, r, q, samples, seed)
    return methods.estimates(methods.make(method, record.theta.shape[1] // 2, r, q), record), record.theta


def figures() -> Part:
    """Draw all figures."""
    wanted = [*_identification_figures(), *_tracking_figures(), *_adaptive_figures()]

    def build(results: Results) -> Section:
        pictures = []
        for figure, (result,) in zip(wanted, results, strict=True):
            key = f"figure-{figure.number}"
            with drawing.canvas(1, height=2.3, margin=0.72) as (axes, svg):
                facts = figure.draw(axes[0], result)
                axes[0].set_xlabel("sample")
                drawing.legend(axes[0])
                drawn = drawing.distinct(svg(), key)
            pictures.append(Picture(key, f"Figure {figure.number}: {figure.title}", drawn, figure.parameters, facts))
        return Section(
            "Figures",
            [
                "Every figure of chapters 3 to 5 and 7 that shows a simulation, from one draw (seed 0); the thesis does not give its own "
                "draws. Thin dashed lines are the true parameters. Two references in the text of the thesis are wrong: 'Figure 3.7' for "
                "high process noise is Figure 3.5, and 'Figure 3.4' for the quickly attained bias is Figure 3.3.",
            ],
            pictures,
        )

    return Part([figure.trials for figure in wanted], build)


def _identification_figures() -> Iterator[Figure]:
    number = 0
    for plant in "ABCD":
        for case, (r, q) in printed.NOISES.items():
            number += 1
            samples = 121 if plant == "B" else printed.SAMPLES + 1
            yield Figure(
                f"3.{number}", f"PLID, plant {plant}, case {case}", f"{printed.NOISE_WORDS[case].capitalize()}: r = {r:g}, q = {q:g}.",
                Trials(history, (plant, r, q, samples, PLID), 1), _draw_identification,
            )  # fmt: skip
    for number, plant, case in _RML_FIGURES:
        r, q = printed.NOISES[case]
        yield Figure(
            f"3.{number}", f"RML, plant {plant}, case {case}", f"{printed.NOISE_WORDS[case].capitalize()}: r = {r:g}, q = {q:g}.",
            Trials(history, (plant, r, q, printed.SAMPLES + 1, RML), 1), _draw_identification,
        )  # fmt: skip


def _tracking_figures() -> Iterator[Figure]:
    for case, (r, q) in printed.E_CASES.items():
        plant = "E stepped" if case == 4 else "E"
        noise = "our choice of the variances, not given in the thesis" if case in (2, 3) else "no noise"
        yield Figure(
            f"4.{case}", f"tracking PLID, plant E, case {case}", f"Fade {printed.FADE:g}; r = {r:g}, q = {q:g}, {noise}.",
            Trials(history, (plant, r, q, printed.E_SAMPLES + 1, methods.BLOCK), 1), _draw_identification,
        )  # fmt: skip
    yield Figure(
        "7.1", "U-D form, plant E", f"Fade {printed.FADE:g}; as Figure 4.4.",
        Trials(history, ("E stepped", 0.0, 0.0, printed.E_SAMPLES + 1, methods.UD_BLOCK), 1), _draw_identification,
    )  # fmt: skip


def _adaptive_figures() -> Iterator[Figure]:
    number = 3
    for case, (r, q, filtered) in printed.ADAPTIVE.items():
        loops, words = (
            controllers(case),
            f"r = {r:g}, q = {q:g}, poles at {printed.POLE[case]:g}{', filtered output' * filtered}.",
        )
        adapted = Trials(control, (case, loops["adaptive"]), 1)

        def draw_parameters(axes: Axes, run: LoopRun, case: int = case) -> str:
            return _draw_parameters(axes, run.estimates, plant_f(case)[: len(run.output)], "sample")

        def draw_output(axes: Axes, run: LoopRun, case: int = case) -> str:
            return _draw_output(axes, run, case)

        yield Figure(f"5.{number}", f"identified parameters, case {case}", words, adapted, draw_parameters)
        yield Figure(f"5.{number + 1}", f"output under adaptive control, case {case}", words, adapted, draw_output)
        number += 2
        if case == 1:
            for letter, name, gains in (("", PLACED, "placed for the first plant"), ("b", FIRST, "of the start")):
                yield Figure(
                    f"5.5{letter}", "output with fixed gains, case 1", f"Gains {gains}; the text of the thesis allows both readings.",
                    Trials(control, (case, loops[name]), 1), draw_output,
                )  # fmt: skip
            number += 1


def _names(count: int) -> list[str]:
    n = count // 2
    return [f"a{i}" for i in range(n)] + [f"b{i}" for i in range(n)]


def _draw_parameters(axes: Axes, found: Array, truth: Array, unit: str) -> str:
    k = np.arange(len(found), dtype=np.float64)
    limit = _CLIP * float(np.max(np.abs(truth)))
    for j, name in enumerate(_names(found.shape[1])):
        drawing.line(axes, k, np.clip(found[:, j], -limit, limit), color=_COLORS[j], label=name)
        axes.plot(k, truth[:, j], color=_COLORS[j], linewidth=0.6, linestyle="--")
    axes.set_ylabel("parameters")
    error = np.max(np.abs(found - truth), axis=1)
    return f"Largest error at the last {unit}: {error[-1]:.2g}."


def _draw_identification(axes: Axes, result: tuple[Array, Array]) -> str:
    found, truth = result
    last = _draw_parameters(axes, found, truth, "sample")
    error = np.max(np.abs(found - truth), axis=1)
    constant = bool(np.all(truth == truth[0]))
    at = (printed.DEADBEAT, 20, 60) if constant else (12, 62, 162)
    return f"Largest error of a parameter {', '.join(f'{error[k]:.2g} at {k}' for k in at)}. {last}"


def _draw_output(axes: Axes, run: LoopRun, case: int) -> str:
    samples = len(run.output)
    k, wanted = np.arange(samples, dtype=np.float64), reference(F_SAMPLES)[:samples]
    bound = 10.0 * np.ones(samples)
    drawing.line(axes, k, np.clip(run.output, -bound, bound), color=drawing.ACTUAL, label="y (frame at +-10)")
    drawing.line(axes, k, wanted, color=drawing.REFERENCE, label="r")
    for at in printed.F_CHANGES[case]:
        if at < samples:
            drawing.mark(axes, float(at))
    axes.set_ylabel("output")
    change = printed.F_CHANGES[case][0]
    if samples <= change:
        return f"Lost at sample {samples}."
    after = float(np.max(np.abs(run.output[change:])))
    end = "" if samples == F_SAMPLES else f" Lost at sample {samples}."
    return f"Largest |y| {np.max(np.abs(run.output[:change])):.2f} before the first change, {after:.3g} after the change.{end}"
