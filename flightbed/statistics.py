"""Numbers over many flights: a median with its range, a share with its interval, a paired difference with its interval."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Vector = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Spread:
    """Median and 5th to 95th percentile of the runs that have the value.

    Attributes:
        runs: number of runs.
        missing: runs in which it never happened (None).
        median, low, high: nan if it happened in none.

    """

    runs: int
    missing: int
    median: float
    low: float
    high: float


@dataclass(frozen=True)
class Interval:
    """An estimate with a 95 % confidence interval, over so many runs."""

    estimate: float
    low: float
    high: float
    runs: int


@dataclass(frozen=True)
class Outcome:
    """What came of flights that may end early.

    Attributes:
        stayed: a value of those that flew to the end; missing: those that did not.
        gone_s: when the others ended; missing: those that stayed.

    """

    stayed: Spread
    gone_s: Spread


def outcome(values: Sequence[float | None], gone_s: Sequence[float | None]) -> Outcome:
    """Return the spread of a value over the flights that stayed, and of the time at which the others went."""
    stayed = [None if gone is not None else value for value, gone in zip(values, gone_s, strict=True)]
    return Outcome(spread(stayed), spread(gone_s))


def spread(values: Sequence[float | None]) -> Spread:
    """Return median and 5-95 % range."""
    had = np.array([v for v in values if v is not None and np.isfinite(v)], dtype=np.float64)
    low, median, high = np.percentile(had, [5, 50, 95]).tolist() if had.size else [np.nan] * 3
    return Spread(len(values), len(values) - had.size, median, low, high)


def rank(values: Sequence[float | None], value: float) -> float:
    """Return the share of the runs that lie below a value, ties counted half; those in which it never happened lie above."""
    had = np.array([np.inf if v is None else v for v in values], dtype=np.float64)
    return float(np.mean(had < value) + 0.5 * np.mean(had == value))


def share(successes: int, runs: int) -> Interval:
    """Return a share with its exact binomial interval (Clopper and Pearson 1934)."""
    from scipy.stats import binomtest  # slow to import

    bounds = binomtest(successes, runs).proportion_ci(0.95, method="exact")
    return Interval(successes / runs, float(bounds.low), float(bounds.high), runs)


def median_interval(values: Sequence[float]) -> Interval:
    """Return the median with the interval between order statistics that holds it with at least 95 % (of the sign test).

    Exact for any distribution: the k-th smallest and k-th largest of n values hold the median unless fewer than k of them lie on
    one side of it, a binomial count (Conover, Practical Nonparametric Statistics, S 3.2). Of paired differences it is a test of their
    sign. Fewer than 6 values hold it with less than 95 % whatever they are: the interval is then infinite. Values may be infinite,
    of what never happened.
    """
    from scipy.stats import binom  # slow to import

    data = np.sort(np.asarray(values, dtype=np.float64))
    k = int(binom.ppf(0.025, data.size, 0.5))  # P(count < k) <= 0.025 < P(count <= k)
    low, high = (float(data[k - 1]), float(data[-k])) if k else (-np.inf, np.inf)
    return Interval(float(np.median(data)), low, high, data.size)


def mean_interval(values: Sequence[float], confidence: float = 0.95) -> Interval:
    """Return the mean with the interval of Student's t: a bias is one of the mean. One value has an infinite interval."""
    from scipy.stats import t as student  # slow to import

    data = np.asarray(values, dtype=np.float64)
    mean = float(np.mean(data))
    if data.size < 2:
        return Interval(mean, -np.inf, np.inf, data.size)
    half = float(student.ppf(0.5 + 0.5 * confidence, data.size - 1) * np.std(data, ddof=1) / np.sqrt(data.size))
    return Interval(mean, mean - half, mean + half, data.size)
