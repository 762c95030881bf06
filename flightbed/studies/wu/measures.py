"""Measures of a run: errors of K-hat, the test statistic, the response; and statistics of the test without failure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from flightbed.studies.wu import printed
from flightbed.studies.wu.simulate import Case, Run, simulate

Array = npt.NDArray[np.float64]

SETTLED_S = 3.0  # estimates are compared from this time after the first change on
EARLY_S = 3.0  # the test is compared between laws within this time after the first change
ON_RAMP_S = 2.0  # the error on the ramp is taken from this time after its start on
LATE_S = 5.0  # the response is judged over this time before the end
QUIET_S = 2.0  # runs without failure are judged from this time on, after the transient of the prior


class RunMeasures(NamedTuple):
    """Measures of one run. Errors are RMS errors of K-hat; nan if the case does not define them.

    Attributes:
        error, error_settled: over both inputs, from the first change on and from ``SETTLED_S`` after it.
        errors, errors_settled: (2,), the same per input.
        ramp: error of the first input on its ramp, from ``ON_RAMP_S`` on.
        late: RMS of alpha and theta (example 1), of x1 and x3 (example 2), over the last ``LATE_S``.
        largest: largest magnitude of a state, from the first change on.
        before: largest d of either input before the first change, or in the whole run without a change.
        statistic: (N,), d of the first input.
        worst: (N,), larger of the two errors of K-hat at each sample.
        failed: index of the first sample under the first change; N without a change.
        nis: mean NIS from the first change on.

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


def measure(seed: int, case: Case) -> RunMeasures:
    """Simulate a run and return its measures."""
    return run_measures(simulate(seed, case), case)


def run_measures(run: Run, case: Case) -> RunMeasures:
    """Return the measures of a run."""
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
    return RunMeasures(
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


def delay_s(run: RunMeasures, threshold: float, period_s: float) -> float:
    """Return the delay, s, from the first change to the alarm of the first input; infinite without an alarm."""
    above = np.flatnonzero(run.statistic[run.failed :] > threshold)
    return float((above[0] + 1) * period_s) if above.size else np.inf


def time_to_within_s(run: RunMeasures, error: float, period_s: float) -> float:
    """Return the time, s, from the first change until both errors of K-hat are first below ``error``; infinite if never."""
    near = np.flatnonzero(run.worst[run.failed :] < error)
    return float((near[0] + 1) * period_s) if near.size else np.inf


def early_statistic(run: RunMeasures, period_s: float) -> float:
    """Return the largest d of the first input within ``EARLY_S`` of the first change."""
    return float(np.max(run.statistic[run.failed : run.failed + round(EARLY_S / period_s)]))


class QuietRun(NamedTuple):
    """Statistics of the test in a run without failure: z = gamma-hat / sqrt(P_ii) of the first input, and d.

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


def quiet_run(seed: int, case: Case) -> QuietRun:
    """Simulate a case without its failure and return the statistics of the test."""
    run = simulate(seed, replace(case, changes=()))
    begin = round(QUIET_S / case.period_s)
    z = (run.estimate[begin:, 0] - 1.0) / run.deviation[begin:, 0]
    products = np.array([np.mean(z[: len(z) - j] * z[j:]) for j in range(case.window)])
    gamma, largest = float(run.estimate[-1, 0] - 1.0), float(np.max(run.statistic))
    return QuietRun(float(z[-1]), gamma, products, run.statistic[:, 0], largest, float(np.mean(run.nis)))


def autocorrelation(runs: Sequence[QuietRun]) -> Array:
    """Return the autocorrelation rho(1), rho(2), ... of z over the runs, (lags - 1,), about zero as in d."""
    products = np.mean([run.products for run in runs], axis=0)
    return np.asarray(products[1:] / products[0], dtype=np.float64)


class Recovery(NamedTuple):
    """RMS difference of two states, (2,), between a run and the run without failure with the same noise, from ``SETTLED_S`` on."""

    outputs: Array


def recovery(seed: int, case: Case, columns: tuple[int, int]) -> Recovery:
    """Simulate a run with and without its failure and compare two states.

    Args:
        seed: seed of the noise.
        case: case with a failure.
        columns: indices of the two states.

    """
    run = simulate(seed, case)
    whole = simulate(seed, replace(case, changes=()))
    begin = round((min(c.at_s for c in case.changes) + SETTLED_S) / case.period_s)
    return Recovery(np.sqrt(np.mean((run.state - whole.state)[begin:, columns] ** 2, axis=0)))
