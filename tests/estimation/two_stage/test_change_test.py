"""The test by weighted sums of squares: its thresholds against their distributions."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import binom, chi2

from flightbed.estimation.two_stage.change_test import (
    BiasTest,
    BiasTestConfig,
    calibrated_threshold,
    chi_square_threshold,
    correlated_threshold,
    effective_degrees,
)


def _statistics(z: np.ndarray, window: int) -> np.ndarray:
    """d at the end of every row of z, from the test itself; the rows are its inputs, in blocks."""
    found = []
    for rows in np.split(z, 100):
        test = BiasTest(BiasTestConfig(window, (1.0,) * len(rows)))
        for column in rows.T:
            result = test.update(column, np.eye(len(rows)))
        found.append(result.statistic)
    return np.concatenate(found)


def _is_share(count: int, runs: int, share: float) -> bool:
    low, high = binom.ppf([0.0005, 0.9995], runs, share)
    return bool(low <= count <= high)


@pytest.mark.parametrize("window", [1, 3, 10])
@pytest.mark.parametrize("rate", [0.05, 0.01])
def test_of_white_estimates_the_paper_s_law_is_exact(rng: np.random.Generator, window: int, rate: float) -> None:
    runs = 20000
    d = _statistics(rng.standard_normal((runs, window + 3)), window)
    assert _is_share(int(np.sum(d > chi_square_threshold(window, rate))), runs, rate)


def test_thresholds_of_the_table() -> None:
    """chi-square: 7.815 for 3 degrees at 5 % (Abramowitz and Stegun, table 26.8)."""
    assert 3.0 * chi_square_threshold(3, 0.05) == pytest.approx(7.815, abs=5e-4)
    assert correlated_threshold(1.0, 0.05) == pytest.approx(1.959964**2, rel=1e-6)


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.9, 0.99, 1.0])
def test_the_effective_degrees_give_the_variance_of_d_exactly(rng: np.random.Generator, rho: float) -> None:
    """The variance of a sum of squares of jointly Gaussian variables is 2 tr(C^2)."""
    window = 5
    lags = np.arange(window)
    C = rho ** np.abs(lags[:, None] - lags)
    degrees = effective_degrees(rho ** lags[1:], window)
    assert 2.0 * np.trace(C @ C) / window**2 == pytest.approx(2.0 / degrees, rel=1e-12)
    assert 1.0 - 1e-12 <= degrees <= window + 1e-12


@pytest.mark.parametrize("rho", [0.5, 0.9, 0.99])
def test_of_correlated_estimates_only_the_effective_degrees_keep_their_word(
    rng: np.random.Generator, rho: float
) -> None:
    window, rate, runs = 3, 0.05, 20000
    white = rng.standard_normal((runs, 6))
    z = np.empty((runs, 6))
    z[:, 0] = white[:, 0]
    z[:, 1:] = lfilter([np.sqrt(1.0 - rho**2)], [1.0, -rho], white[:, 1:], axis=1, zi=rho * z[:, :1])[0]
    d = _statistics(z, window)
    degrees = effective_degrees(rho ** np.arange(1, window), window)
    share = float(np.mean(d > correlated_threshold(degrees, rate)))
    assert abs(share - rate) < 0.007  # two moments are matched, not the tail; Monte Carlo adds 0.0015
    assert float(np.mean(d > chi_square_threshold(window, rate))) > share  # too often
    assert float(np.mean(d > correlated_threshold(1.0, rate))) < rate + 0.0051  # cautious, within 3.3 sigma


def test_the_calibrated_threshold_keeps_its_word_and_its_interval_holds_the_quantile(rng: np.random.Generator) -> None:
    rate, runs, trials = 0.05, 200, 1000
    true = float(chi2.isf(rate, 1))
    found = [calibrated_threshold(rng.chisquare(1, runs), rate) for _ in range(trials)]
    held = sum(c.low <= true <= c.high for c in found)
    assert held >= binom.ppf(0.0005, trials, 0.95)  # at least 95 %
    assert abs(np.mean([float(chi2.sf(c.threshold, 1)) for c in found]) - rate) < 0.003


def test_too_few_runs_leave_the_threshold_open_above() -> None:
    assert calibrated_threshold(np.arange(20.0), 0.05).high == np.inf


def test_the_statistic_by_hand() -> None:
    test = BiasTest(BiasTestConfig(2, (1.0, 3.0)))
    P = np.array([[0.5, 0.1], [0.1, 2.0]])
    first = test.update(np.array([1.0, -2.0]), P)  # (1 / 0.5, 4 / 2), and nothing before
    np.testing.assert_allclose(first.statistic, [1.0, 1.0])
    assert first.raised.tolist() == [False, False]
    second = test.update(np.array([0.5, 3.0]), P)  # (2 + 0.5) / 2, (2 + 4.5) / 2
    np.testing.assert_allclose(second.statistic, [1.25, 3.25])
    assert second.raised.tolist() == [True, True]
    np.testing.assert_allclose(test.update(np.zeros(2), P).statistic, [0.25, 2.25])  # the first has left the window


def test_invalid_settings_are_refused() -> None:
    with pytest.raises(ValueError, match="window: must be at least 1 sample"):
        BiasTestConfig(0, (1.0,))
    with pytest.raises(ValueError, match="thresholds: must be positive"):
        BiasTestConfig(3, (1.0, 0.0))
    with pytest.raises(ValueError, match="false alarm rate"):
        chi_square_threshold(3, 0.0)
    with pytest.raises(ValueError, match="autocorrelation: must reach to lag 4"):
        effective_degrees([0.5, 0.2], 5)
