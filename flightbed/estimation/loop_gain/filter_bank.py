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

# Rows of a bank: X, P and the normalized innovation squared of each filter.
ALPHA, RATE, GAIN, P00, P01, P02, P10, P11, P12, P20, P21, P22 = range(12)
NIS = 21
# Rows of the values that the filters share, in column ``SHARED``: smoothed K-hat; level of K in the alarm test, its variance; index of
# the selected filter, tick of its start; level and variance before the last alarm, tick of this alarm; leaky sums of residuals, their mean
# squares; last readings; earliest start that may replace the selected one; number of alarms; leaky sum of the residuals of alpha, from
# which the gust's pitch rate is estimated, its mean square; variance of the smoothed K-hat.
SHARED = 0
(
    SMOOTHED, LEVEL, LEVEL_VAR, SELECTED, SELECTED_START, LEVEL_BEFORE, LEVEL_VAR_BEFORE, ALARM_TICK, SUM_ALPHA, SUM_RATE, SQUARE_ALPHA,
    SQUARE_RATE, LAST_ALPHA, LAST_RATE, EARLIEST, ALARMS, GUST_SUM, GUST_SQUARE, SMOOTHED_VAR,
) = range(24, 43)  # fmt: skip
# Rows of each filter's innovations of the two readings, and their variances; number of rows.
ERROR_ALPHA, ERROR_RATE, ERROR_VAR_ALPHA, ERROR_VAR_RATE, ROWS = range(43, 48)

# Indices into the settings, see ``pack_settings``; covariance of the process noise and prior of the state and its covariance are
# several numbers each.
PROCESS_ALPHA, PROCESS_CROSS, _, PROCESS_RATE, PRIOR_STATE, _, PRIOR_K, PRIOR_COVARIANCE = range(8)
PRIOR_K_VAR, INFLATION, BEGIN, SMOOTHING, LOWEST, HIGHEST, NOISE_ALPHA, NOISE_RATE, MODEL = range(15, 24)
THRESHOLD, ADAPTIVE, YOUNGEST, HOLD_VAR, OFFSET, SCRATCH = range(31, 37)
SETTINGS = 44  # number of settings, with the model (2, 4) and the scratch
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
        bank: as from ``new_bank``; X, P, normalized innovations squared (row ``NIS``), innovations and their variances are updated.
        model, u, inflation: as in ``joint.predict``.
        q00, q01, q11: covariance of the process noise.
        r0, r1: variances of the readings.
        z0, z1: the readings.

    """
    a00, a01, a10, a11 = model[0, 0], model[0, 1], model[1, 0], model[1, 1]
    g0, g1, c0, c1 = model[0, 2] * u, model[1, 2] * u, model[0, 3], model[1, 3]
    for w in range(bank.shape[1]):
        x0, x1, K = bank[ALPHA, w], bank[RATE, w], bank[GAIN, w]
        p00, p01, p02, p11, p12, p22 = (
            bank[P00, w],
            bank[P01, w],
            bank[P02, w],
            bank[P11, w],
            bank[P12, w],
            bank[P22, w],
        )
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
        bank[ERROR_ALPHA, w], bank[ERROR_RATE, w], bank[ERROR_VAR_ALPHA, w], bank[ERROR_VAR_RATE, w] = (
            z0 - y0,
            z1 - y1,
            m00 + r0,
            m11 + r1,
        )
        # correction by the first reading, then by the second
        inverse, e = 1.0 / (r0 + m00), z0 - y0
        nis = e * e * inverse
        y0 += m00 * inverse * e
        y1 += m01 * inverse * e
        K += m02 * inverse * e
        n00, n01, n02 = m00 - m00 * inverse * m00, m01 - m00 * inverse * m01, m02 - m00 * inverse * m02
        n11, n12, n22 = m11 - m01 * inverse * m01, m12 - m01 * inverse * m02, m22 - m02 * inverse * m02
        inverse, e = 1.0 / (r1 + n11), z1 - y1
        bank[NIS, w] = nis + e * e * inverse
        bank[ALPHA, w] = y0 + n01 * inverse * e
        bank[RATE, w] = y1 + n11 * inverse * e
        bank[GAIN, w] = K + n12 * inverse * e
        p00, p01, p02 = n00 - n01 * inverse * n01, n01 - n01 * inverse * n11, n02 - n01 * inverse * n12
        p11, p12, p22 = n11 - n11 * inverse * n11, n12 - n11 * inverse * n12, n22 - n12 * inverse * n12
        bank[P00, w], bank[P01, w], bank[P02, w] = p00, p01, p02
        bank[P10, w], bank[P11, w], bank[P12, w] = p01, p11, p12
        bank[P20, w], bank[P21, w], bank[P22, w] = p02, p12, p22


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
    begin, r0, r1 = settings[BEGIN], settings[NOISE_ALPHA], settings[NOISE_RATE]
    for i in range(3):
        bank[i, slot] = settings[PRIOR_STATE + i]
    for i in range(9):
        bank[P00 + i, slot] = settings[PRIOR_COVARIANCE + i]
    if begin == ANCHORED:
        bank[ALPHA, slot], bank[RATE, slot] = z0, z1
        bank[P00, slot], bank[P01, slot], bank[P02, slot], bank[P10, slot] = r0, 0.0, 0.0, 0.0
        bank[P11, slot], bank[P12, slot], bank[P20, slot], bank[P21, slot] = r1, 0.0, 0.0, 0.0
    elif begin == CORRECTED:
        for i in range(2):  # state i is measured
            inverse = 1.0 / ((r0 if i == 0 else r1) + bank[P00 + 4 * i, slot])
            e = (z0 if i == 0 else z1) - bank[i, slot]
            h0, h1, h2 = bank[P00 + i, slot], bank[P10 + i, slot], bank[P20 + i, slot]
            bank[ALPHA, slot] += h0 * inverse * e
            bank[RATE, slot] += h1 * inverse * e
            bank[GAIN, slot] += h2 * inverse * e
            bank[P00, slot] -= h0 * inverse * h0
            bank[P01, slot] -= h0 * inverse * h1
            bank[P02, slot] -= h0 * inverse * h2
            bank[P11, slot] -= h1 * inverse * h1
            bank[P12, slot] -= h1 * inverse * h2
            bank[P22, slot] -= h2 * inverse * h2
            bank[P10, slot], bank[P20, slot], bank[P21, slot] = bank[P01, slot], bank[P02, slot], bank[P12, slot]


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
    x0, x1, effectiveness = bank[LAST_ALPHA, SHARED], bank[LAST_RATE, SHARED], bank[SMOOTHED, SHARED]
    found0, found1 = 0.0, 0.0
    for i in range(2):
        z = z0 if i == 0 else z1
        e = z - (model[i, 0] * x0 + model[i, 1] * x1 + model[i, 2] * effectiveness * u + model[i, 3])
        total, square, r = (
            leak * bank[SUM_ALPHA + i, SHARED] + e,
            bank[SQUARE_ALPHA + i, SHARED],
            settings[NOISE_ALPHA + i],
        )
        square += slow * (min(total * total, 4.0 * (square + r)) - square)
        bank[SUM_ALPHA + i, SHARED], bank[SQUARE_ALPHA + i, SHARED] = total, square
        found = max(0.0, (1.0 - leak * leak) * (square - 1.6 * r))
        if i == 0:
            found0 = found
        else:
            found1 = found
    return found0, found1


@compiled
def remember(bank: Array, z0: float, z1: float) -> None:
    """Take the readings at the start of a period, for ``disturbance``."""
    bank[LAST_ALPHA, SHARED], bank[LAST_RATE, SHARED] = z0, z1


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
    prior, prior_var, threshold, youngest = (
        settings[PRIOR_K],
        settings[PRIOR_K_VAR],
        settings[THRESHOLD],
        settings[YOUNGEST],
    )
    recent = k - bank[ALARM_TICK, SHARED] <= ONSET_TICKS
    level, level_var = (
        (bank[LEVEL_BEFORE, SHARED], bank[LEVEL_VAR_BEFORE, SHARED])
        if recent
        else (bank[LEVEL, SHARED], bank[LEVEL_VAR, SHARED])
    )
    highest, slot = 0.0, -1
    for w in range(W):
        age = _age(w, since, k, W)
        if age < youngest or (recent and k - age < bank[EARLIEST, SHARED]):
            continue
        information = 1.0 / bank[P22, w] - 1.0 / prior_var
        if information <= 1e-9:
            continue
        mean = (bank[GAIN, w] / bank[P22, w] - prior / prior_var) / information
        ratio = (mean - level) ** 2 / (1.0 / information + level_var)
        if ratio > highest:
            highest, slot = ratio, w
    raised = highest > threshold and not recent
    if slot >= 0 and (raised or (recent and highest > threshold)):
        age = _age(slot, since, k, W)
        if raised:
            bank[LEVEL_BEFORE, SHARED], bank[LEVEL_VAR_BEFORE, SHARED], bank[ALARM_TICK, SHARED] = (
                bank[LEVEL, SHARED],
                bank[LEVEL_VAR, SHARED],
                float(k),
            )
            bank[EARLIEST, SHARED] = float(k - W)
            bank[SUM_ALPHA, SHARED], bank[SUM_RATE, SHARED] = (
                0.0,
                0.0,
            )  # these sums contain the change of K, not disturbances
        bank[SELECTED, SHARED], bank[SELECTED_START, SHARED] = float(slot), float(k - age)
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
    prior, prior_var = settings[PRIOR_K], settings[PRIOR_K_VAR]
    inflation, keep, low, high = settings[INFLATION], settings[SMOOTHING], settings[LOWEST], settings[HIGHEST]
    model = settings[MODEL:THRESHOLD].reshape((2, 4))
    threshold, adaptive, hold = settings[THRESHOLD], settings[ADAPTIVE] > 0.0, settings[HOLD_VAR]
    W = bank.shape[1]
    best = 0
    if k == 0:
        bank[NIS] = 0.0
        bank[ERROR_ALPHA:ROWS] = 0.0
        for w in range(W):
            start(bank, settings, w, z0, z1)
        bank[SMOOTHED:ERROR_ALPHA, SHARED] = 0.0
        bank[SMOOTHED, SHARED], bank[LEVEL, SHARED], bank[LEVEL_VAR, SHARED] = 1.0, prior, 0.0
        bank[SELECTED, SHARED], bank[SELECTED_START, SHARED], bank[ALARM_TICK, SHARED] = -1.0, 0.0, -1e9
        bank[SQUARE_ALPHA, SHARED], bank[SQUARE_RATE, SHARED] = settings[NOISE_ALPHA], settings[NOISE_RATE]
    else:
        more0, more1 = 0.0, 0.0
        if adaptive:
            more0, more1 = disturbance(bank, settings, model, u, z0, z1, k)
        step(
            bank,
            model,
            u,
            settings[PROCESS_ALPHA] + more0,
            settings[PROCESS_CROSS],
            settings[PROCESS_RATE] + more1,
            inflation,
            settings[NOISE_ALPHA],
            settings[NOISE_RATE],
            z0,
            z1,
        )
        if k >= W:
            best = k % W
    remember(bank, z0, z1)
    raised = False
    if threshold > 0.0 and W > 1 and k > 0:
        raised = alarm(bank, settings, k)
        if bank[SELECTED, SHARED] >= 0.0:
            if k - bank[SELECTED_START, SHARED] < W:
                best = int(bank[SELECTED, SHARED])
            else:
                bank[SELECTED, SHARED] = -1.0
    gain, variance = bank[GAIN, best], bank[P22, best]
    information = max(
        0.0, 1.0 / variance - 1.0 / prior_var
    )  # information on K in the data alone, and its product with their mean
    weighted_mean = gain / variance - prior / prior_var
    if hold > 0.0:  # the last estimate, with this variance, replaces the prior of K
        variance = 1.0 / (information + 1.0 / hold)
        gain = variance * (weighted_mean + bank[SMOOTHED, SHARED] / hold)
    bounded = min(max(gain, low), high)
    if threshold > 0.0:
        since = k - bank[ALARM_TICK, SHARED]
        if raised:
            bank[SMOOTHED, SHARED], bank[ALARMS, SHARED] = bounded, bank[ALARMS, SHARED] + 1.0
        elif since <= ONSET_TICKS:
            share = max(1.0 - keep, 1.0 - since / ONSET_TICKS)
            bank[SMOOTHED, SHARED] += share * (bounded - bank[SMOOTHED, SHARED])
        elif hold > 0.0:
            # Each tick adds 1/W of the window's information: the smoother weights it accordingly, and holds without information.
            share = min(
                1.0 - keep, bank[SMOOTHED_VAR, SHARED] / (bank[SMOOTHED_VAR, SHARED] + W / max(information, 1e-9))
            )
            bank[SMOOTHED, SHARED] += share * (weighted_mean / max(information, 1e-9) - bank[SMOOTHED, SHARED])
            bank[SMOOTHED, SHARED] = min(max(bank[SMOOTHED, SHARED], low), high)
            bank[SMOOTHED_VAR, SHARED] = (1.0 - share) * bank[SMOOTHED_VAR, SHARED] + hold / 4000.0
        else:
            bank[SMOOTHED, SHARED] = keep * bank[SMOOTHED, SHARED] + (1.0 - keep) * bounded
        if since <= ONSET_TICKS:
            bank[SMOOTHED_VAR, SHARED] = variance
        if bank[SELECTED, SHARED] >= 0.0:
            bank[LEVEL, SHARED], bank[LEVEL_VAR, SHARED] = gain, variance
        else:
            bank[LEVEL, SHARED] += 0.02 * (gain - bank[LEVEL, SHARED])
            bank[LEVEL_VAR, SHARED] = max(0.1 * variance, 0.02 * 0.02)
    else:
        bank[SMOOTHED, SHARED] = keep * bank[SMOOTHED, SHARED] + (1.0 - keep) * bounded
    result = (
        bounded, sqrt(variance), bank[SMOOTHED, SHARED], gain, bank[ALPHA, best] + settings[OFFSET], bank[RATE, best], bank[NIS, best],
        bank[ALARMS, SHARED], bank[ERROR_ALPHA, best], bank[ERROR_RATE, best], sqrt(bank[ERROR_VAR_ALPHA, best]),
        sqrt(bank[ERROR_VAR_RATE, best]),
    )  # fmt: skip
    if W > 1 and k > 0:
        start(bank, settings, k % W, z0, z1)
    return result


def new_bank(filters: int) -> Array:
    """Return the state of W filters of (alpha, q, K), zero. The values that the filters share are in column ``SHARED``.

    Rows: X, P, normalized innovation squared (unused rows around it), shared values, innovations of the two readings, their variances.
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
