"""Regression of a reconstructed deflection on the measured one, and a test for deviations that no effectiveness explains.

A reconstruction is a linear filter, known at every tick, from the acting input and the sensor noise to u^. The measured deflection and a
constant pass through the same filter; without model error,

    u^ = K d^ + o 1^ + n,   d^, 1^ the filtered deflection and constant,

holds exactly at any lag of the filter; n is the filtered sensor noise. K is the slope, and o is a deflection that acts in addition to K
times position. Least squares estimates both. The covariance of sum(d^ n) and sum(1^ n) is propagated with that of the filter, so the
variances of K and o account for the correlation of n. This requires filter gains that do not depend on the noise; the gains of the
retrospective cost do, and the variances are then too small (by less than a half, on the exact model).

The test is on o, over windows: no value of K explains a nonzero o. A change of K distorts the window in which it occurs; therefore two
consecutive windows must agree. The variance assumes a deflection independent of the noise. In a closed loop the law responds to the same
readings, so the deflection depends on the noise and o is biased, most strongly when little else moves the elevator. A window in which the
deflection moves less than the tolerance, RMS about its mean, is therefore not evaluated. A second test, with the same windows and
threshold, compares the measured deflection with the response of a healthy actuator to the commands: their mean difference.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numpy as np

from flightbed.core.compiled import Array
from flightbed.core.units import DEG
from flightbed.estimation.reconstruction.regression_kernels import MARKS, RATIO, SMOOTHED, STAGGERED, Following


@dataclass(frozen=True)
class FollowingConfig:
    """Settings of regression and test. Radians.

    Attributes:
        forgetting: lambda of the regression for K, 0 < lambda <= 1.
        prior_effectiveness, prior_effectiveness_std: prior of K and its standard deviation.
        smoothing, bounds: as in LoopGainConfig.
        window: length of a window of the test, ticks, at least 6.
        false_alarm: probability that noise alone makes two consecutive windows agree, at one evaluation; each of the two tests has
            ``STAGGERED`` evaluations per window.
        offset_rad: tolerated o, to allow for model errors, and tolerated difference of measured deflection and actuator response.
            With 0 a declared deviation is never withdrawn.
        follow_disturbances: increase the variance to that of the windows' residuals; it is never below that of the sensors.

    Raises:
        ValueError: a value out of its range.

    """

    forgetting: float = 0.98
    prior_effectiveness: float = 1.0
    prior_effectiveness_std: float = 0.63
    smoothing: float = 0.9
    bounds: tuple[float, float] = (0.0, 1.0)
    window: int = 45
    false_alarm: float = 1e-6
    offset_rad: float = 0.3 * DEG
    follow_disturbances: bool = True

    def __post_init__(self) -> None:
        for holds, problem in (
            (0.0 < self.forgetting <= 1.0, f"forgetting must be in (0, 1] (got {self.forgetting})"),
            (self.window >= 2 * STAGGERED, f"window must be at least {2 * STAGGERED} ticks (got {self.window})"),
            (0.0 < self.false_alarm <= 0.5, f"false_alarm must be above 0 and at most 0.5 (got {self.false_alarm})"),
            (self.offset_rad >= 0.0, f"offset_rad must not be negative (got {self.offset_rad})"),
        ):
            if not holds:
                raise ValueError(problem)

    @property
    def threshold(self) -> float:
        """Threshold of o beyond the tolerance in each of two windows, in standard deviations.

        If p is the two-sided probability of one window, two independent windows exceed it on the same side with probability p^2 / 2.
        """
        from scipy.stats import norm  # slow to import

        return float(norm.isf(sqrt(self.false_alarm / 2.0)))


def packed(config: FollowingConfig, elevator_std_rad: float) -> Array:
    """Return the settings in the layout of ``follow``; ``elevator_std_rad`` is the noise of the position feedback."""
    follows = 1.0 if config.follow_disturbances else 0.0
    return np.array(
        [
            config.forgetting, config.prior_effectiveness, config.prior_effectiveness_std**2, config.smoothing, *config.bounds,
            float(config.window), config.threshold, config.offset_rad / DEG, follows, (elevator_std_rad / DEG) ** 2,
        ]
    )  # fmt: skip


def begin(states: int, config: FollowingConfig) -> Following:
    """Return the memory before the first tick: the filter's state equals the reading and has its error.

    Args:
        states: n, states of the filter's error.
        config: settings.

    """
    count = 1 + 2 * STAGGERED
    noise, marks = np.zeros((states, states)), np.zeros(MARKS)
    noise[0, 0] = noise[1, 1] = 1.0
    marks[RATIO], marks[SMOOTHED] = 1.0, 1.0
    apart = np.array([0, *[-(i * config.window // STAGGERED) for i in range(STAGGERED)] * 2], dtype=np.float64)
    return Following(
        np.zeros((states, 2)), noise, np.zeros((states, 2 * count)), np.zeros((count, 3)), np.zeros((count, 7)),
        apart, np.zeros(count), marks,
    )  # fmt: skip
