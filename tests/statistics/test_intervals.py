"""Spreads, ranks and intervals against independent numpy and scipy computations; coverage of the intervals."""

from __future__ import annotations

import statistics
from math import isnan

import numpy as np
import pytest
from scipy.stats import beta, binom, percentileofscore, quantile_test, ttest_1samp

from flightbed.statistics.intervals import Interval, median_interval, outcome, rank, share, spread, student_interval


@pytest.mark.parametrize("n", [1, 2, 7, 40])
def test_spread_is_median_and_percentiles_by_interpolation_of_the_sorted(rng: np.random.Generator, n: int) -> None:
    values = rng.lognormal(size=n).tolist()
    found = spread(values)
    low, high = (float(np.interp(p * (n - 1), np.arange(n), sorted(values))) for p in (0.05, 0.95))
    assert (found.runs, found.missing) == (n, 0)
    assert (found.median, found.low, found.high) == pytest.approx((statistics.median(values), low, high), rel=1e-14)


def test_spread_counts_and_excludes_missing_values() -> None:
    found = spread([None, 3.0, np.nan, 1.0, 2.0, None])
    assert (found.runs, found.missing, found.median) == (6, 3, 2.0)
    assert (found.low, found.high) == pytest.approx((1.1, 2.9))
    never = spread([None, None])
    assert (never.runs, never.missing) == (2, 2)
    assert all(isnan(v) for v in (never.median, never.low, never.high))


def test_rank_counts_ties_half(rng: np.random.Generator) -> None:
    values = rng.integers(0, 6, 50).tolist()
    for value in (-1, 0, 3, 3.5, 5, 6):
        assert rank(values, value) == pytest.approx(percentileofscore(values, value, kind="mean") / 100, abs=1e-15)
    assert rank([1.0, 2.0, 2.0, 3.0], 2.0) == 0.5


def test_missing_values_rank_above_every_number() -> None:
    values = [1.0, None, 2.0, None]
    assert [rank(values, v) for v in (0.5, 1.0, 1.5, 2.0, 1e300)] == [0.0, 0.125, 0.25, 0.375, 0.5]


def test_share_is_the_interval_of_clopper_and_pearson_by_quantiles_of_beta() -> None:
    n = 24
    for k in range(n + 1):
        found = share(k, n)
        low = beta.ppf(0.025, k, n - k + 1) if k else 0.0
        high = beta.ppf(0.975, k + 1, n - k) if k < n else 1.0
        assert (found.estimate, found.runs) == (k / n, n)
        assert (found.low, found.high) == pytest.approx((low, high), abs=1e-9)  # scipy uses a root search


def test_share_covers_at_least_95_percent_of_the_time() -> None:
    """Exact: the probability of all counts whose interval contains the true share."""
    n = 24
    intervals = [share(k, n) for k in range(n + 1)]
    coverage = []
    for p in np.linspace(0.01, 0.99, 99):
        covering = [k for k, i in enumerate(intervals) if i.low <= p <= i.high]
        coverage.append(float(np.sum(binom.pmf(covering, n, p))))
    assert min(coverage) >= 0.95
    assert np.mean(coverage) < 0.99  # the interval is not needlessly wide


def test_a_share_of_no_runs_is_an_error() -> None:
    with pytest.raises(ValueError, match="n must be"):
        share(0, 0)


@pytest.mark.parametrize("n", [6, 7, 15, 25, 100, 101])
def test_the_medians_interval_covers_at_least_95_percent_and_no_wider(n: int) -> None:
    """Exact for any continuous distribution: the ends are the k-th values from both sides; the next inner pair covers less than 95 %."""
    found = median_interval(np.arange(1.0, n + 1))
    k = round(found.low)
    assert (found.low, found.high) == (k, n + 1 - k)
    held = [1.0 - 2.0 * float(binom.cdf(rank - 1, n, 0.5)) for rank in (k, k + 1)]
    assert held[0] >= 0.95 > held[1]


@pytest.mark.parametrize("n", [1, 5])
def test_too_few_values_give_an_infinite_interval_of_the_median(n: int) -> None:
    assert median_interval([2.5] * n) == Interval(2.5, -np.inf, np.inf, n)


def test_the_medians_interval_is_that_of_scipys_quantile_test(rng: np.random.Generator) -> None:
    data = rng.exponential(size=40)
    interval = quantile_test(data, p=0.5).confidence_interval(0.95)
    found = median_interval(data.tolist())
    assert (found.low, found.high) == (interval.low, interval.high)
    assert (found.estimate, found.runs) == (statistics.median(data), 40)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_the_medians_interval_accepts_infinite_values(sign: float) -> None:
    """An infinite difference has a sign and exceeds every finite one."""
    infinite = sign * np.inf
    assert median_interval([infinite] * 10) == Interval(infinite, infinite, infinite, 10)
    data = [infinite] * 3 + [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0]
    ordered = sorted(data)
    assert median_interval(data) == Interval(ordered[5], ordered[1], ordered[9], 11)


def test_an_outcome_separates_complete_flights_and_early_ends() -> None:
    found = outcome([1.0, 9.0, 3.0, 2.0], [None, 7.5, None, None])
    assert (found.stayed.median, found.stayed.missing) == (2.0, 1)
    assert (found.gone_s.median, found.gone_s.missing) == (7.5, 3)


def test_the_interval_of_a_mean_is_scipys_and_covers(rng: np.random.Generator) -> None:
    values = rng.lognormal(size=12)
    for confidence in (0.95, 0.99):
        theirs = ttest_1samp(values, 0.0).confidence_interval(confidence)
        found = student_interval(values.tolist(), confidence)
        assert (found.estimate, found.low, found.high) == pytest.approx((values.mean(), theirs.low, theirs.high))
        assert found.runs == 12
    held = [
        i.low < 0.5 < i.high for i in (student_interval((0.5 + rng.standard_normal(8)).tolist()) for _ in range(2000))
    ]
    assert 0.95 == pytest.approx(np.mean(held), abs=4.0 * np.sqrt(0.95 * 0.05 / 2000))


def test_the_mean_of_one_value_has_an_infinite_interval() -> None:
    assert student_interval([3.0]) == Interval(3.0, -np.inf, np.inf, 1)
