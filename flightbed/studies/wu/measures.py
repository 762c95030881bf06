"""What runs are judged by: errors of K-hat, the test, the response; and what the test's law rests on when nothing fails."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from flightbed.studies.wu import printed
from flightbed.studies.wu.simulate import Case, Run, simulate

Array = npt.NDArray[np.float64]

SETTLED_S = 3.0  # after the first change, from when on estimates are compared
EARLY_S = 3.0  # after the first change, within which the test is compared between laws
ON_RAMP_S = 2.0  # after the ramp's start, from when on the estimate is to follow it
LATE_S = 5.0  # before the end, from when on a response is to be settled
QUIET_S = 2.0  # from when on runs without failure are judged; before, the prior fades


class Measured(NamedTuple):
    """One run in numbers. Errors are those of K-hat, RMS; nan where a case does not have them.

    Attributes:
        error, error_settled: over both inputs, from the first change on and from ``SETTLED_S`` after it.
        errors, errors_settled: (2,), the same of each input.
        ramp: of the first input, on its ramp.
        late: RMS of the outputs that are weighted, over the last seconds.
        largest: largest state, from the first change on.
        before: largest d of either input before the first change, or in the whole run without one.
        statistic: (N,), d of the first input.
        worst: (N,), error of K-hat, of the input whose is larger.
        failed: sample after which the first change acts; N without one.
        nis: mean NIS from then on.

    """

    error: float
    error_settled: float
    errors: Array
    errors_settled: Array
    ramp: float
    late: float
    largest: float
    before: float
    statistic: Array
    worst: Array
    failed: int
    nis: float


def measure(seed: int, case: Case) -> Measured:
    """Simulate a run and measure it."""
    return measured(simulate(seed, case), case)


def measured(run: Run, case: Case) -> Measured:
    """Measure a run."""
    samples = len(run.t_s)
    failed = round(min((c.at_s for c in case.changes), default=printed.DURATION_S) / case.period_s)
    square = (run.estimate - run.effectiveness) ** 2
    settled = failed + round(SETTLED_S / case.period_s)
    outputs = [0, 2] if case.example == 2 else [1, 3]
    late = run.state[samples - round(LATE_S / case.period_s) :, outputs]
    ends = [c.at_s for c in case.changes if c.ramp]
    ramp = np.nan
    if ends:
        begin = failed + round(ON_RAMP_S / case.period_s)
        ramp = float(np.sqrt(np.mean(square[begin : round(ends[0] / case.period_s), 0])))
    after = square[failed:] if failed < samples else np.full((1, 2), np.nan)
    steady = square[settled:] if settled < samples else np.full((1, 2), np.nan)
    return Measured(
        error=float(np.sqrt(np.mean(after))),
        error_settled=float(np.sqrt(np.mean(steady))),
        errors=np.sqrt(np.mean(after, axis=0)),
        errors_settled=np.sqrt(np.mean(steady, axis=0)),
        ramp=ramp,
        late=float(np.sqrt(np.mean(late**2))),
        largest=float(np.max(np.abs(run.state[min(failed, samples - 1) :]))),
        before=float(np.max(run.statistic[:failed])),
        statistic=run.statistic[:, 0],
        worst=np.sqrt(np.max(square, axis=1)),
        failed=failed,
        nis=float(np.mean(run.nis[min(failed, samples - 1) :])),
    )


def delay_s(run: Measured, threshold: float, period_s: float) -> float:
    """Return how long after the first change the test of the first input raises its alarm; infinite if never."""
    above = np.flatnonzero(run.statistic[run.failed :] > threshold)
    return float((above[0] + 1) * period_s) if above.size else np.inf


def within_s(run: Measured, error: float, period_s: float) -> float:
    """Return how long after the first change both errors of K-hat first are below a value; infinite if never."""
    near = np.flatnonzero(run.worst[run.failed :] < error)
    return float((near[0] + 1) * period_s) if near.size else np.inf


def early(run: Measured, period_s: float) -> float:
    """Return the largest d of the first input within ``EARLY_S`` of the first change."""
    return float(np.max(run.statistic[run.failed : run.failed + round(EARLY_S / period_s)]))


class Quiet(NamedTuple):
    """A run without failure, of what the test's law rests on: z = gamma-hat / sqrt(P_ii) of the first input, d of both.

    Attributes:
        last, gamma: z and gamma-hat at the end.
        products: (lags,), mean of z(k) z(k + j), from ``QUIET_S`` on.
        statistic: (N,), d of the first input.
        largest: largest d of either input.
        nis: mean NIS.

    """

    last: float
    gamma: float
    products: Array
    statistic: Array
    largest: float
    nis: float


def quiet(seed: int, case: Case) -> Quiet:
    """Simulate a run without failure and take what the law of the test rests on."""
    run = simulate(seed, replace(case, changes=()))
    begin = round(QUIET_S / case.period_s)
    z = (run.estimate[begin:, 0] - 1.0) / run.deviation[begin:, 0]
    products = np.array([np.mean(z[: len(z) - j] * z[j:]) for j in range(case.window)])
    gamma, largest = float(run.estimate[-1, 0] - 1.0), float(np.max(run.statistic))
    return Quiet(float(z[-1]), gamma, products, run.statistic[:, 0], largest, float(np.mean(run.nis)))


def autocorrelation(runs: Sequence[Quiet]) -> Array:
    """Return rho(1), rho(2), ... of z over runs, about zero, as d takes it."""
    products = np.mean([run.products for run in runs], axis=0)
    return np.asarray(products[1:] / products[0], dtype=np.float64)


class Recovery(NamedTuple):
    """How far the outputs of a run are from those of the run without failure of the same noise: RMS from ``SETTLED_S`` on, (2,)."""

    outputs: Array


def recovery(seed: int, case: Case, columns: tuple[int, int]) -> Recovery:
    """Simulate a run with and without its failure, and compare two states.

    Args:
        seed: of the noise.
        case: with a failure.
        columns: which states.

    """
    run = simulate(seed, case)
    whole = simulate(seed, replace(case, changes=()))
    begin = round((min(c.at_s for c in case.changes) + SETTLED_S) / case.period_s)
    return Recovery(np.sqrt(np.mean((run.state - whole.state)[begin:, columns] ** 2, axis=0)))
