"""Bootstrap intervals: against scipy on the same data, reproducible by seed, coverage."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import binom, bootstrap, expon, quantile_test

from flightbed.campaigns.summary import QuantitySummary
from flightbed.campaigns.table import Quantity
from flightbed.statistics.bootstrap import FEWEST, FEWEST_OF_PERCENTILE, RESAMPLES, mean_interval, percentile_interval
from flightbed.statistics.intervals import Interval, quantile_interval


def test_the_interval_of_a_mean_is_scipys_bca(rng: np.random.Generator) -> None:
    """Both have resampling error: an end at the 2.5th percentile of 2000 resamples lies within a sixth of a standard error (4 sigma)."""
    data = rng.exponential(size=40)
    found = mean_interval(data.tolist(), 1, "x")
    theirs = bootstrap((data,), np.mean, n_resamples=50_000, method="BCa", rng=rng).confidence_interval
    error = data.std(ddof=1) / np.sqrt(40)
    # sd of a sample quantile: sqrt(p (1 - p) / n) / density; of a normal at its 2.5th percentile 0.0598 standard errors with 2000
    tolerance = 4.0 * np.sqrt(0.025 * 0.975 / RESAMPLES) / 0.05845 * error
    assert (found.low, found.high) == pytest.approx((theirs.low, theirs.high), abs=tolerance)
    assert (found.estimate, found.runs) == (np.mean(data), 40)
    plain = bootstrap((data,), np.mean, n_resamples=50_000, method="percentile", rng=rng).confidence_interval
    assert found.high > plain.high + 0.5 * tolerance / 4.0  # the interval follows the skewness


def test_the_interval_of_a_percentile_is_scipys(rng: np.random.Generator) -> None:
    data = rng.normal(size=81)
    found = percentile_interval(data.tolist(), 50.0, 1, "x")
    theirs = bootstrap((data,), np.median, n_resamples=20_000, method="percentile", rng=rng).confidence_interval
    # The median of a resample is one of the central values: the ends agree within a few order statistics.
    ordered = np.sort(data)
    for ours, other in ((found.low, theirs.low), (found.high, theirs.high)):
        assert abs(int(np.searchsorted(ordered, ours)) - int(np.searchsorted(ordered, other))) <= 2


def test_the_seed_decides_the_interval() -> None:
    data = np.linspace(0.0, 1.0, 50) ** 3
    assert mean_interval(data.tolist(), 5, "x") == mean_interval(data.tolist(), 5, "x")
    assert mean_interval(data.tolist(), 5, "x") != mean_interval(data.tolist(), 6, "x")
    assert mean_interval(data.tolist(), 5, "x") != mean_interval(data.tolist(), 5, "y")


def test_few_values_and_equal_values() -> None:
    assert mean_interval([1.0] * (FEWEST - 1), 0, "x") == Interval(1.0, -np.inf, np.inf, FEWEST - 1)
    assert mean_interval([2.5] * 30, 0, "x") == Interval(2.5, 2.5, 2.5, 30)
    few = FEWEST_OF_PERCENTILE - 1
    assert percentile_interval([1.0] * few, 95, 0, "x") == Interval(1.0, -np.inf, np.inf, few)
    assert percentile_interval([1.0] * (few + 1), 95, 0, "x") == Interval(1.0, 1.0, 1.0, few + 1)


def test_resamples_in_pieces_are_those_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    data = np.linspace(0.0, 1.0, 50).tolist()
    at_once = mean_interval(data, 3, "x")
    monkeypatch.setattr("flightbed.statistics.bootstrap._AT_ONCE", 50 * 300)
    assert mean_interval(data, 3, "x") == at_once


def test_the_coverage_of_the_interval_of_a_mean_is_near_nominal(rng: np.random.Generator) -> None:
    """500 samples of 40 normal values: the share lies within the 99.9 % range of a coverage from 0.91 to 0.97."""
    held = 0
    for i in range(500):
        found = mean_interval(rng.normal(size=40).tolist(), i, "x")
        held += found.low <= 0.0 <= found.high
    assert binom.ppf(0.0005, 500, 0.91) <= held <= binom.ppf(0.9995, 500, 0.97)


@pytest.mark.parametrize("percent", [5, 95])
def test_resampling_undercovers_in_a_tail_and_the_exact_interval_covers(rng: np.random.Generator, percent: int) -> None:
    """The reason to prefer the exact interval: 300 samples of 100 exponential values."""
    truth, by_resampling, exact = float(expon.ppf(percent / 100)), 0, 0
    for i in range(300):
        data = rng.exponential(size=100).tolist()
        ours, order = percentile_interval(data, percent, i, "x"), quantile_interval(data, percent / 100)
        by_resampling += ours.low <= truth <= ours.high
        exact += order.low <= truth <= order.high
    assert exact >= binom.ppf(0.001, 300, 0.95)
    assert by_resampling <= binom.ppf(0.999, 300, 0.93)


@pytest.mark.parametrize("p", [0.05, 0.25, 0.5, 0.95])
def test_the_exact_interval_of_a_quantile_is_scipys_quantile_test(rng: np.random.Generator, p: float) -> None:
    data = rng.exponential(size=90)
    theirs = quantile_test(data, p=p).confidence_interval(0.95)
    found = quantile_interval(data.tolist(), p)
    assert (found.low, found.high) == (theirs.low, theirs.high)
    assert found.estimate == np.quantile(data, p)


@pytest.mark.parametrize("n", [60, 71, 72, 73])
def test_the_exact_interval_of_a_tail_needs_72_values(n: int) -> None:
    """72 values all lie on one side of the quantile with at most 2.5 %: 0.95^72 = 0.0249."""
    found = quantile_interval(np.arange(float(n)).tolist(), 0.95)
    assert np.isfinite(found.high) == (n >= 72)
    assert np.isfinite(found.low)


def test_a_quantity_with_missing_values_has_no_mean() -> None:
    happened = Quantity("x", tuple(float(v) for v in range(20)), seed=4)
    assert happened.mean == mean_interval(list(range(20)), 4, "x")
    row = QuantitySummary.of(happened).to_dict()
    assert row["mean"] == 9.5
    assert row["mean_low"] == happened.mean.low  # type: ignore[union-attr]
    assert row["p95_high"] is None  # of 20 flights
    never = Quantity("x", (1.0, np.inf, 2.0))
    assert never.mean is None
    assert QuantitySummary.of(never).to_dict()["mean"] is None
    assert (never.percentile(50).estimate, never.percentile(50).runs) == (1.5, 2)
