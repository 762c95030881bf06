"""Does a reconstructed deflection follow the measured one? Regression, its variance, and a test for what no effectiveness explains.

A reconstruction is a linear filter, known at every tick, from what acts on the aircraft and what the sensors err to u^. So the deflection
that is measured is sent through the same filter, as is a constant: with no error of the model

    u^ = K d^ + o 1^ + n,   d^, 1^ the filtered deflection and constant,

holds exactly, whatever the filter's lag, and n is the sensors' noise through the filter. K is the slope, o a deflection that acts beside
it. Least squares gives both. The covariance of sum(d^ n) and sum(1^ n) is carried along with the filter's own, so that the variances of K
and o are those of the correlated noise that there is. That holds of a filter whose gains do not depend on the noise; those of the
retrospective cost do, and the variances are then too small (by less than a half, on the exact model).

The test is of o, over windows: no effectiveness K, be it any number, explains an o that is not 0. A change of K spoils the window that it
falls into, hence two in a row must say the same. The variance takes the deflection for independent of the noise. In a closed loop it is
not, as the law answers to the same readings; o is then biased, the more the less else moves the elevator. So a window in which it moves
less than the tolerance, RMS about its mean, is not judged. A second test, with the same windows and threshold, holds the measured
deflection against the one that an actuator in order would have made of the commands: their mean difference.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numpy as np

from flightbed.compiling import Array
from flightbed.estimation.following_kernels import MARKS, RATIO, SMOOTHED, STAGGERED, Following
from flightbed.units import DEG


@dataclass(frozen=True)
class FollowingConfig:
    """Settings of regression and test. Radians.

    Attributes:
        forgetting: lambda of the regression for K, 0 < lambda <= 1.
        prior_effectiveness, prior_effectiveness_std: prior of K, which counts as little as its variance says.
        smoothing, bounds: as in LoopGainConfig.
        window: ticks of a window of the test, at least 6.
        false_alarm: probability with which noise alone, at an evaluation, makes two windows in a row say the same; of each of
            the two tests there are ``STAGGERED`` evaluations in a window.
        offset_rad: deflection beside K times the measured one that is tolerated: errors of the model make some; and measured beside
            what was asked for. With 0 nothing that was declared is taken back.
        follow_disturbances: raise the variance to what the residuals of the windows show, never below the sensors'.

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
        """Return how many standard deviations o must be beyond what is tolerated, in each of two windows.

        Two independent windows both beyond it on the same side have the probability p^2 / 2, p that of one, either side.
        """
        from scipy.stats import norm  # slow to import

        return float(norm.isf(sqrt(self.false_alarm / 2.0)))


def packed(config: FollowingConfig, elevator_std_rad: float) -> Array:
    """Return the settings as ``follow`` takes them; the second is the noise of the position feedback."""
    follows = 1.0 if config.follow_disturbances else 0.0
    return np.array(
        [
            config.forgetting, config.prior_effectiveness, config.prior_effectiveness_std**2, config.smoothing, *config.bounds,
            float(config.window), config.threshold, config.offset_rad / DEG, follows, (elevator_std_rad / DEG) ** 2,
        ]
    )  # fmt: skip


def begin(states: int, config: FollowingConfig) -> Following:
    """Return what is known before the first tick: the filter's state is the reading, and errs as that does."""
    count = 1 + 2 * STAGGERED
    noise, marks = np.zeros((states, states)), np.zeros(MARKS)
    noise[0, 0] = noise[1, 1] = 1.0
    marks[RATIO], marks[SMOOTHED] = 1.0, 1.0
    apart = np.array([0, *[-(i * config.window // STAGGERED) for i in range(STAGGERED)] * 2], dtype=np.float64)
    return Following(
        np.zeros((states, 2)), noise, np.zeros((states, 2 * count)), np.zeros((count, 3)), np.zeros((count, 7)),
        apart, np.zeros(count), marks,
    )  # fmt: skip
