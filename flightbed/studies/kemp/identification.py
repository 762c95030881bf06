"""Chapters 2 and 3: identification of plants A to D in seven noise cases by PLID and recursive maximum likelihood; claims and tables."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import product
from typing import Any

import numpy as np

from flightbed.document.document import Claim, Section, Table
from flightbed.statistics.intervals import Interval, median_interval, spread, student_interval
from flightbed.studies.base import Part, Trials, keyed_part
from flightbed.studies.judging import above, below, between, beyond, computed, mostly
from flightbed.studies.kemp import plants, printed
from flightbed.studies.kemp.methods import PLID, RLS, RML, UD
from flightbed.studies.kemp.trials import IdentificationRun, deadbeat, identify

EARLY, FIGURE_END = 60, printed.SAMPLES
LONG, VERY_LONG = 5000, 20000
STABLE, UNSTABLE = ("A", "C"), ("B", "D")
MARKS = {
    "A": (7, 8, EARLY, FIGURE_END, LONG),
    "B": (7, 8, EARLY, printed.B_LOST, 120),
    "C": (7, 8, EARLY, FIGURE_END, LONG),
    "D": (7, 8, EARLY, FIGURE_END),
}
TOLERATED = 0.02  # a bias below this share of the largest parameter counts as zero
# "Acceptable bounds" of a bias, as a share of the largest parameter; the thesis gives no number.
ACCEPTABLE = 0.05
EXACT = 1e-3  # error below the resolution of a figure; with some inputs the plain form has no more digits
BETTER = 0.05  # a method is more accurate if its error is lower by at least this share
ORDERS, IDLE = (2, 3, 4, 5), (0, 6)

Runs = Sequence[IdentificationRun]
Results = Mapping[Any, list[Any]]


def _error(run: IdentificationRun, plant: str, mark: int) -> float:
    """Return the norm of the parameter errors at a mark."""
    return float(np.linalg.norm(run.errors[MARKS[plant].index(mark)]))


def bias(runs: Runs, index: int) -> Interval:
    """Return the bias of the parameter with the largest bias, with a Bonferroni interval: 95 % jointly for all parameters.

    Args:
        runs: runs of one plant, case and method.
        index: index of the mark.

    """
    errors = np.array([run.errors[index] for run in runs])
    count = errors.shape[1]
    intervals = [student_interval(errors[:, j].tolist(), 1.0 - 0.05 / count) for j in range(count)]
    return max(intervals, key=lambda i: abs(i.estimate))


def relative_bias(runs: Runs, plant: str, mark: int) -> Interval:
    """Return the bias at a mark, as a share of the plant's largest parameter."""
    found, largest = bias(runs, MARKS[plant].index(mark)), float(np.max(np.abs(plants.parameters(plant))))
    return Interval(found.estimate / largest, found.low / largest, found.high / largest, found.runs)


def identification(runs: int) -> Part:
    """Identify all plants in all noise cases and judge the claims of chapters 2 and 3."""
    jobs: dict[Any, Trials] = {}
    for plant, case in product(MARKS, printed.NOISES):
        for method in (PLID, UD, RML, RLS) if plant in STABLE else (PLID, UD):
            jobs[plant, case, method] = Trials(identify, (plant, case, method, MARKS[plant]), runs)
    jobs["long"] = Trials(identify, ("A", 3, RML, (FIGURE_END, VERY_LONG)), runs)
    jobs.update({(n, idle): Trials(deadbeat, (n, idle), runs) for n, idle in product(ORDERS, IDLE)})

    def build(results: Results) -> Section:
        return Section(
            "Identification: chapters 2 and 3",
            [
                f"Plants A to D of order 3 from rest, white input of variance 1, {runs} draws of input and noises for each of the seven "
                f"cases. All identifiers start from zeros with P = {printed.PRIOR_VAR:g} I and know the variances of the noises. The "
                f"thesis shows one draw of each case to sample {FIGURE_END}; here the stable plants continue to sample {LONG}, to separate "
                "bias from slow convergence. The bias is the mean error of the parameter with the largest mean error, as a share of the "
                f"plant's largest parameter; up to {TOLERATED:.0%} counts as zero.",
                "With r = 0 the filter is the exact conditional mean, because y in F is then known: a bias must vanish. The process "
                "noises w_i, independent and white, reach y with different delays: their sum in the difference equation of y is white "
                "with variance 3q, not coloured. So plain least squares (RLS, here RML with C = 1) is unbiased under process noise too, "
                "and PLID has an advantage in process noise over RML only.",
            ],
            [*judge(results), _table(results), _deadbeat_table(results)],
        )

    return keyed_part(jobs, build)


def judge(results: Results) -> Iterator[Claim]:
    """Judge the claims of chapters 2 and 3."""
    yield from _deadbeat(results)
    yield from _biases(results)
    yield from _unstable(results)
    yield from _against_rml(results)


def _deadbeat(results: Results) -> Iterator[Claim]:
    for plant in MARKS:
        runs = results[plant, 1, PLID]
        yield mostly(
            f"deadbeat_{plant}",
            f"Without noise plant {plant} is identified at k = {printed.DEADBEAT}, not earlier.",
            f"share of the inputs for which all parameters are within {EXACT:g} of the true ones at k = 8 but not at k = 7",
            [float(np.max(np.abs(r.errors[1]))) < EXACT < float(np.max(np.abs(r.errors[0]))) for r in runs],
        )
    for n, idle in product(ORDERS, IDLE):
        words = f"whose input begins {idle} samples late" if idle else "excited from the start"
        yield mostly(
            f"observable_{n}_{idle}",
            f"Estimates of a plant of order {n} {words} converge exactly at the sample at which the extended state becomes observable, "
            "(2.26).",
            "share of random minimal plants with convergence at that sample",
            [r.found == r.observable for r in results[n, idle]],
        )


def _biases(results: Results) -> Iterator[Claim]:
    for plant in STABLE:
        got = relative_bias(results[plant, 3, PLID], plant, LONG)
        yield beyond(
            f"measurement_bias_{plant}", f"Measurement noise (case 3) biases PLID, plant {plant}.",
            f"bias at sample {LONG}, over the largest parameter", got, TOLERATED,
        )  # fmt: skip
        yield between(
            f"bias_acceptable_{plant}",
            f"... but within acceptable bounds, here {ACCEPTABLE:.0%} of the largest parameter, plant {plant}.",
            f"bias at sample {LONG}, over the largest parameter", got, -ACCEPTABLE, ACCEPTABLE,
        )  # fmt: skip
        yield _paired_claim(
            below, f"bias_grows_{plant}", f"The bias grows with the measurement noise: case 2 against case 3, plant {plant}.",
            "less in case 2", results, plant, LONG, (2, PLID), (3, PLID),
        )  # fmt: skip
        yield _paired_claim(
            below, f"mixed_no_more_{plant}",
            f"Additional process noise does not increase the bias: case 7 against case 3, plant {plant}.",
            "case 7 less case 3", results, plant, LONG, (7, PLID), (3, PLID),
        )  # fmt: skip
        for case in (4, 5):
            yield between(
                f"process_unbiased_{plant}_{case}", f"Process noise (case {case}) does not bias PLID, plant {plant}.",
                f"bias at sample {LONG}, over the largest parameter",
                relative_bias(results[plant, case, PLID], plant, LONG), -TOLERATED, TOLERATED,
            )  # fmt: skip
        slower = zip(results[plant, 5, PLID], results[plant, 3, PLID], strict=True)
        yield above(
            f"process_slower_{plant}",
            f"High process noise delays the convergence of PLID more than measurement noise, plant {plant}.",
            "sample from which the estimate stays near its value at sample 150, case 5 less case 3",
            [float(a.settled - b.settled) for a, b in slower],
        )


def _unstable(results: Results) -> Iterator[Claim]:
    noisy = [case for case in printed.NOISES if case > 1]
    outputs = [r.largest_output[3] for case in printed.NOISES for r in results["B", case, PLID]]
    yield above(
        "b_output", f"Plant B's output exceeds 1e20 by sample {printed.B_LOST}.", "log10 |y(90)|",
        [float(np.log10(y)) for y in outputs], float(np.log10(printed.B_OUTPUT)),
    )  # fmt: skip
    growth = np.max(np.abs(np.roots(printed.TRANSFER_FUNCTIONS["B"][0])))
    yield computed(
        "b_growth", "... as expected from the growth of the plant alone.",
        "log10 of the 90-th power of the plant's largest pole", float(90.0 * np.log10(growth)),
        holds=bool(90.0 * np.log10(growth) > 19.0),
    )  # fmt: skip
    yield mostly(
        "b_diverges", "In noise the estimates of plant B eventually diverge by round-off (by sample 120).",
        "share of the runs of cases 2 to 7 with an error of a parameter above 1",
        [bool(np.max(np.abs(r.errors[4])) > 1.0) for case in noisy for r in results["B", case, PLID]],
    )  # fmt: skip
    yield below(
        "d_output", "Plant D's output does not rise much above 1e15 out to sample 150.", "log10 |y(150)|",
        [float(np.log10(r.largest_output[3])) for case in printed.NOISES for r in results["D", case, PLID]],
        float(np.log10(printed.D_OUTPUT)) + 1.0,
    )  # fmt: skip
    for method in (PLID, UD):
        yield mostly(
            f"d_keeps_{method}", f"Plant D's estimates do not diverge out to sample 150, {method}.",
            "share of the runs of all cases without an error of a parameter above 1",
            [bool(np.max(np.abs(r.errors[3])) < 1.0) for case in printed.NOISES for r in results["D", case, method]],
        )  # fmt: skip
    for case in (3, 5):
        pairs = zip(results["D", case, UD], results["A", case, UD], strict=True)
        yield below(
            f"d_faster_{case}", f"Convergence for plant D is faster than for plant A, case {case}.",
            f"|error| at sample {EARLY}, D less A, U-D form",
            [_error(d, "D", EARLY) - _error(a, "A", EARLY) for d, a in pairs],
        )  # fmt: skip


def _paired_claim(
    judge: Callable[..., Claim], key: str, text: str, words: str, results: Results, plant: str, mark: int,
    one: tuple[int, str], other: tuple[int, str], limit: float = 0.0,
) -> Claim:  # fmt: skip
    pairs = zip(results[plant, *one], results[plant, *other], strict=True)
    values = [_error(a, plant, mark) - _error(b, plant, mark) for a, b in pairs]
    return judge(key, text, f"|error| at sample {mark}, {words}", values, limit)


def _against_rml(results: Results) -> Iterator[Claim]:
    yield _paired_claim(
        above, "rml_slow", "Without noise RML converges slowly, plant A.", "RML less PLID", results, "A", FIGURE_END, (1, RML),
        (1, PLID), 1e-3,
    )  # fmt: skip
    for plant, case in product(STABLE, (3, 5)):
        yield _paired_claim(
            above, f"rml_slower_{plant}_{case}", f"PLID converges faster than RML, plant {plant}, case {case}.", "RML less PLID",
            results, plant, EARLY, (case, RML), (case, PLID),
        )  # fmt: skip
    yield between(
        "rml_measurement_C", "RML is unbiased in measurement noise, plant C (Fig. 3.31).", f"bias at sample {LONG}",
        relative_bias(results["C", 3, RML], "C", LONG), -TOLERATED, TOLERATED,
    )  # fmt: skip
    yield beyond(
        "rml_measurement_A", "RML appears biased in measurement noise, plant A, within the figure's 150 samples (Fig. 3.30).",
        f"bias at sample {FIGURE_END}", relative_bias(results["A", 3, RML], "A", FIGURE_END), TOLERATED,
    )  # fmt: skip
    late = bias(results["long"], 1)
    largest = float(np.max(np.abs(plants.parameters("A"))))
    yield between(
        "rml_measurement_A_late", "... which vanishes eventually.", f"bias at sample {VERY_LONG}",
        Interval(late.estimate / largest, late.low / largest, late.high / largest, late.runs), -TOLERATED, TOLERATED,
    )  # fmt: skip
    yield below(
        "rml_measurement_A_falls", "... or falls at least to half of its value at sample 150.",
        f"|error| at sample {VERY_LONG} relative to sample {FIGURE_END}",
        [float(np.linalg.norm(r.errors[1]) / np.linalg.norm(r.errors[0])) for r in results["long"]], 0.5,
    )  # fmt: skip
    for mark in (FIGURE_END, LONG):
        yield beyond(
            f"rml_process_A_{mark}", "High process noise biases RML, plant A (Fig. 3.32).", f"bias at sample {mark}",
            relative_bias(results["A", 5, RML], "A", mark), TOLERATED,
        )  # fmt: skip
    yield below(
        "rml_process_A_stays", "... permanently: the error does not decrease further.",
        f"relative decrease of the error from sample {FIGURE_END} to sample {LONG}",
        [1.0 - _error(r, "A", LONG) / _error(r, "A", FIGURE_END) for r in results["A", 5, RML]], 0.1,
    )  # fmt: skip
    for plant in STABLE:
        yield beyond(
            f"rls_process_{plant}", f"High process noise biases other popular methods: least squares, plant {plant}.",
            f"bias at sample {LONG}", relative_bias(results[plant, 5, RLS], plant, LONG), TOLERATED,
        )  # fmt: skip
        pairs = zip(results[plant, 5, PLID], results[plant, 5, RLS], strict=True)
        yield above(
            f"plid_beats_rls_{plant}",
            f"In high process noise PLID is more accurate than least squares, by at least {BETTER:.0%}, plant {plant}.",
            f"relative reduction of the error from least squares to PLID at sample {FIGURE_END}",
            [1.0 - _error(a, plant, FIGURE_END) / _error(b, plant, FIGURE_END) for a, b in pairs], BETTER,
        )  # fmt: skip
    yield _paired_claim(
        below, "rml_mixed_A", "RML is more accurate with measurement noise beside the process noise: case 6 against case 5, plant A.",
        "case 6 less case 5", results, "A", FIGURE_END, (6, RML), (5, RML),
    )  # fmt: skip
    for plant in STABLE:
        yield mostly(
            f"rml_stays_stable_{plant}",
            f"Lower prior variances of c keep C(z) stable without projection, plant {plant}, cases 2 to 7.",
            f"share of the runs to sample {LONG} without projection",
            [not r.left_stability for case in printed.NOISES if case > 1 for r in results[plant, case, RML]],
        )  # fmt: skip


def _table(results: Results) -> Table:
    rows: list[list[Any]] = []
    for plant, case in product(MARKS, printed.NOISES):
        marks, compared = ((FIGURE_END, LONG), (PLID, UD, RML, RLS)) if plant in STABLE else ((EARLY,), (PLID, UD))
        for method in compared:
            runs = results[plant, case, method]
            cells: list[Any] = [plant, f"{case}: {printed.NOISE_WORDS[case]}", method]
            cells += [
                median_interval([_error(r, plant, mark) for r in runs]) if mark in (EARLY, *marks) else None
                for mark in (EARLY, FIGURE_END, LONG)
            ]
            cells.append(relative_bias(runs, plant, marks[-1]))
            cells.append(spread([float(r.settled) for r in runs]) if plant in STABLE else None)
            rows.append(cells)
    columns = (
        "plant", "case", "method", f"|error| at {EARLY}", f"at {FIGURE_END}", f"at {LONG}", "bias, last of these",
        "near its value at 150 from sample",
    )  # fmt: skip
    return Table(
        "identification", "Plants A to D in seven noise cases", columns, rows,
        {**dict.fromkeys(columns[3:6], ".3g"), columns[6]: ".2%", columns[7]: ".0f"},
        note="|error| is the norm over the six parameters, median with its 95 % interval. Bias: of the parameter with the largest bias, "
        f"as a share of the plant's largest parameter. Plants B and D are unstable; their bias is taken at sample {EARLY}.",
    )  # fmt: skip


def _deadbeat_table(results: Results) -> Table:
    rows: list[list[Any]] = []
    for n, idle in product(ORDERS, IDLE):
        runs, predicted = results[n, idle], idle + 3 * n - min(idle + 1, n)
        rows.append([n, idle, predicted, spread([float(r.found) for r in runs]), max(r.error for r in runs)])
    return Table(
        "deadbeat", "Random minimal plants without noise: sample at which all parameters are identified",
        ("order", "input begins at", "predicted", "found", "largest error there"), rows,
        {"found": ".0f", "largest error there": ".0e"},
        note="Predicted from the rank of (2.26): before the input begins, at most n samples raise the rank, by observing the state only; "
        "afterwards each sample raises the rank by one; 3n - 1 if the input begins at once, counted from k = 0. U-D form.",
    )  # fmt: skip
