"""Statistics over many flights: median and range, and intervals of shares, means, medians and quantiles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Vector = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Spread:
    """Median and 5th to 95th percentile over the runs that have the value.

    Attributes:
        runs: number of runs.
        missing: number of runs without the value (None or not finite).
        median, low, high: nan if no run has the value.

    """

    runs: int
    missing: int
    median: float
    low: float
    high: float


@dataclass(frozen=True)
class Interval:
    """An estimate with a 95 % confidence interval, and the number of runs."""

    estimate: float
    low: float
    high: float
    runs: int


@dataclass(frozen=True)
class Outcome:
    """Result of flights that may end early.

    Attributes:
        stayed: a value over the complete flights; ``missing`` counts those that ended early.
        gone_s: end times of the other flights, s; ``missing`` counts the complete flights.

    """

    stayed: Spread
    gone_s: Spread


def outcome(values: Sequence[float | None], gone_s: Sequence[float | None]) -> Outcome:
    """Return the spread of a value over the complete flights, and the spread of the end times of the others.

    Args:
        values: one per flight.
        gone_s: end time of each flight that ended early, s; None for a complete flight.

    """
    stayed = [None if gone is not None else value for value, gone in zip(values, gone_s, strict=True)]
    return Outcome(spread(stayed), spread(gone_s))


def spread(values: Sequence[float | None]) -> Spread:
    """Return median and 5-95 % range; None and values that are not finite count as missing."""
    had = np.array([v for v in values if v is not None and np.isfinite(v)], dtype=np.float64)
    low, median, high = np.percentile(had, [5, 50, 95]).tolist() if had.size else [np.nan] * 3
    return Spread(len(values), len(values) - had.size, median, low, high)


def rank(values: Sequence[float | None], value: float) -> float:
    """Return the share of the runs below a value; ties count half, and runs without the value (None) lie above."""
    had = np.array([np.inf if v is None else v for v in values], dtype=np.float64)
    return float(np.mean(had < value) + 0.5 * np.mean(had == value))


def share(successes: int, runs: int) -> Interval:
    """Return a share with its exact binomial interval (Clopper and Pearson 1934)."""
    from scipy.stats import binomtest  # slow to import

    bounds = binomtest(successes, runs).proportion_ci(0.95, method="exact")
    return Interval(successes / runs, float(bounds.low), float(bounds.high), runs)


def median_interval(values: Sequence[float]) -> Interval:
    """Return the median with the interval between order statistics that holds it with at least 95 % (sign test).

    It equals ``quantile_interval`` at p = 0.5. For paired differences it tests their sign. With fewer than 6 values no interval reaches
    95 %, and it is infinite. An infinite value represents an event that did not occur.
    """
    ends = quantile_interval(values, 0.5)
    return Interval(float(np.median(values)), ends.low, ends.high, ends.runs)


def quantile_interval(values: Sequence[float], p: float) -> Interval:
    """Return a quantile with the interval between order statistics that holds it with at least 95 %.

    Exact for any distribution: the k-th smallest of n values lies above the quantile only if fewer than k of them lie below it, a
    binomial count (Conover, Practical Nonparametric Statistics, S 3.2). An end without enough values is infinite: for p = 0.05 and
    0.95 both ends are finite from 72 values on.

    Args:
        values: at least one.
        p: probability of the quantile, between 0 and 1.

    """
    from scipy.stats import binom  # slow to import

    data = np.sort(np.asarray(values, dtype=np.float64))
    below = int(binom.ppf(0.025, data.size, p))  # P(count < below) <= 0.025 < P(count <= below)
    above = int(binom.ppf(0.975, data.size, p))  # P(count > above) <= 0.025
    low = float(data[below - 1]) if below else -np.inf
    high = float(data[above]) if above < data.size else np.inf
    return Interval(float(np.quantile(data, p)) if np.isfinite(data).all() else np.nan, low, high, data.size)


def chi_square_bound(degrees: float) -> float:
    """Return the 95 % quantile of the chi-square distribution with this number of degrees of freedom."""
    from scipy.special import chdtri  # slow to import

    return float(chdtri(degrees, 0.05))


def student_interval(values: Sequence[float], confidence: float = 0.95) -> Interval:
    """Return the mean with its Student t interval, the interval for a bias; infinite for a single value."""
    from scipy.stats import t as student  # slow to import

    data = np.asarray(values, dtype=np.float64)
    mean = float(np.mean(data))
    if data.size < 2:
        return Interval(mean, -np.inf, np.inf, data.size)
    half = float(student.ppf(0.5 + 0.5 * confidence, data.size - 1) * np.std(data, ddof=1) / np.sqrt(data.size))
    return Interval(mean, mean - half, mean + half, data.size)
