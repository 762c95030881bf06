"""Numbers over many flights: a median with its range, a share with its interval, a paired difference with its interval."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Vector = npt.NDArray[np.float64]

_RESAMPLES = 2000
_SEED = 19990305  # of the bootstrap: the same data give the same interval


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
    """Return the median with its bootstrap percentile interval; of paired differences it is a test of their sign.

    Values may be infinite, of what never happened; an end of the interval that falls between a finite and an infinite median is infinite.
    """
    data = np.asarray(values, dtype=np.float64)
    rng = np.random.default_rng(_SEED)
    medians = np.median(rng.choice(data, size=(_RESAMPLES, data.size)), axis=1)
    if np.all(np.isfinite(medians)):
        low, high = np.percentile(medians, [2.5, 97.5]).tolist()
    else:  # nothing lies between a number and infinity: outwards
        low = float(np.percentile(medians, 2.5, method="lower"))
        high = float(np.percentile(medians, 97.5, method="higher"))
    return Interval(float(np.median(data)), low, high, data.size)
