"""Test for a loss of effectiveness by weighted sums of squared estimates, input by input (Wu and others 2000, S 3), and its thresholds.

W eqs (33) and (34): d_i = (1/L) sum of gamma-hat_i^2 / P_ii over the last L samples, against a threshold. W is N. E. Wu, Y. Zhang, K. Zhou,
Int. J. Adaptive Control and Signal Processing 14 (2000) 775. It takes L d_i for chi-square with L degrees of freedom. That holds if the
estimates of successive samples are independent of each other, have the variance P_ii that the filter tells, and no mean. None
is given: they are one estimate, slightly revised, so that d is nearer to chi-square with one degree; forgetting and assumed noise make
P_ii larger than their variance; and in a closed loop they have a mean. Hence three thresholds: the paper's, one that allows for
correlation, and one from simulated runs, which alone allows for everything.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from flightbed.compiling import Array


def chi_square_threshold(window: int, false_alarm: float) -> float:
    """Return the value that d exceeds with a probability if L d is chi-square with L degrees of freedom, as W S 3 has it.

    Args:
        window: L, samples.
        false_alarm: probability, at one sample and for one input.

    """
    return correlated_threshold(float(window), false_alarm)


def effective_degrees(autocorrelation: Sequence[float] | Array, window: int) -> float:
    """Return the degrees of freedom h for which h d is nearly chi-square if the estimates are correlated.

    Mean and variance of d are matched (Satterthwaite, Biometrics Bulletin 2 (1946) 110): h = L^2 / sum over i, j of rho(i - j)^2, which is
    L for white estimates and 1 for a constant one; both are exact.

    Args:
        autocorrelation: rho(1) ... rho(L - 1) at least, of gamma-hat / sqrt(P).
        window: L, samples.

    """
    rho = np.asarray(autocorrelation, dtype=np.float64)[: window - 1]
    if rho.size < window - 1:
        raise ValueError(f"autocorrelation: must reach to lag {window - 1} (got {rho.size} lags)")
    lags = np.arange(1, window)
    return float(window**2 / (window + 2.0 * np.sum((window - lags) * rho**2)))


def correlated_threshold(degrees: float, false_alarm: float) -> float:
    """Return the value that d exceeds with a probability if h d is chi-square with h degrees of freedom, see ``effective_degrees``.

    One degree is the cautious choice: at probabilities up to 0.2 no correlation makes a higher threshold necessary (Szekely and Bakirov,
    Probability Theory and Related Fields 126 (2003) 184).
    """
    from scipy.stats import chi2  # slow to import

    if not 0.0 < false_alarm < 1.0:
        raise ValueError(f"false alarm rate: must be between 0 and 1 (got {false_alarm:g})")
    return float(chi2.isf(false_alarm, degrees)) / degrees


class CalibratedThreshold(NamedTuple):
    """A threshold from simulated runs without failure.

    Attributes:
        threshold: quantile of the largest d of a run.
        low, high: 95 % interval of it, between order statistics; high is infinite with too few runs.
        runs: how many.

    """

    threshold: float
    low: float
    high: float
    runs: int


def calibrated_threshold(largest: Sequence[float] | Array, false_alarm: float) -> CalibratedThreshold:
    """Return the threshold that so many runs without failure exceed anywhere, with what their number leaves uncertain.

    Args:
        largest: the largest d of each run, independent runs.
        false_alarm: probability of an alarm in a whole run.

    """
    from scipy.stats import binom  # slow to import

    data = np.sort(np.asarray(largest, dtype=np.float64))
    n = data.size
    # Of n values the number below the quantile is binomial (n, 1 - false_alarm).
    below, above = (int(binom.ppf(p, n, 1.0 - false_alarm)) for p in (0.025, 0.975))
    low = float(data[below - 1]) if below > 0 else 0.0
    high = float(data[above]) if above < n else np.inf
    # The order statistic (n + 1) p, which on the average is exceeded as often as asked (Weibull's plotting position).
    return CalibratedThreshold(float(np.quantile(data, 1.0 - false_alarm, method="weibull")), low, high, n)


@dataclass(frozen=True)
class BiasTestConfig:
    """Settings of the test.

    Attributes:
        window: L, samples that are averaged.
        thresholds: epsilon of every input.

    """

    window: int
    thresholds: tuple[float, ...]

    def __post_init__(self) -> None:
        if self.window < 1:
            raise ValueError(f"window: must be at least 1 sample (got {self.window})")
        if not all(value > 0.0 for value in self.thresholds):
            raise ValueError(f"thresholds: must be positive (got {self.thresholds})")


class BiasTestResult(NamedTuple):
    """What the test says at a sample.

    Attributes:
        statistic: (l,), d; samples before the first count as zero, as an estimate of no loss does.
        raised: (l,), whether it is above the threshold: hypothesis H1, the input has lost effectiveness.

    """

    statistic: Array
    raised: np.ndarray[tuple[int], np.dtype[np.bool_]]


class BiasTest:
    """The test, sample by sample.

    Args:
        config: window and thresholds.

    """

    def __init__(self, config: BiasTestConfig) -> None:
        self._thresholds = np.array(config.thresholds)
        nothing = [np.zeros(len(config.thresholds))] * config.window
        self._terms: deque[Array] = deque(nothing, maxlen=config.window)

    def update(self, gamma: Array, covariance: Array) -> BiasTestResult:
        """Take the estimate of a sample, gamma-hat (l,) and its covariance (l, l), and test."""
        self._terms.append(gamma**2 / np.diag(covariance))
        statistic: Array = np.mean(self._terms, axis=0)
        return BiasTestResult(statistic, statistic > self._thresholds)
