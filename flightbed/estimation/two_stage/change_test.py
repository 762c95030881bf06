"""Test for a loss of effectiveness by weighted sums of squared estimates, for each input (Wu and others 2000, S 3), and its thresholds.

W eqs (33) and (34): d_i = (1/L) sum of gamma-hat_i^2 / P_ii over the last L samples, against a threshold. W is N. E. Wu, Y. Zhang, K. Zhou,
Int. J. Adaptive Control and Signal Processing 14 (2000) 775. W assumes that L d_i is chi-square with L degrees of freedom. This requires
estimates that are independent from sample to sample, have the variance P_ii of the filter, and zero mean. None of this holds: successive
estimates are strongly correlated, so d is closer to chi-square with one degree of freedom; forgetting and the assumed noise make P_ii
larger than the variance; and in a closed loop the mean is not zero. Hence three thresholds: that of the paper, one that accounts for the
correlation, and one from simulated runs, the only one that accounts for all three effects.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from flightbed.core.compiled import Array


def chi_square_threshold(window: int, false_alarm: float) -> float:
    """Return the value that d exceeds with the given probability if L d is chi-square with L degrees of freedom (W S 3).

    Args:
        window: L, samples.
        false_alarm: probability at one sample, for one input.

    """
    return correlated_threshold(float(window), false_alarm)


def effective_degrees(autocorrelation: Sequence[float] | Array, window: int) -> float:
    """Return the degrees of freedom h for which h d is approximately chi-square if the estimates are correlated.

    Matches the mean and variance of d (Satterthwaite, Biometrics Bulletin 2 (1946) 110): h = L^2 / sum over i, j of rho(i - j)^2. h is
    L for white and 1 for constant estimates; both cases are exact.

    Args:
        autocorrelation: at least rho(1) ... rho(L - 1), of gamma-hat / sqrt(P).
        window: L, samples.

    """
    rho = np.asarray(autocorrelation, dtype=np.float64)[: window - 1]
    if rho.size < window - 1:
        raise ValueError(f"autocorrelation: must reach to lag {window - 1} (got {rho.size} lags)")
    lags = np.arange(1, window)
    return float(window**2 / (window + 2.0 * np.sum((window - lags) * rho**2)))


def correlated_threshold(degrees: float, false_alarm: float) -> float:
    """Return the value that d exceeds with the given probability if h d is chi-square with h degrees of freedom, see ``effective_degrees``.

    One degree of freedom is the conservative choice: at probabilities up to 0.2 no correlation requires a higher threshold (Szekely and
    Bakirov, Probability Theory and Related Fields 126 (2003) 184).
    """
    from scipy.stats import chi2  # slow to import

    if not 0.0 < false_alarm < 1.0:
        raise ValueError(f"false alarm rate: must be between 0 and 1 (got {false_alarm:g})")
    return float(chi2.isf(false_alarm, degrees)) / degrees


class CalibratedThreshold(NamedTuple):
    """A threshold from simulated runs without failure.

    Attributes:
        threshold: quantile of the largest d of a run.
        low, high: 95 % confidence interval of the threshold, from order statistics; high is infinite with too few runs.
        runs: number of runs.

    """

    threshold: float
    low: float
    high: float
    runs: int


def calibrated_threshold(largest: Sequence[float] | Array, false_alarm: float) -> CalibratedThreshold:
    """Return the threshold for a false-alarm probability per run, with its confidence interval.

    Args:
        largest: the largest d of each of several independent runs without failure.
        false_alarm: probability of an alarm in a whole run.

    """
    from scipy.stats import binom  # slow to import

    data = np.sort(np.asarray(largest, dtype=np.float64))
    n = data.size
    # The number of the n values below the quantile is binomial (n, 1 - false_alarm).
    below, above = (int(binom.ppf(p, n, 1.0 - false_alarm)) for p in (0.025, 0.975))
    low = float(data[below - 1]) if below > 0 else 0.0
    high = float(data[above]) if above < n else np.inf
    # The order statistic (n + 1) p has the requested mean exceedance probability (Weibull's plotting position).
    return CalibratedThreshold(float(np.quantile(data, 1.0 - false_alarm, method="weibull")), low, high, n)


@dataclass(frozen=True)
class BiasTestConfig:
    """Settings of the test.

    Attributes:
        window: L, number of samples in the mean.
        thresholds: epsilon, one per input.

    """

    window: int
    thresholds: tuple[float, ...]

    def __post_init__(self) -> None:
        if self.window < 1:
            raise ValueError(f"window: must be at least 1 sample (got {self.window})")
        if not all(value > 0.0 for value in self.thresholds):
            raise ValueError(f"thresholds: must be positive (got {self.thresholds})")


class BiasTestResult(NamedTuple):
    """Result of the test at a sample.

    Attributes:
        statistic: (l,), d; samples before the first count as zero, that is as estimates without loss.
        raised: (l,), whether d exceeds the threshold: hypothesis H1, the input has lost effectiveness.

    """

    statistic: Array
    raised: np.ndarray[tuple[int], np.dtype[np.bool_]]


class BiasTest:
    """The test, advanced by one sample per call.

    Args:
        config: window and thresholds.

    """

    def __init__(self, config: BiasTestConfig) -> None:
        self._thresholds = np.array(config.thresholds)
        nothing = [np.zeros(len(config.thresholds))] * config.window
        self._terms: deque[Array] = deque(nothing, maxlen=config.window)

    def update(self, gamma: Array, covariance: Array) -> BiasTestResult:
        """Take the estimate of a sample, gamma-hat (l,) and its covariance (l, l), and return the result of the test."""
        self._terms.append(gamma**2 / np.diag(covariance))
        statistic: Array = np.mean(self._terms, axis=0)
        return BiasTestResult(statistic, statistic > self._thresholds)
