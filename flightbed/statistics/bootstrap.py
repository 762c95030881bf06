"""Bootstrap intervals where no exact interval exists: BCa for the mean, percentile method for percentiles; distribution-free."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from zlib import crc32

import numpy as np
import numpy.typing as npt

from flightbed.statistics.intervals import Interval

Vector = npt.NDArray[np.float64]
Statistic = Callable[[Vector], Vector]  # (m, n) -> (m,), along the last axis

RESAMPLES = 2000
# Smallest number of values with an interval, of a mean and of a percentile: with fewer the coverage falls below about 85 %.
FEWEST = 10
FEWEST_OF_PERCENTILE = 40
_AT_ONCE = 2_000_000  # resampled values in memory at a time


def mean_interval(values: Sequence[float], seed: int, what: str) -> Interval:
    """Return the mean with its 95 % interval, bias-corrected and accelerated (Efron 1987; Efron and Tibshirani, S 14.3).

    The acceleration is the jackknife's, for a mean one sixth of the skewness divided by the square root of n. With fewer than
    ``FEWEST`` values the interval is infinite.

    Args:
        values: finite, at least one.
        seed: seed of the resamples, together with ``what``.
        what: name of the quantity.

    """
    from scipy.special import ndtr, ndtri  # slow to import

    data = np.asarray(values, dtype=np.float64)
    mean = float(np.mean(data))
    if data.size < FEWEST:
        return Interval(mean, -np.inf, np.inf, data.size)
    away = data - mean
    squares = float(np.sum(away**2))
    if squares == 0.0:
        return Interval(mean, mean, mean, data.size)
    means = _resampled(data, lambda table: np.asarray(np.mean(table, axis=-1)), seed, what)
    acceleration = float(np.sum(away**3)) / (6.0 * squares**1.5)
    bias = float(ndtri(np.mean(means < mean) + 0.5 * np.mean(means == mean)))
    shifted = bias + np.array([-1.0, 1.0]) * float(ndtri(0.975))
    shares = ndtr(bias + shifted / (1.0 - acceleration * shifted))
    low, high = np.quantile(means, shares).tolist()
    return Interval(mean, low, high, data.size)


def percentile_interval(values: Sequence[float], percent: float, seed: int, what: str) -> Interval:
    """Return a percentile with its 95 % interval, the 2.5th to 97.5th percentile over the resamples (Efron 1979).

    BCa needs the jackknife, which fails for percentiles (Miller 1974). A resample has no value outside the range
    of the data, so for few flights the interval of an extreme percentile is too short, whatever the number of resamples;
    ``quantile_interval`` gives an infinite end instead. With fewer than ``FEWEST_OF_PERCENTILE`` values the interval is infinite.

    Args:
        values: finite, at least one.
        percent: 0 to 100.
        seed: seed of the resamples, together with ``what``.
        what: name of the quantity.


    """
    data = np.asarray(values, dtype=np.float64)
    estimate = float(np.percentile(data, percent))
    if data.size < FEWEST_OF_PERCENTILE:
        return Interval(estimate, -np.inf, np.inf, data.size)
    found = _resampled(data, lambda table: np.percentile(table, percent, axis=-1), seed, f"{what}/{percent:g}")
    low, high = np.percentile(found, [2.5, 97.5]).tolist()
    return Interval(estimate, low, high, data.size)


def _resampled(data: Vector, statistic: Statistic, seed: int, what: str) -> Vector:
    """Return the statistic of ``RESAMPLES`` resamples with replacement, (RESAMPLES,)."""
    source = np.random.SeedSequence(seed, spawn_key=(crc32(b"bootstrap"), crc32(what.encode()), data.size))
    rng = np.random.Generator(np.random.PCG64(source))
    found = np.empty(RESAMPLES)
    step = max(1, _AT_ONCE // data.size)
    for begin in range(0, RESAMPLES, step):
        count = min(step, RESAMPLES - begin)
        found[begin : begin + count] = statistic(data[rng.integers(0, data.size, (count, data.size))])
    return found
