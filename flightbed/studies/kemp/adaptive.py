"""Chapter 5: plant F under a law that is designed on the identified model; claims and a table."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from flightbed.control import placement
from flightbed.control.load_factor.integral_placement import augment
from flightbed.document.document import Claim, Section, Table
from flightbed.statistics.intervals import share, spread
from flightbed.studies.base import Part, Trials, keyed_part
from flightbed.studies.judging import above, below, computed, mostly
from flightbed.studies.kemp import plants, printed
from flightbed.studies.kemp.trials import F_SAMPLES, HALF_PERIOD, LOST, Controller, LoopRun, control, reference

ADAPTIVE, PLACED, FIRST, GUARDED = "adaptive", "fixed, placed", "fixed, first", "adaptive, guarded"
REGAINED = 10.0  # a loop is regained if |y| stays below this in the last 50 samples; the reference is 1
NEAR = 3.0  # the output is back when |y - r| is below this: more than four standard deviations of its noise
DIVERGED = 1e3  # |y| of a diverged loop; in case 1 the plant becomes stable again at 250, and the output may return
PATIENCE, LEARNING, LIMIT = 3, 100, 10.0  # of the guarded law: rejected models, samples, |input|
DEADBEAT = 5  # k at which order 2 is identified with enough excitation: six estimates

Results = Mapping[Any, list[Any]]


def placed_gains(case: int) -> tuple[float, ...]:
    """Return the gains (K, K_e), (3,), placed for the true plant F before its changes."""
    A, b = np.zeros((3, 3)), np.zeros(3)
    augment(plants.parameters("F"), A, b)
    return tuple(placement.gains(A, b, (printed.POLE[case],) * 3).tolist())


def controllers(case: int) -> dict[str, Controller]:
    """Return the loops compared in a case, by name; the placed fixed gains have an observer with the model of the first plant."""
    return {
        ADAPTIVE: Controller(),
        PLACED: Controller(
            adaptive=False,
            first=placed_gains(case),
            prior=(0.0, 0.0, *plants.parameters("F").tolist()),
            prior_var=(printed.PRIOR_VAR,) * 2 + (0.0,) * 4,
        ),
        FIRST: Controller(adaptive=False),
        GUARDED: Controller(patience=PATIENCE, limit=LIMIT, learning=LEARNING),
    }


def is_regained(run: LoopRun) -> bool:
    """Return whether a loop is stable at the end of the run."""
    return len(run.output) == F_SAMPLES and bool(np.max(np.abs(run.output[-50:])) < REGAINED)


def loss_phase(run: LoopRun, case: int) -> str | None:
    """Return when a loop was lost: "start", "change" for after the first change, or None for a regained loop."""
    if is_regained(run):
        return None
    before = run.output[: printed.F_CHANGES[case][0]]
    calm = len(before) == printed.F_CHANGES[case][0] and np.max(np.abs(before[-20:])) < REGAINED
    return "change" if calm else "start"


def return_time(run: LoopRun, case: int) -> float:
    """Return the samples from the first change until the output stays near the reference to the next change or the end, or infinity."""
    start, *later = printed.F_CHANGES[case]
    end = later[0] if later else F_SAMPLES
    if len(run.output) < end:
        return float("inf")
    away = np.flatnonzero(np.abs(run.output[start:end] - reference(F_SAMPLES)[start:end]) > NEAR)
    if not away.size:
        return 0.0
    return float(away[-1] + 1) if away[-1] + 1 < end - start else float("inf")


def identified_at(run: LoopRun) -> float:
    """Return the sample from which all parameter errors are below 1e-6 until the first change in case 1; infinite for never."""
    end = printed.F_CHANGES[1][0]
    away = np.flatnonzero(np.max(np.abs(run.estimates[:end] - plants.parameters("F")), axis=1) > 1e-6)
    return float(away[-1] + 1) if away.size and away[-1] + 1 < end else float("inf")


def adaptive(runs: int) -> Part:
    """Simulate all closed loops and judge the claims of chapter 5."""
    jobs: dict[Any, Trials] = {}
    for case in printed.ADAPTIVE:
        for name, controller in controllers(case).items():
            jobs[case, name] = Trials(control, (case, controller), 1 if case == 1 else runs)

    def build(results: Results) -> Section:
        return Section(
            "Adaptive control: chapter 5",
            [
                "Plant F, an F-16-like transfer function from elevator to normal acceleration with its zero moved out to 1.46, is "
                f"identified from zeros in closed loop with fade {printed.FADE:g}; the gains follow by pole placement on the model, all "
                "poles at 0.5 in case 1 and at 0.8 in the other cases. The plant becomes unstable (poles 1.3 and 0.6) at sample 150 or "
                "200, and stable again at 250 in case 1. The thesis gives its reference only as a drawing: here it is alternately 1 and "
                f"0, {HALF_PERIOD} samples each. Case 1 is deterministic and run once; the noisy cases have {runs} draws, the thesis one "
                f"each. A loop is lost beyond |y| = {LOST:g}, or if |y| exceeds {REGAINED:g} in its last 50 samples.",
                "In noise the model of the first few samples may give gains that destabilize a stable plant. The safeguards then keep "
                "these gains: growth along one motion does not improve the model (the data of a loop closed by constant gains do not "
                "identify it), and the gains of poor models have the wrong sign and are rejected. 'Guarded' is our remedy: after "
                f"{PATIENCE} rejected models in succession the first gains are restored, and for {LEARNING} samples the input is limited "
                f"to +-{LIMIT:g}.",
            ],
            [*judge(results), _table(results)],
        )

    return keyed_part(jobs, build)


def judge(results: Results) -> Iterator[Claim]:
    """Judge the claims of chapter 5."""
    yield from _first_case(results)
    for case in (2, 3, 4, 5):
        yield mostly(
            f"stable_{case}", f"The adaptive law regains stability in noise, case {case}.", "share of the draws with a regained loop",
            [is_regained(run) for run in results[case, ADAPTIVE]],
        )  # fmt: skip
    for case in (2, 3, 4, 5):
        yield mostly(
            f"guarded_{case}", f"The guarded law (our addition) regains stability in noise, case {case}.",
            "share of the draws with a regained loop",
            [is_regained(run) for run in results[case, GUARDED]],
        )  # fmt: skip
    for case in (2, 3):
        for name in (PLACED, FIRST):
            yield mostly(
                f"{'placed' if name == PLACED else 'first'}_diverges_{case}",
                f"Fixed gains ({'placed for the first plant' if name == PLACED else 'of the start'}) lose stability, case {case}.",
                "share of the draws with a lost loop", [not is_regained(run) for run in results[case, name]],
            )  # fmt: skip
    for plain, filtered in ((2, 4), (3, 5)):
        for name in (ADAPTIVE, GUARDED):
            pairs = zip(results[plain, name], results[filtered, name], strict=True)
            yield below(
                f"filtered_quicker_{filtered}_{'guarded' if name == GUARDED else 'plain'}",
                f"The loop adapts sooner if the filtered output is integrated: case {filtered} against case {plain}, {name}.",
                f"samples until |y - r| < {NEAR:g} after the change, filtered less measured, draws with both loops regained",
                [_less(return_time(b, filtered), return_time(a, plain)) for a, b in pairs if is_regained(a) and is_regained(b)] or [0.0],
            )  # fmt: skip
    slow, fast = (float(np.linalg.norm(placed_gains(case)[:-1])) for case in (2, 1))
    yield computed(
        "gains_lower", "Poles at 0.8 need significantly lower gains than poles at 0.5.", "|K| at 0.8 over |K| at 0.5", slow / fast,
        holds=slow < 0.5 * fast,
    )  # fmt: skip
    changed = zip(results[2, ADAPTIVE], results[3, ADAPTIVE], strict=True)
    higher = [_higher(run, 2) for pair in changed for run in pair if is_regained(run)]
    yield above(
        "gains_higher_after", "After the change the gains are higher, cases 2 and 3.",
        "median norm of K in the last 50 samples over that in the 50 before the change, draws with a regained loop", higher or [1.0], 1.0,
    )  # fmt: skip


def _less(a: float, b: float) -> float:
    return 0.0 if a == b else a - b


def _higher(run: LoopRun, case: int) -> float:
    change = printed.F_CHANGES[case][0]
    norms = np.linalg.norm(run.gains[:, :-1], axis=1)
    return float(np.median(norms[-50:]) / np.median(norms[change - 50 : change]))


def _first_case(results: Results) -> Iterator[Claim]:
    (run,) = results[1, ADAPTIVE]
    error = (
        float(np.max(np.abs(run.output[-25:] - reference(F_SAMPLES)[-25:]))) if len(run.output) == F_SAMPLES else np.inf
    )
    yield computed(
        "stable_1", "Case 1: the adaptive law remains stable through both changes and follows the reference again.",
        "largest |y - r| in the last 25 samples", error, holds=error < 0.01,
    )  # fmt: skip
    for name, words in ((PLACED, "placed for the first plant"), (FIRST, "of the start")):
        (fixed,) = results[1, name]
        yield computed(
            f"{'placed' if name == PLACED else 'first'}_diverges_1", f"Case 1: with fixed gains ({words}) the loop diverges.",
            "largest |y|",
            float(np.max(np.abs(fixed.output))), holds=bool(np.max(np.abs(fixed.output)) > DIVERGED),
        )  # fmt: skip
    known = identified_at(run)
    yield computed(
        "closed_loop_slower",
        f"Case 1: the excitation by the loop itself is poorer: identification takes longer than the deadbeat k = {DEADBEAT}.",
        "sample from which all parameter errors are below 1e-6", known, holds=known > DEADBEAT,
    )  # fmt: skip


def _outcome(runs: Sequence[LoopRun], case: int, name: str) -> list[Any]:
    change = printed.F_CHANGES[case][0]
    kept = [run for run in runs if is_regained(run)]
    lost = [loss_phase(run, case) for run in runs]
    tail = reference(F_SAMPLES)[-50:]
    return [
        case, name, share(len(kept), len(runs)), lost.count("start"), lost.count("change"),
        spread([float(np.max(np.abs(run.output[:change]))) for run in kept]) if kept else None,
        spread([float(np.max(np.abs(run.output[change:]))) for run in kept]) if kept else None,
        spread([return_time(run, case) for run in kept]) if kept else None,
        spread([float(np.sqrt(np.mean((run.output[-50:] - tail) ** 2))) for run in kept]) if kept else None,
    ]  # fmt: skip


def _table(results: Results) -> Table:
    rows = [_outcome(results[case, name], case, name) for case in printed.ADAPTIVE for name in controllers(case)]
    columns = (
        "case", "law", "regained", "lost at the start", "lost after the change", "largest |y| before", "after the change",
        f"samples to |y - r| < {NEAR:g}", "RMS of y - r at the end",
    )  # fmt: skip
    return Table(
        "adaptive", "Plant F in closed loop", columns, rows,
        {columns[2]: ".3f", columns[5]: ".3g", columns[6]: ".3g", columns[7]: ".0f", columns[8]: ".3g"},
        note="Share with its 95 % interval; the other columns: median [5 %, 95 %] over the draws with a regained loop. In cases 4 and 5 "
        "the integrated error is r less the filter's output.",
    )  # fmt: skip
