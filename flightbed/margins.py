"""Plan -> Margins: between which true K the loop is stable while another is believed (Wu, Zhang and Zhou 2000, S 4).

On the design models, at the control rate, commands held. Of a surface with K the deflection that acts, a = K x position, is taken for the
state: then K enters only where the law's feedback of the motion does, and with the correction by 1/K-hat only as the ratio rho = K / K-hat,

    M(rho) = M_0 + rho M_1,

whose first crossings of the unit circle are eigenvalues (``control.margin.first_crossing``), not the end of a search. Aileron and rudder
together are gridded: positions are fed from one to the other, by which their ratio enters, too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from flightbed.compiling import Array
from flightbed.control.base import Gains
from flightbed.control.lq import spectral_radius
from flightbed.control.margin import first_crossing
from flightbed.control.roll_yaw import RollYaw
from flightbed.lateral_directional import LateralDirectional
from flightbed.short_period import ShortPeriod, zero_order_hold

_RAYS, _STEP, _LIMIT = 48, 0.02, 1.0
_GRID = np.linspace(0.04, 1.0, 13)
_HIGHEST = 100.0  # K beyond which no crossing is told


@dataclass(frozen=True, eq=False)
class Margins:
    """Of one plan.

    Attributes:
        believed: (G,) K-hat.
        low, high: (G,) between which the elevator's true K keeps the pitch loop stable; nan where it is not stable at K = K-hat.

    """

    believed: Array
    low: Array
    high: Array

    def at(self, believed: Array) -> tuple[Array, Array]:
        """Return lowest and highest true K for the K-hat (T,) believed at each tick."""
        return np.interp(believed, self.believed, self.low), np.interp(believed, self.believed, self.high)


def pitch_margins(
    design: ShortPeriod, gains_for: Callable[[float], Gains], *, control_hz: int, corrected: bool, effective: bool
) -> Margins:
    """Return the margins of a proportional law, with integral or without.

    Args:
        design: the healthy model.
        gains_for: K-hat -> the gains that are flown then.
        control_hz: rate of the commands.
        corrected: whether what the law asks for is divided by K-hat, else it is the command.
        effective: whether K-hat x position is fed back, else the position.

    """
    held = zero_order_hold(*design.with_actuator(), 1.0 / control_hz)
    low, high = np.empty(len(_GRID)), np.empty(len(_GRID))
    for i, K in enumerate(_GRID.tolist()):
        if i and corrected and effective:  # only the ratio counts
            low[i], high[i] = low[0] * K / _GRID[0], high[0] * K / _GRID[0]
            continue
        gains = gains_for(K)
        n = 3 + (gains.integral != 0.0)
        fixed, B, motion = np.zeros((n, n)), np.zeros(n), np.zeros(n)
        fixed[:3, :3], B[:3] = held.A, held.b
        motion[:2] = gains.alpha, gains.q
        if gains.integral:
            fixed[3, 3], fixed[3, 1], motion[3] = 1.0, -1.0 / control_hz, gains.integral
        # Of the command K times as much acts; a / K is fed back: K cancels there, and what is left are K-hat's.
        divisor = K if corrected else 1.0
        fixed[:, 2] += B * gains.elevator * (K if effective else 1.0) / divisor
        low[i], high[i] = _interval(fixed, np.outer(B, motion) / divisor, K)
    return Margins(_GRID, low, high)


def _interval(M_0: Array, M_1: Array, K: float) -> tuple[float, float]:
    """Return between which K' around K the loop M_0 + K' M_1 is stable; nothing outside 0 to 100 is told."""
    M = M_0 + K * M_1
    if spectral_radius(M) >= 1.0:
        return np.nan, np.nan
    down, up = first_crossing(M, -M_1, K), first_crossing(M, M_1, _HIGHEST)
    return max(0.0, K - down) if np.isfinite(down) else 0.0, min(K + up, _HIGHEST)


def lateral_margin(law: RollYaw, design: LateralDirectional, *, control_hz: int) -> float:
    """Return by which share of their K-hat those of aileron and rudder may both be off before roll and yaw are unstable.

    The largest eps such that the loop is stable for all |K_i / K-hat_i - 1| <= eps, with K-hat x position fed back, by a grid of rays to
    the faces of the box, each followed in steps of 0.02 and then bisected; not looked for beyond 1, where a K would be negative.
    """
    A, B = zero_order_hold(*design.with_actuators(), 1.0 / control_hz)
    F = law.F

    def stable(ratios: Array) -> bool:
        # Fed back is K-hat x position = a / rho; of what is commanded rho times as much acts.
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
