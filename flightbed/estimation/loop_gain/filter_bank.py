"""Array code of the estimators: one source, run compiled (numba, cached on disk) or plain (FLIGHTBED_PLAIN=1).

A bank holds W augmented filters of Theorem 1, along the last axis so that the innermost loops run over the filters. W = 1 is the
ordinary recursive filter; W = N filters with staggered starts are a moving window of N samples.
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from flightbed.core.compiled import Array, compiled

TickResult = tuple[
    float, float, float, float, float, float, float, float, float, float, float, float
]  # the estimate of a tick, see ``tick``

FIXED, ANCHORED, CORRECTED = 0.0, 1.0, 2.0  # start of a filter
ROWS, SETTINGS = 47, 44  # rows of a bank, and numbers of its settings
ONSET_TICKS = 15.0  # ticks after an alarm during which the onset of the change is still searched


@compiled
def step(
    bank: Array,
    model: Array,
    u: float,
    q00: float,
    q01: float,
    q11: float,
    inflation: float,
    r0: float,
    r1: float,
    z0: float,
    z1: float,
) -> None:
    """Predict and correct every filter of a bank with two measured states, in one pass over the filters.

    The operations and their order are those of ``joint.predict`` and ``joint.correct`` with H = I, so the results are bit-identical; the
    intermediate values of a filter stay in registers.

    Args:
        bank: as from ``new_bank``; X, P, normalized innovations squared (row 21), innovations and their variances are updated.
        model, u, inflation: as in ``joint.predict``.
        q00, q01, q11: covariance of the process noise.
        r0, r1: variances of the readings.
        z0, z1: the readings.

    """
    a00, a01, a10, a11 = model[0, 0], model[0, 1], model[1, 0], model[1, 1]
    g0, g1, c0, c1 = model[0, 2] * u, model[1, 2] * u, model[0, 3], model[1, 3]
    for w in range(bank.shape[1]):
        x0, x1, K = bank[0, w], bank[1, w], bank[2, w]
        p00, p01, p02, p11, p12, p22 = bank[3, w], bank[4, w], bank[5, w], bank[7, w], bank[8, w], bank[11, w]
        # x- = A x + b u K + c
        y0 = c0 + g0 * K + a00 * x0 + a01 * x1
        y1 = c1 + g1 * K + a10 * x0 + a11 * x1
        # T = F P, then P- = T F'
        t00, t01, t02 = (
            g0 * p02 + a00 * p00 + a01 * p01,
            g0 * p12 + a00 * p01 + a01 * p11,
            g0 * p22 + a00 * p02 + a01 * p12,
        )
        t10, t11, t12 = (
            g1 * p02 + a10 * p00 + a11 * p01,
            g1 * p12 + a10 * p01 + a11 * p11,
            g1 * p22 + a10 * p02 + a11 * p12,
        )
        m00 = inflation * (g0 * t02 + t00 * a00 + t01 * a01) + q00
        m01 = inflation * (g1 * t02 + t00 * a10 + t01 * a11) + q01
        m11 = inflation * (g1 * t12 + t10 * a10 + t11 * a11) + q11
        m02, m12, m22 = inflation * t02, inflation * t12, p22 * inflation
        bank[43, w], bank[44, w], bank[45, w], bank[46, w] = z0 - y0, z1 - y1, m00 + r0, m11 + r1
        # correction by the first reading, then by the second
        inverse, e = 1.0 / (r0 + m00), z0 - y0
        nis = e * e * inverse
        y0 += m00 * inverse * e
        y1 += m01 * inverse * e
        K += m02 * inverse * e
        n00, n01, n02 = m00 - m00 * inverse * m00, m01 - m00 * inverse * m01, m02 - m00 * inverse * m02
        n11, n12, n22 = m11 - m01 * inverse * m01, m12 - m01 * inverse * m02, m22 - m02 * inverse * m02
        inverse, e = 1.0 / (r1 + n11), z1 - y1
        bank[21, w] = nis + e * e * inverse
        bank[0, w] = y0 + n01 * inverse * e
        bank[1, w] = y1 + n11 * inverse * e
        bank[2, w] = K + n12 * inverse * e
        p00, p01, p02 = n00 - n01 * inverse * n01, n01 - n01 * inverse * n11, n02 - n01 * inverse * n12
        p11, p12, p22 = n11 - n11 * inverse * n11, n12 - n11 * inverse * n12, n22 - n12 * inverse * n12
        bank[3, w], bank[4, w], bank[5, w] = p00, p01, p02
        bank[6, w], bank[7, w], bank[8, w] = p01, p11, p12
        bank[9, w], bank[10, w], bank[11, w] = p02, p12, p22


@compiled
def start(bank: Array, settings: Array, slot: int, z0: float, z1: float) -> None:
    """Start one filter of a bank from the prior.

    FIXED ignores the readings; ANCHORED takes the state (not K) and its variances from the readings instead of the prior; CORRECTED
    corrects the prior by the readings, as ``joint.correct`` does.

    Args:
        bank: as from ``new_bank``.
        settings: as from ``pack_settings``: prior, start of a filter, variances of the readings.
        slot: index of the filter.
        z0, z1: the readings.

    """
    begin, r0, r1 = settings[17], settings[21], settings[22]
    for i in range(3):
        bank[i, slot] = settings[4 + i]
    for i in range(9):
        bank[3 + i, slot] = settings[7 + i]
    if begin == ANCHORED:
        bank[0, slot], bank[1, slot] = z0, z1
        bank[3, slot], bank[4, slot], bank[5, slot], bank[6, slot] = r0, 0.0, 0.0, 0.0
        bank[7, slot], bank[8, slot], bank[9, slot], bank[10, slot] = r1, 0.0, 0.0, 0.0
    elif begin == CORRECTED:
        for i in range(2):  # state i is measured
            inverse = 1.0 / ((r0 if i == 0 else r1) + bank[3 + 4 * i, slot])
            e = (z0 if i == 0 else z1) - bank[i, slot]
            h0, h1, h2 = bank[3 + i, slot], bank[6 + i, slot], bank[9 + i, slot]
            bank[0, slot] += h0 * inverse * e
            bank[1, slot] += h1 * inverse * e
            bank[2, slot] += h2 * inverse * e
            bank[3, slot] -= h0 * inverse * h0
            bank[4, slot] -= h0 * inverse * h1
            bank[5, slot] -= h0 * inverse * h2
            bank[7, slot] -= h1 * inverse * h1
            bank[8, slot] -= h1 * inverse * h2
            bank[11, slot] -= h2 * inverse * h2
            bank[6, slot], bank[9, slot], bank[10, slot] = bank[4, slot], bank[5, slot], bank[8, slot]


@compiled
def disturbance(
    bank: Array, settings: Array, model: Array, u: float, z0: float, z1: float, k: int
) -> tuple[float, float]:
    """Return the variances of disturbances estimated from the readings, to add to Q, so that sigma and alarms are valid in rough air.

    The residual of one step between readings, e = z - (A z_last + b K u + c), contains the disturbances; in a leaky sum over about 15
    ticks the sensor noise, which enters as differences, nearly cancels, and lasting gusts accumulate as they do in a window. The mean
    square of this sum over the last seconds, minus the share of the sensors, gives the variance of the equivalent white noise.

    """
    leak, slow = 1.0 - 1.0 / 15.0, max(1.0 / 300.0, 1.0 / (k + 20.0))
    x0, x1, effectiveness = bank[36, 0], bank[37, 0], bank[24, 0]
    found0, found1 = 0.0, 0.0
    for i in range(2):
        z = z0 if i == 0 else z1
        e = z - (model[i, 0] * x0 + model[i, 1] * x1 + model[i, 2] * effectiveness * u + model[i, 3])
        total, square, r = leak * bank[32 + i, 0] + e, bank[34 + i, 0], settings[21 + i]
        square += slow * (min(total * total, 4.0 * (square + r)) - square)
        bank[32 + i, 0], bank[34 + i, 0] = total, square
        found = max(0.0, (1.0 - leak * leak) * (square - 1.6 * r))
        if i == 0:
            found0 = found
        else:
            found1 = found
    return found0, found1


@compiled
def remember(bank: Array, z0: float, z1: float) -> None:
    """Take the readings at the start of a period, for ``disturbance``."""
    bank[36, 0], bank[37, 0] = z0, z1


@compiled
def _age(slot: int, since: int, k: int, W: int) -> int:
    """Return the number of samples, at most W, that a filter has processed at tick k; ``since`` is k mod W."""
    if k >= W:
        return since - slot if since > slot else since - slot + W
    return k - slot if slot > 0 and k > slot else (k if k > 0 else W)


@compiled
def alarm(bank: Array, settings: Array, k: int) -> bool:
    """Test every filter of a window for a change of K from its present level; on a change, select the filter with the likeliest onset.

    Filter w has processed only the data since its start. With I the information on K in these data and k_w the K estimated from
    them alone, (k_w - level)^2 / (1/I + var level) is twice the log likelihood ratio of a change at its start; the largest value is the
    generalized likelihood ratio over the time of the change (Willsky and Jones 1976), at no cost because the filters run anyway. Beyond
    the threshold, the filter with the largest value supplies the estimate until it has processed a full window; during the first
    ``ONSET_TICKS`` ticks a likelier start replaces it.

    """
    W = bank.shape[1]
    since = k % W
    prior, prior_var, threshold, youngest = settings[6], settings[15], settings[31], settings[33]
    recent = k - bank[31, 0] <= ONSET_TICKS
    level, level_var = (bank[29, 0], bank[30, 0]) if recent else (bank[25, 0], bank[26, 0])
    highest, slot = 0.0, -1
    for w in range(W):
        age = _age(w, since, k, W)
        if age < youngest or (recent and k - age < bank[38, 0]):
            continue
        information = 1.0 / bank[11, w] - 1.0 / prior_var
        if information <= 1e-9:
            continue
        mean = (bank[2, w] / bank[11, w] - prior / prior_var) / information
        ratio = (mean - level) ** 2 / (1.0 / information + level_var)
        if ratio > highest:
            highest, slot = ratio, w
    raised = highest > threshold and not recent
    if slot >= 0 and (raised or (recent and highest > threshold)):
        age = _age(slot, since, k, W)
        if raised:
            bank[29, 0], bank[30, 0], bank[31, 0] = bank[25, 0], bank[26, 0], float(k)
            bank[38, 0] = float(k - W)
            bank[32, 0], bank[33, 0] = 0.0, 0.0  # these sums contain the change of K, not disturbances
        bank[27, 0], bank[28, 0] = float(slot), float(k - age)
    return raised


@compiled
def tick(bank: Array, settings: Array, u: float, z0: float, z1: float, k: int) -> TickResult:
    """Advance a bank by one sample, both states measured, and return the estimate of the filter with the most data.

    Tick 0 starts every filter. In a window (W > 1) filter k mod W has processed exactly W samples at tick k: it supplies the estimate
    and restarts; during the first W ticks filter 0 has the most data. With W = 1 no filter restarts. After an alarm the selected filter
    supplies the estimate until it has processed a full window.

    The arguments are few because passing an array from Python takes longer than the arithmetic of one filter.

    Args:
        bank: the state, from ``new_bank``; updated.
        settings: as from ``pack_settings``; the model in it may change from tick to tick.
        u: input over the period that ends now.
        z0, z1: the readings of the two states.
        k: number of the tick.

    Returns:
        (K-hat in bounds, its standard deviation, smoothed K-hat, K-hat, state 0, state 1, normalized innovation squared, number of
        alarms so far, innovation of reading 0 and of 1, their standard deviations as the filter predicts them); at tick 0 the prior,
        with 0 for all of the innovation.

    """
    prior, prior_var = settings[6], settings[15]
    inflation, keep, low, high = settings[16], settings[18], settings[19], settings[20]
    model = settings[23:31].reshape((2, 4))
    threshold, adaptive, hold = settings[31], settings[32] > 0.0, settings[34]
    W = bank.shape[1]
    best = 0
    if k == 0:
        bank[21] = 0.0
        bank[43:47] = 0.0
        for w in range(W):
            start(bank, settings, w, z0, z1)
        bank[24:43, 0] = 0.0
        bank[24, 0], bank[25, 0], bank[26, 0] = 1.0, prior, 0.0
        bank[27, 0], bank[28, 0], bank[31, 0] = -1.0, 0.0, -1e9
        bank[34, 0], bank[35, 0] = settings[21], settings[22]
    else:
        more0, more1 = 0.0, 0.0
        if adaptive:
            more0, more1 = disturbance(bank, settings, model, u, z0, z1, k)
        step(
            bank,
            model,
            u,
            settings[0] + more0,
            settings[1],
            settings[3] + more1,
            inflation,
            settings[21],
            settings[22],
            z0,
            z1,
        )
        if k >= W:
            best = k % W
    remember(bank, z0, z1)
    raised = False
    if threshold > 0.0 and W > 1 and k > 0:
        raised = alarm(bank, settings, k)
        if bank[27, 0] >= 0.0:
            if k - bank[28, 0] < W:
                best = int(bank[27, 0])
            else:
                bank[27, 0] = -1.0
    gain, variance = bank[2, best], bank[11, best]
    information = max(
        0.0, 1.0 / variance - 1.0 / prior_var
    )  # information on K in the data alone, and its product with their mean
    weighted_mean = gain / variance - prior / prior_var
    if hold > 0.0:  # the last estimate, with this variance, replaces the prior of K
        variance = 1.0 / (information + 1.0 / hold)
        gain = variance * (weighted_mean + bank[24, 0] / hold)
    bounded = min(max(gain, low), high)
    if threshold > 0.0:
        since = k - bank[31, 0]
        if raised:
            bank[24, 0], bank[39, 0] = bounded, bank[39, 0] + 1.0
        elif since <= ONSET_TICKS:
            share = max(1.0 - keep, 1.0 - since / ONSET_TICKS)
            bank[24, 0] += share * (bounded - bank[24, 0])
        elif hold > 0.0:
            # Each tick adds 1/W of the window's information: the smoother weights it accordingly, and holds without information.
            share = min(1.0 - keep, bank[42, 0] / (bank[42, 0] + W / max(information, 1e-9)))
            bank[24, 0] += share * (weighted_mean / max(information, 1e-9) - bank[24, 0])
            bank[24, 0] = min(max(bank[24, 0], low), high)
            bank[42, 0] = (1.0 - share) * bank[42, 0] + hold / 4000.0
        else:
            bank[24, 0] = keep * bank[24, 0] + (1.0 - keep) * bounded
        if since <= ONSET_TICKS:
            bank[42, 0] = variance
        if bank[27, 0] >= 0.0:
            bank[25, 0], bank[26, 0] = gain, variance
        else:
            bank[25, 0] += 0.02 * (gain - bank[25, 0])
            bank[26, 0] = max(0.1 * variance, 0.02 * 0.02)
    else:
        bank[24, 0] = keep * bank[24, 0] + (1.0 - keep) * bounded
    result = (
        bounded, sqrt(variance), bank[24, 0], gain, bank[0, best] + settings[35], bank[1, best], bank[21, best], bank[39, 0],
        bank[43, best], bank[44, best], sqrt(bank[45, best]), sqrt(bank[46, best]),
    )  # fmt: skip
    if W > 1 and k > 0:
        start(bank, settings, k % W, z0, z1)
    return result


def new_bank(filters: int) -> Array:
    """Return the state of W filters of (alpha, q, K), zero: X, P, scratch, and in column 0 of rows 24 on the values that they share.

    Shared values, counted from row 24: 0 smoothed K-hat; 1 level of K in the alarm test, 2 its variance; 3 index of the selected
    filter, 4 tick of its start; 5, 6 level and variance before the last alarm, 7 tick of this alarm, 14 earliest start that may replace
    the selected one; 8, 9 leaky sums of residuals, 10, 11 their mean squares; 12, 13 last readings; 15 number of alarms; 16 leaky sum
    of the residuals of alpha, from which the gust's pitch rate is estimated, 17 its mean square; 18 variance of the smoothed K-hat. The
    last four rows hold each filter's innovations of the two readings and their variances.
    """
    return np.zeros((ROWS, filters))


def pack_settings(
    *,
    Q: Array,
    x0: Array,
    P0: Array,
    inflation: float,
    begin: float,
    keep: float,
    bounds: tuple[float, float],
    r: Array,
    model: Array,
    threshold: float = 0.0,
    adaptive: bool = False,
    youngest: int = 3,
    hold_var: float = 0.0,
    offset: float = 0.0,
) -> Array:
    """Return the settings of ``tick`` as one array, followed by eight numbers of scratch.

    Args:
        Q: (2, 2) covariance of the process noise.
        x0, P0: (3,) and (3, 3), prior of (alpha, q, K).
        inflation: 1/lambda of the fading memory, at least 1.
        begin: start of a filter: FIXED, ANCHORED or CORRECTED.
        keep: coefficient of the smoother.
        bounds: lowest and highest K-hat.
        r: (2,) variances of the readings.
        model: (2, 4), [A | b | c].
        threshold: threshold of alarms; 0: no alarms.
        adaptive: whether the process noise follows the disturbances.
        youngest: smallest number of samples of a filter in the alarm test.
        hold_var: variance with which the last estimate replaces the prior of K; 0: the prior is used.
        offset: added to the returned state 0.

    """
    memory = [inflation, begin, keep, *bounds]
    return np.concatenate(
        [
            Q.ravel(),
            x0,
            P0.ravel(),
            memory,
            r,
            model.ravel(),
            [threshold, float(adaptive), youngest, hold_var, offset, *([0.0] * 8)],
        ]
    )
