"""Compiled arithmetic of ``regression``: the memory beside a reconstruction, its update at a tick, and the test."""

from __future__ import annotations

from math import inf, sqrt
from typing import NamedTuple

import numpy as np

from flightbed.core.compiled import Array, compiled

STAGGERED = 3  # number of overlapping windows, with staggered starts
OUT = 2  # index of u^ in the filter's state, after the errors of alpha and q
EXPLAINED, OFFSET, ACTUATOR = 0.0, 1.0, 2.0  # values of a verdict
RATIO, ALARMS, SMOOTHED, _OFFSET, _ACTUATOR, _ALPHA, _Q = range(7)  # indices into ``marks``
MARKS = 7  # number of ``marks``
DD, D1, ONES, DU, U1, UU, NOISE, SUMS = range(8)  # indices into the sums of one regression, and their number
VAR_D, COV, VAR_1 = range(3)  # indices into the covariance of the first two sums with the noise
# Indices into the settings, ``regression.packed``; ``TOLERANCE`` is that of o, deg, and ``POSITION_VAR`` the noise of the feedback, deg^2.
FORGETTING, PRIOR, PRIOR_VAR, SMOOTHING, LOWEST, HIGHEST, WINDOW, THRESHOLD, TOLERANCE, FOLLOWS, POSITION_VAR = range(
    11
)


class Following(NamedTuple):
    """Memory of the regressions; all arrays, changed in place. n states of the filter, M = 1 + 2 ``STAGGERED`` regressions.

    Deflections are in deg and readings in standard deviations, so that all values have similar magnitudes.

    The first regression estimates K; ``STAGGERED`` windows of the regression follow, and then as many windows of the mean difference of
    measured deflection and actuator response, which do not use the reconstruction.

    Attributes:
        response: (n, 2) response of the filter's error to the measured deflection and to a constant of 1 deg.
        noise: (n, n) covariance of the filter's error due to noise.
        cross: (n, 2 M) its covariance with the noise of each regression's two sums; spread: (M, 3) covariance of these, [dd, d1, 11].
        sums: (M, 7) of a regression: d d, d 1, 1 1, d u^, 1 u^, u^ u^, variance of n. Of a mean: the third is the number of ticks, the
            fifth and sixth are the sum and the sum of squares.
        ages: (M,) ticks in the window, negative before its start; offset_signs: (M,) sign of o in the previous window, 0 if insignificant.
        marks: ratio of residuals to noise, alarms, smoothed K, the two verdicts, B of the previous period.

    """

    response: Array
    noise: Array
    cross: Array
    spread: Array
    sums: Array
    ages: Array
    offset_signs: Array
    marks: Array


class FollowingEstimate(NamedTuple):
    """Estimate at a tick.

    Attributes:
        effectiveness: K-hat in bounds; _std its standard deviation, _smoothed smoothed, _raw before the bounds.
        offset, offset_std: o and its standard deviation, deg.
        verdict, alarms: as in ``signals.Estimate``.
        noise_std: standard deviation of n, deg.
        nis: NIS of the readings minus their prediction from K and o.
        innovation_alpha, innovation_q: these innovations, and (_std) their standard deviations, in standard deviations of the sensors.
        slope: K of the regression together with o.

    """

    effectiveness: float
    effectiveness_std: float
    effectiveness_smoothed: float
    effectiveness_raw: float
    offset: float
    offset_std: float
    verdict: float
    alarms: float
    noise_std: float
    nis: float
    innovation_alpha: float
    innovation_q: float
    innovation_alpha_std: float
    innovation_q_std: float
    slope: float


@compiled
def restart(memory: Following, window: int) -> None:
    """Restart after the filter's state was set to the readings: its error is the readings' error; all windows start again."""
    memory.response[:], memory.noise[:], memory.cross[:] = 0.0, 0.0, 0.0
    memory.noise[0, 0] = memory.noise[1, 1] = 1.0
    memory.marks[_ALPHA], memory.marks[_Q] = 0.0, 0.0
    for m in range(1, memory.ages.size):
        _clear_window(memory, m)
        memory.ages[m] = -float((m - 1) % STAGGERED * window // STAGGERED)
        memory.offset_signs[m] = 0.0


@compiled
def _clear_window(memory: Following, m: int) -> None:
    memory.sums[m], memory.spread[m] = 0.0, 0.0
    memory.cross[:, 2 * m : 2 * m + 2] = 0.0
    memory.ages[m] = 0.0


@compiled
def solved(sums: Array, spread: Array) -> tuple[float, float, float, float, float]:
    """Return K and o of least squares, their variances, and the part of the squared noise that the fit absorbs.

    With W the sums of products and S the covariance of the sums of products with the noise, these are W^-1 (sum d u, sum 1 u), the
    diagonal of W^-1 S W^-1, and the trace of W^-1 S. The variances are infinite if W is singular.

    Args:
        sums, spread: rows of one regression, as in ``Following``.

    """
    a, b, c = sums[DD], sums[D1], sums[ONES]
    det = a * c - b * b
    if not det > 1e-9 * a * c:
        return 0.0, 0.0, inf, inf, 0.0
    K, o = (c * sums[DU] - b * sums[U1]) / det, (a * sums[U1] - b * sums[DU]) / det
    var_K = (c * c * spread[VAR_D] - 2.0 * b * c * spread[COV] + b * b * spread[VAR_1]) / (det * det)
    var_o = (b * b * spread[VAR_D] - 2.0 * a * b * spread[COV] + a * a * spread[VAR_1]) / (det * det)
    taken = (c * spread[VAR_D] - 2.0 * b * spread[COV] + a * spread[VAR_1]) / det
    return K, o, max(var_K, 0.0), max(var_o, 0.0), taken


@compiled
def _test_window(memory: Following, settings: Array, m: int) -> None:
    """Evaluate a complete window: update the residual ratio, compare with the previous window, declare or withdraw a verdict."""
    sums, marks, offset_signs = memory.sums[m], memory.marks, memory.offset_signs
    sign, within, which = 0.0, False, _OFFSET if m <= STAGGERED else _ACTUATOR
    K, o, var_o, taken = 0.0, sums[U1] / sums[ONES], memory.spread[m, VAR_1] / (sums[ONES] * sums[ONES]), 0.0
    if which == _OFFSET:
        K, o, _, var_o, taken = solved(sums, memory.spread[m])
        if sums[DD] - sums[D1] * sums[D1] / sums[ONES] < settings[TOLERANCE] * settings[TOLERANCE] * sums[ONES]:
            var_o = inf  # the motion is below the tolerance, and much of it is the law's response to the same noise
    if var_o < inf:
        ratio = marks[RATIO] if which == _OFFSET else 1.0
        expected = sums[NOISE] - taken
        if which == _OFFSET and expected > 1e-9 * sums[NOISE]:
            seen = max(sums[UU] - K * sums[DU] - o * sums[U1], 0.0) / expected
            ratio = max(ratio + (min(seen, 4.0 * ratio) - ratio) / 30.0, 1.0)
            marks[RATIO] = ratio
        std = sqrt(var_o * (ratio if settings[FOLLOWS] > 0.0 else 1.0))
        if abs(o) - settings[TOLERANCE] > settings[THRESHOLD] * std:
            sign = 1.0 if o > 0.0 else -1.0
        within = abs(o) + settings[THRESHOLD] * std < 2.0 * settings[TOLERANCE]
        if which == _ACTUATOR:  # a position in the middle of large commands is near them on average only
            within = within and sums[UU] < 4.0 * settings[TOLERANCE] * settings[TOLERANCE] * sums[ONES]
    if within:
        marks[which] = 0.0
    elif sign != 0.0 and sign == offset_signs[m] and marks[which] == 0.0:
        marks[which] = 1.0
        marks[ALARMS] += 1.0
    offset_signs[m] = sign


@compiled
def follow(
    response: Array, noise: Array, cross: Array, spread: Array, sums: Array, ages: Array, offset_signs: Array, marks: Array,
    settings: Array, F: Array, G: Array, Q: Array, B: Array, z: Array, reconstruction: float, feedback: float, commanded: float,
) -> FollowingEstimate:  # fmt: skip
    """Update the memory by one tick of a reconstruction; return the estimate.

    Args:
        response, noise, cross, spread, sums, ages, offset_signs, marks: the fields of ``Following``, updated; as separate arguments,
            because passing a tuple of arrays to compiled code takes as long as the tick itself.
        settings: as from ``regression.packed``.
        F: (n, n) transition of the filter's error from this tick to the next, without the input of the period that begins; component
            ``OUT`` of the result is u^.
        G: (n, 2) effect of the sensors' errors on it.
        Q: (2,) variances of the disturbances of alpha and q in a period.
        B: (2,) effect of the input of the period that begins.
        z: (2,) readings minus the filter's state.
        reconstruction: u^, deg.
        feedback: measured deflection over the period that ended, deg.
        commanded: mean response of a healthy actuator over the same period, deg; nan without commands.

    """
    memory = Following(response, noise, cross, spread, sums, ages, offset_signs, marks)
    n, count = noise.shape[0], ages.size
    has_command = commanded == commanded
    for i in range(2):
        b = marks[_ALPHA + i]
        response[i, 0] += b * feedback
        response[i, 1] += b
    before, s0, s1, s01 = response[:2].copy(), noise[0, 0] + 1.0, noise[1, 1] + 1.0, noise[0, 1]
    marks[_ALPHA], marks[_Q] = B[0], B[1]

    response[:, :] = F @ response
    noise[:, :] = F @ noise @ F.T + G @ G.T
    noise[0, 0] += Q[0]
    noise[1, 1] += Q[1]
    noise[:2, :2] += settings[POSITION_VAR] * np.outer(
        B, B
    )  # an error of the measured deflection changes the explained readings by at most b (K = 1)
    cross[:, :] = F @ cross
    n_var, one = max(noise[OUT, OUT], 0.0), response[OUT, 1]
    for m in range(count):
        if ages[m] < 0.0:
            ages[m] += 1.0
            continue
        if m > STAGGERED:
            if has_command:
                sums[m, ONES] += 1.0
                sums[m, U1] += feedback - commanded
                sums[m, UU] += (feedback - commanded) ** 2
                spread[m, VAR_1] += settings[POSITION_VAR]
            ages[m] += 1.0
            continue
        keep = settings[FORGETTING] if m == 0 else 1.0
        d, at = response[OUT, 0], 2 * m
        c0, c1 = keep * cross[OUT, at], keep * cross[OUT, at + 1]
        spread[m, VAR_D] = keep * keep * spread[m, VAR_D] + 2.0 * d * c0 + d * d * n_var
        spread[m, COV] = keep * keep * spread[m, COV] + d * c1 + one * c0 + d * one * n_var
        spread[m, VAR_1] = keep * keep * spread[m, VAR_1] + 2.0 * one * c1 + one * one * n_var
        for i in range(n):
            cross[i, at] = keep * cross[i, at] + noise[i, OUT] * d
            cross[i, at + 1] = keep * cross[i, at + 1] + noise[i, OUT] * one
        new = (
            d * d,
            d * one,
            one * one,
            d * reconstruction,
            one * reconstruction,
            reconstruction * reconstruction,
            n_var,
        )
        for i in range(7):
            sums[m, i] = keep * sums[m, i] + new[i]
        ages[m] += 1.0
    for m in range(1, count):
        if ages[m] >= settings[WINDOW]:
            if m <= STAGGERED or sums[m, ONES] > 0.0:
                _test_window(memory, settings, m)
            _clear_window(memory, m)
    return _estimate(memory, settings, n_var, before, z, s0, s1, s01)


@compiled
def _estimate(
    memory: Following, settings: Array, n_var: float, before: Array, z: Array, s0: float, s1: float, s01: float
) -> FollowingEstimate:
    """Return the estimate; ``before`` (2, 2) is the response of z, and s0, s1, s01 are its covariance."""
    marks, sums = memory.marks, memory.sums[0].copy()
    ratio, prior, prior_var = (marks[RATIO] if settings[FOLLOWS] > 0.0 else 1.0), settings[PRIOR], settings[PRIOR_VAR]
    # The priors of K and of o (5 deg standard deviation) enter as pseudo-readings of their means, weighted by noise over prior variance.
    weight_K, weight_o = max(n_var, 1e-6) / prior_var, max(n_var, 1e-6) / 25.0
    spread = ratio * memory.spread[0]
    spread[VAR_D] += weight_K * weight_K * prior_var
    spread[VAR_1] += weight_o * weight_o * 25.0
    sums[DD] += weight_K
    sums[ONES] += weight_o
    sums[DU] += weight_K * prior
    slope, offset, variance, var_o, _ = solved(sums, spread)
    K = slope
    if marks[_OFFSET] == 0.0:
        K, variance = sums[DU] / sums[DD], spread[VAR_D] / (sums[DD] * sums[DD])
    bounded = min(max(K, settings[LOWEST]), settings[HIGHEST])
    marks[SMOOTHED] = settings[SMOOTHING] * marks[SMOOTHED] + (1.0 - settings[SMOOTHING]) * bounded
    e0 = z[0] - K * before[0, 0] - (offset * before[0, 1] if marks[_OFFSET] > 0.0 else 0.0)
    e1 = z[1] - K * before[1, 0] - (offset * before[1, 1] if marks[_OFFSET] > 0.0 else 0.0)
    nis = max((s1 * e0 * e0 - 2.0 * s01 * e0 * e1 + s0 * e1 * e1) / (s0 * s1 - s01 * s01), 0.0)
    verdict = OFFSET if marks[_OFFSET] > 0.0 else ACTUATOR if marks[_ACTUATOR] > 0.0 else EXPLAINED
    return FollowingEstimate(
        bounded, sqrt(variance), marks[SMOOTHED], K, offset, sqrt(var_o), verdict, marks[ALARMS], sqrt(n_var),
        nis, e0, e1, sqrt(s0), sqrt(s1), slope,
    )  # fmt: skip
