"""Stability margins: the range of true K for which the loop is stable at a given estimate K-hat (Wu, Zhang and Zhou 2000, S 4).

The margins are those of the design models at the control rate, with commands held. The state of a surface is its effective deflection,
a = K x position: then K multiplies only the law's feedback of the motion, and with the correction by 1/K-hat only the ratio
rho = K / K-hat enters,

    M(rho) = M_0 + rho M_1.

The first crossings of the unit circle follow from eigenvalues (``control.margin.first_crossing``), without a search. Aileron and rudder
require a grid: the position of each is fed back to the command of the other, so the ratio of their effectivenesses enters as well.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from flightbed.avionics.lateral import LateralDirectional
from flightbed.avionics.short_period import ShortPeriod, zero_order_hold
from flightbed.control.base import Gains
from flightbed.control.gain_margin import first_crossing
from flightbed.control.lq import spectral_radius
from flightbed.control.roll_yaw import RollYaw
from flightbed.core.compiled import Array

_RAYS, _STEP, _LIMIT = 48, 0.02, 1.0
_GRID = np.linspace(0.04, 1.0, 13)
_HIGHEST = 100.0  # upper end of the range of K


@dataclass(frozen=True, eq=False)
class Margins:
    """Range of the elevator's true K with a stable pitch loop, over the K-hat that the law uses.

    Attributes:
        effectiveness_used: (G,) K-hat.
        low, high: (G,) lowest and highest true K; nan where the loop is unstable at K = K-hat.

    """

    effectiveness_used: Array
    low: Array
    high: Array

    def at(self, effectiveness: Array) -> tuple[Array, Array]:
        """Return the lowest and highest true K (T,) at each tick, for the K-hat (T,) that the law uses."""
        grid = self.effectiveness_used
        return np.interp(effectiveness, grid, self.low), np.interp(effectiveness, grid, self.high)


def pitch_margins(
    design: ShortPeriod, gains_for: Callable[[float], Gains], *, control_hz: int, corrected: bool, effective: bool
) -> Margins:
    """Return the margins of a proportional law, with or without an integral.

    Args:
        design: the healthy model.
        gains_for: K-hat -> gains of the law.
        control_hz: control rate, Hz.
        corrected: whether the command is the law's output divided by K-hat; else it is the output.
        effective: whether the law feeds back K-hat x position; else it feeds back the position.

    """
    held = zero_order_hold(*design.with_actuator(), 1.0 / control_hz)
    low, high = np.empty(len(_GRID)), np.empty(len(_GRID))
    for i, K in enumerate(_GRID.tolist()):
        if i and corrected and effective:  # only the ratio K / K-hat enters
            low[i], high[i] = low[0] * K / _GRID[0], high[0] * K / _GRID[0]
            continue
        gains = gains_for(K)
        n = 3 + (gains.integral != 0.0)
        fixed, B, motion = np.zeros((n, n)), np.zeros(n), np.zeros(n)
        fixed[:3, :3], B[:3] = held.A, held.b
        motion[:2] = gains.alpha, gains.q
        if gains.integral:
            fixed[3, 3], fixed[3, 1], motion[3] = 1.0, -1.0 / control_hz, gains.integral
        # The effective command is K times the command and the feedback is a / K: K cancels, and only K-hat remains.
        divisor = K if corrected else 1.0
        fixed[:, 2] += B * gains.elevator * (K if effective else 1.0) / divisor
        low[i], high[i] = _interval(fixed, np.outer(B, motion) / divisor, K)
    return Margins(_GRID, low, high)


def _interval(M_0: Array, M_1: Array, K: float) -> tuple[float, float]:
    """Return the interval of K' around K, within 0 to 100, in which the loop M_0 + K' M_1 is stable; nan, nan if unstable at K."""
    M = M_0 + K * M_1
    if spectral_radius(M) >= 1.0:
        return np.nan, np.nan
    down, up = first_crossing(M, -M_1, K), first_crossing(M, M_1, _HIGHEST)
    return max(0.0, K - down) if np.isfinite(down) else 0.0, min(K + up, _HIGHEST)


def lateral_margin(law: RollYaw, design: LateralDirectional, *, control_hz: int) -> float:
    """Return the largest relative error of K-hat of aileron and rudder for which the roll and yaw loop is stable.

    This is the largest eps such that the loop is stable for all |K_i / K-hat_i - 1| <= eps, with K-hat x position fed back. A grid of
    rays to the faces of the box is searched, each in steps of 0.02 with bisection; eps is limited to 1, beyond which K is negative.
    """
    A, B = zero_order_hold(*design.with_actuators(), 1.0 / control_hz)
    F = law.F

    def stable(ratios: Array) -> bool:
        # The feedback is K-hat x position = a / rho; the effective deflection is rho times the command.
        fed = np.concatenate([np.ones(3), 1.0 / np.maximum(ratios, 1e-9)])
        return spectral_radius(A - B @ (ratios[:, None] * F * fed)) < 1.0

    if not stable(np.ones(2)):
        return 0.0
    edge = np.linspace(-1.0, 1.0, _RAYS // 4, endpoint=False)
    rays = [np.array(ray) for e in edge for ray in ((1.0, e), (-1.0, -e), (-e, 1.0), (e, -1.0))]
    best = _LIMIT
    for ray in rays:
        for t in np.arange(_STEP, best + _STEP, _STEP):
            ratios = 1.0 + t * ray
            if np.any(ratios < 0.0):
                break
            if not stable(ratios):
                inside, outside = t - _STEP, t
                for _ in range(30):
                    middle = 0.5 * (inside + outside)
                    inside, outside = (middle, outside) if stable(1.0 + middle * ray) else (inside, middle)
                best = min(best, inside)
                break
    return min(best, _LIMIT)
