"""Reconstruction of an unknown input in compiled code: ``elevator.py``, ``gust.py`` and their methods on one flat memory.

The operations and their order are those of ``ElevatorReconstruction``, ``GustReconstruction``, ``RetrospectiveCost``, ``InputKalmanFilter``
and ``ActuatorOnBoard``, so the results are bit-identical; a test compares both.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite, nan
from typing import Any

import numpy as np

from flightbed.avionics import pitch_kernels
from flightbed.core.by_address import by_address
from flightbed.core.compiled import Array, compiled
from flightbed.core.records import layout, record, size
from flightbed.core.units import DEG
from flightbed.estimation.loop_gain import filter_bank
from flightbed.estimation.packed import ESTIMATE, MEASUREMENT
from flightbed.estimation.reconstruction import retrospective_kernels
from flightbed.estimation.reconstruction.input_kalman import InputDynamics, correct
from flightbed.estimation.reconstruction.regression_kernels import (
    ALARMS,
    MARKS,
    OUT,
    STAGGERED,
    SUMS,
    Following,
    follow,
    restart,
)
from flightbed.estimation.reconstruction.retrospective_cost import RetrospectiveConfig

FAR = 1e4  # innovation, in standard deviations, beyond which a method restarts from the readings
_FOLLOWING_SETTINGS, _ROUGH_SETTINGS, _NUMBERS = 11, 23, 7
HEAD = layout(
    (
        "states", "is_walk", "take", "order", "horizon", "initial_covariance", "is_scheduled", "dt", "window", "follows",
        "sigma_alpha", "sigma_q", "process_alpha", "process_q", "kept",
        "has_actuator", "delay", "share", "mean", "step", "low", "high", "lagged", "position",
        "method", "tick", "is_lost", "has_before", "acting", "slope", "offset",
    )
)  # fmt: skip
_AFTER = size(HEAD)


def pack(values: Mapping[str, float], *arrays: Array) -> Array:
    """Return a memory: the named values of its head, and then the arrays."""
    method = _take_walk_at if values.get("is_walk", 0.0) > 0.0 else _take_retrospective_at
    values = {**values, "take": _METHODS.address(method)}
    return np.concatenate([[float(values.get(name, 0.0)) for name in HEAD.names or ()], *(a.ravel() for a in arrays)])


def walk_memory(process: Array, known: Array, walk: InputDynamics) -> Array:
    """Return the memory of a filter of (x, u) before its start.

    Args:
        process, known: (n, n) covariances of the process noise and of x at the start.
        walk: dynamics of the one unknown input.

    """
    n = len(process)
    Q, P = np.zeros((n + 1, n + 1)), np.zeros((n + 1, n + 1))
    Q[:n, :n], Q[n:, n:] = process, walk.Q
    P[:n, :n], P[n:, n:] = known, walk.P0
    return np.concatenate([np.zeros(n + 1), P.ravel(), Q.ravel(), P.ravel(), np.zeros(2 * (n + 1))])


def retrospective_memory(n: int, config: RetrospectiveConfig) -> Array:
    """Return the memory of a retrospective cost of n states before its start, in the order of ``_retrospective``."""
    horizon, length, deep = len(config.delays), 3 * config.order, len(config.delays) + config.order
    arrays = length * length + length + deep + 2 * (deep + 1) + 2 * horizon * horizon + horizon * n * (n + 1)
    numbers = [config.regularization, config.forgetting, *config.saturation, config.covariance_bound, 0.0, 0.0]
    return np.concatenate([np.zeros(n + arrays), numbers, numbers])


@compiled
def _walk(memory: Array, n: int) -> tuple[Array, Array, Array, Array, Array]:
    """Return x, P, Q, initial P and gain of the filter of (x, s) in the memory of a method."""
    wide = n + 1
    square, a = wide * wide, wide
    return (
        memory[:wide], memory[a : a + square].reshape((wide, wide)), memory[a + square : a + 2 * square].reshape((wide, wide)),
        memory[a + 2 * square : a + 3 * square].reshape((wide, wide)),
        memory[a + 3 * square : a + 3 * square + 2 * wide].reshape((wide, 2)),
    )  # fmt: skip


@compiled
def _retrospective(memory: Array, n: int, order: int, horizon: int) -> tuple[Array, ...]:
    """Return x, theta, P, U, Z, H, As, Bs, numbers and initial numbers of the retrospective cost in the memory of a method."""
    length, deep, a = 3 * order, horizon + order, 0
    x, a = memory[a : a + n], a + n
    P, a = memory[a : a + length * length].reshape((length, length)), a + length * length
    theta, a = memory[a : a + length].reshape((1, length)), a + length
    U, a = memory[a : a + deep].reshape((deep, 1)), a + deep
    Z, a = memory[a : a + 2 * (deep + 1)].reshape((deep + 1, 2)), a + 2 * (deep + 1)
    H, a = memory[a : a + 2 * horizon * horizon].reshape((horizon, horizon, 2, 1)), a + 2 * horizon * horizon
    As, a = memory[a : a + horizon * n * n].reshape((horizon, n, n)), a + horizon * n * n
    Bs, a = memory[a : a + horizon * n].reshape((horizon, n, 1)), a + horizon * n
    numbers, first = memory[a : a + _NUMBERS], memory[a + _NUMBERS : a + 2 * _NUMBERS]
    return x, theta, P, U, Z, H, As, Bs, numbers, first


@compiled
def _begin(head: Any, memory: Array, A: Array, B: Array, C: Array, state: Array) -> None:
    """Start a method at a state (n,)."""
    n = A.shape[0]  # a literal argument would be compiled as a function of its own
    if head.is_walk > 0.0:
        x, P, _, first, gain = _walk(memory, n)
        x[:n], x[n] = state, 0.0
        P[:, :], gain[:, :] = first, 0.0
        return
    order, horizon = int(head.order), int(head.horizon)
    x, theta, P, U, Z, H, As, Bs, numbers, first = _retrospective(memory, n, order, horizon)
    x[:] = state
    theta[:, :], U[:, :], Z[:, :], numbers[:] = 0.0, 0.0, 0.0, first
    P[:, :] = 0.0
    for i in range(P.shape[0]):
        P[i, i] = head.initial_covariance
    for i in range(horizon):
        As[i], Bs[i] = A, B
    retrospective_kernels.markov(C, As, Bs, H[0])
    for i in range(1, horizon):
        H[i] = H[0]


@compiled
def _take_walk(memory: Array, A: Array, B: Array, C: Array, known: Array, y: Array) -> tuple[float, Array, Array]:
    """Return input, state and innovation; ``InputKalmanFilter.update``."""
    n = A.shape[0]
    x, P, Q, _, gain = _walk(memory, n)
    wide_C, F = np.zeros((2, n + 1)), np.zeros((n + 1, n + 1))
    wide_C[:, :n], F[:n, :n], F[:n, n], F[n, n] = C, A, B[:, 0], 1.0
    corrected, spread, innovation, found = correct(x, P, wide_C, np.eye(2), y)
    gain[:, :] = found
    x[:] = F @ corrected
    x[:n] += known
    P[:, :] = F @ spread @ F.T + Q
    return float(corrected[n]), corrected[:n], innovation


@compiled
def _take_retrospective(
    memory: Array, order: int, horizon: int, A: Array, B: Array, C: Array, known: Array, y: Array
) -> tuple[float, Array, Array]:
    """Return input, state and innovation; ``RetrospectiveCost.update``."""
    x, theta, P, U, Z, H, As, Bs, numbers, _ = _retrospective(memory, A.shape[0], order, horizon)
    state = x.copy()
    delays, retained = np.arange(horizon), np.zeros((horizon, horizon), dtype=np.int64)
    for i in range(horizon):
        retained[i, : horizon - i] = 1
    z, _best = retrospective_kernels.take(
        y, (A, B, C), known, (x, theta, P, U, Z, H, As, Bs), (delays, retained, delays + 1, delays),
        (np.eye(2 * horizon), np.eye(horizon)), numbers, order, retrospective_kernels.CONSTANT, retrospective_kernels.ADAPTS,
    )  # fmt: skip
    return U[0, 0], state, z


@compiled
def _take_walk_at(
    memory: Array, _order: int, _horizon: int, A: Array, B: Array, C: Array, known: Array, y: Array, out: Array
) -> None:
    """Write input, state and innovation of ``_take_walk`` into ``out``; called by address."""
    n = A.shape[0]
    out[_INPUT], out[_STATE : _STATE + n], out[_STATE + n :] = _take_walk(memory, A, B, C, known, y)


@compiled
def _take_retrospective_at(
    memory: Array, order: int, horizon: int, A: Array, B: Array, C: Array, known: Array, y: Array, out: Array
) -> None:
    """Write input, state and innovation of ``_take_retrospective`` into ``out``; called by address."""
    n = A.shape[0]
    out[_INPUT], out[_STATE : _STATE + n], out[_STATE + n :] = _take_retrospective(
        memory, order, horizon, A, B, C, known, y
    )


_INPUT, _STATE = 0, 1  # places in ``out``; the innovation follows the state
_METHODS = by_address(("array", "int", "int", "matrix", "matrix", "matrix", "array", "array", "array"), "none")
_take_at = _METHODS.call


@compiled
def _take(head: Any, memory: Array, A: Array, B: Array, C: Array, known: Array, y: Array) -> tuple[float, Array, Array]:
    """Return input, state and innovation of the method."""
    n = A.shape[0]
    out = np.empty(n + 1 + y.size)
    _take_at(head.take, memory, int(head.order), int(head.horizon), A, B, C, known, y, out)
    return out[_INPUT], out[_STATE : _STATE + n], out[_STATE + n :]


@compiled
def _linearize(head: Any, schedule: Array, rows: Array, work: Array, m: Any, acting: float) -> None:
    """Write the model of the period that starts at a measurement into ``rows``; ``PitchMotion.rows``."""
    if head.is_scheduled > 0.0:
        pitch_kernels.local_model(
            schedule, rows, work, 1.0, head.dt, m.alpha_rad, m.q_rad_s, acting, m.mach, m.altitude_m, m.theta_rad, m.phi_rad, 0.0
        )  # fmt: skip


@compiled
def _response(head: Any, queue: Array, command: float, k: int) -> float:
    """Return the mean position of the on-board actuator over the period that ends now, rad; ``ActuatorOnBoard``. nan at tick 0."""
    if head.has_actuator == 0.0 or k == 0:
        return nan
    if head.position != head.position:
        head.lagged = head.position = command
        queue[:] = command
    arrived = command
    if queue.size > 0:
        arrived = queue[0]
        for i in range(queue.size - 1):
            queue[i] = queue[i + 1]
        queue[queue.size - 1] = command
    arrived = min(max(arrived, head.low), head.high)
    lagged, begun = head.lagged, head.position
    head.lagged += head.share * (arrived - lagged)
    way = head.lagged - begun
    late = abs(way) > head.step
    if late:
        head.position = begun + (head.step if way > 0.0 else -head.step)
    else:
        head.position = head.lagged
    if late or begun != lagged:
        return float(0.5 * (begun + head.position))
    return float(begun + head.mean * (arrived - begun))


@compiled
def _following(memory: Array, n: int) -> tuple[Following, int]:
    """Return the memory of the regressions, and its size."""
    count, a = 1 + 2 * STAGGERED, 0
    response, a = memory[a : a + 2 * n].reshape((n, 2)), a + 2 * n
    noise, a = memory[a : a + n * n].reshape((n, n)), a + n * n
    cross, a = memory[a : a + 2 * n * count].reshape((n, 2 * count)), a + 2 * n * count
    spread, a = memory[a : a + 3 * count].reshape((count, 3)), a + 3 * count
    sums, a = memory[a : a + SUMS * count].reshape((count, SUMS)), a + SUMS * count
    ages, a = memory[a : a + count], a + count
    signs, a = memory[a : a + count], a + count
    marks, a = memory[a : a + MARKS], a + MARKS
    return Following(response, noise, cross, spread, sums, ages, signs, marks), a


@compiled
def _propagation(head: Any, method: Array, F: Array, G: Array, A: Array, B: Array) -> tuple[Array, Array]:
    """Return the propagation of a method's error after ``take``, (n, n) and (n, 2); see ``methods.InputReconstruction``.

    ``F`` and ``G`` belong to the retrospective cost and are updated.
    """
    n = F.shape[0]
    if head.is_walk > 0.0:
        gain = _walk(method, A.shape[0])[4]
        ahead, corrected, given = np.eye(n), np.eye(n), np.empty((n, 2))
        ahead[:2, :2], ahead[:2, OUT] = A, -B[:, 0]
        corrected[:2, :2] -= gain[:2]
        corrected[OUT, :2] = gain[OUT]
        given[:2], given[OUT] = -gain[:2], gain[OUT]
        return ahead @ corrected, ahead @ given
    order = int(head.order)
    theta = _retrospective(method, A.shape[0], order, int(head.horizon))[1]
    F[:2, :2], F[OUT, 2:] = A, theta[0]
    F[:2, 2:] = -B @ theta
    found, given = F.copy(), G.copy()
    newest = 2 + order
    F[newest : newest + 2, :2] = np.eye(2)
    G[newest : newest + 2] = np.eye(2)
    return found, given


@compiled
def observe_elevator(
    memory: Array, now: Array, _then: Array, _turning: Array, _turned: Array, command: float, k: int, out: Array
) -> None:
    """Take the readings of tick k: ``ElevatorReconstruction.update`` for compiled callers; see ``packed.Packable``."""
    head, m = record(memory, 0, HEAD), record(now, 0, MEASUREMENT)
    n, order, window, a = int(head.states), int(head.order), int(head.window), _AFTER
    queue, a = memory[a : a + int(head.delay)], a + int(head.delay)
    rows, a = memory[a : a + 8].reshape((2, 4)), a + 8
    work, a = memory[a : a + 8].reshape((2, 4)), a + 8
    before, a = memory[a : a + 8].reshape((2, 4)), a + 8
    bank, a = memory[a : a + filter_bank.ROWS].reshape((filter_bank.ROWS, 1)), a + filter_bank.ROWS
    rough, a = memory[a : a + _ROUGH_SETTINGS], a + _ROUGH_SETTINGS
    settings, a = memory[a : a + _FOLLOWING_SETTINGS], a + _FOLLOWING_SETTINGS
    following, used = _following(memory[a:], n)
    a += used
    F, a = memory[a : a + n * n].reshape((n, n)), a + n * n
    G, a = memory[a : a + 2 * n].reshape((n, 2)), a + 2 * n
    schedule_at = a + int(head.method)
    method, schedule = memory[a:schedule_at], memory[schedule_at:]

    asked = _response(head, queue, command, k) / DEG
    _linearize(head, schedule, rows, work, m, head.acting)
    sigma, y = np.empty(2), np.empty(2)
    sigma[0], sigma[1] = head.sigma_alpha, head.sigma_q
    y[0], y[1] = m.alpha_rad / sigma[0], m.q_rad_s / sigma[1]
    A, B, C, known = np.empty((2, 2)), np.empty((2, 1)), np.eye(2), np.empty(2)
    model = np.empty((2, 4))
    for i in range(2):
        for j in range(2):
            A[i, j] = rows[i, j] / sigma[i] * sigma[j]
        B[i, 0], known[i] = rows[i, 2] / sigma[i] * DEG, rows[i, 3] / sigma[i]
        model[i, 0], model[i, 1], model[i, 2], model[i, 3] = A[i, 0], A[i, 1], B[i, 0], known[i]
    deflection = m.elevator_mean_rad / DEG
    if not isfinite(np.sum(model) + np.sum(y) + deflection):
        head.is_lost = 1.0
        out[:] = nan
        record(out, 0, ESTIMATE).alarms = following.marks[ALARMS]
        return
    if head.is_lost > 0.0:  # restart, keeping K
        head.is_lost, head.has_before = 0.0, 0.0
        restart(following, window)
    newest = 2 + order
    if head.has_before == 0.0:
        _begin(head, method, A, B, C, y)
        if head.is_walk == 0.0:
            F[newest : newest + 2, :2], G[newest : newest + 2] = 0.0, 0.0
    process = np.empty(2)
    process[0], process[1] = head.process_alpha, head.process_q
    if head.has_before > 0.0 and head.follows > 0.0 and head.tick >= window:
        more = filter_bank.disturbance(
            bank, rough, before, head.slope * deflection + head.offset, y[0], y[1], int(head.tick)
        )
        process[0] += more[0]
        process[1] += more[1]
    filter_bank.remember(bank, y[0], y[1])
    before[:, :] = model
    head.has_before = 1.0
    head.tick += 1.0
    found, state, innovation = _take(head, method, A, B, C, known, y)
    ahead, given = _propagation(head, method, F, G, A, B)
    if not (isfinite(found) and abs(innovation[0]) < FAR and abs(innovation[1]) < FAR):
        _begin(head, method, A, B, C, y)
        if head.is_walk == 0.0:
            F[newest : newest + 2, :2], G[newest : newest + 2] = 0.0, 0.0
        found, state, innovation = _take(head, method, A, B, C, known, y)
        ahead, given = _propagation(head, method, F, G, A, B)
        restart(following, window)
    estimate = follow(
        following.response, following.noise, following.cross, following.spread, following.sums, following.ages,
        following.offset_signs, following.marks, settings, ahead, given, process, B[:, 0].copy(), innovation, found, deflection, asked,
    )  # fmt: skip
    head.slope, head.offset = estimate.slope, estimate.offset
    head.acting = min(max(found, -90.0), 90.0) * DEG
    to = record(out, 0, ESTIMATE)
    to.effectiveness, to.effectiveness_std = estimate.effectiveness, estimate.effectiveness_std
    to.effectiveness_smoothed, to.effectiveness_raw = estimate.effectiveness_smoothed, estimate.effectiveness_raw
    to.alpha_rad, to.q_rad_s = state[0] * sigma[0], state[1] * sigma[1]
    to.nis, to.alarms = estimate.nis, estimate.alarms
    to.innovation_alpha_rad, to.innovation_q_rad_s = (
        estimate.innovation_alpha * sigma[0],
        estimate.innovation_q * sigma[1],
    )
    to.innovation_alpha_std_rad = estimate.innovation_alpha_std * sigma[0]
    to.innovation_q_std_rad_s = estimate.innovation_q_std * sigma[1]
    to.reconstructed_rad, to.reconstructed_std_rad = found * DEG, estimate.noise_std * DEG
    to.offset_rad, to.offset_std_rad, to.verdict = estimate.offset * DEG, estimate.offset_std * DEG, estimate.verdict


@compiled
def observe_gust(
    memory: Array, now: Array, then: Array, _turning: Array, _turned: Array, _command: float, k: int, out: Array
) -> None:
    """Take the readings of tick k: ``GustReconstruction.update`` for compiled callers; see ``packed.Packable``."""
    head, m, last = record(memory, 0, HEAD), record(now, 0, MEASUREMENT), record(then, 0, MEASUREMENT)
    a = _AFTER
    rows, a = memory[a : a + 8].reshape((2, 4)), a + 8
    work, a = memory[a : a + 8].reshape((2, 4)), a + 8
    schedule_at = a + int(head.method)
    method, schedule = memory[a:schedule_at], memory[schedule_at:]
    to = record(out, 0, ESTIMATE)
    out[:] = nan  # K is not estimated
    to.alarms = 0.0
    if k == 0:
        to.alpha_rad, to.q_rad_s, to.reconstructed_rad = m.alpha_rad, m.q_rad_s, 0.0
        return
    u = m.elevator_mean_rad
    _linearize(head, schedule, rows, work, last, u)
    sigma, y, inputs = np.empty(3), np.empty(2), np.ones(2)
    sigma[0], sigma[1], sigma[2] = head.sigma_alpha, head.sigma_q, head.sigma_alpha
    y[0], y[1], inputs[0] = last.alpha_rad / sigma[0], last.q_rad_s / sigma[1], u
    A, B, C, G = np.zeros((3, 3)), np.empty((3, 1)), np.eye(2, 3), np.zeros((3, 2))
    A[:2, :2], A[2, 2], G[:2] = rows[:, :2], head.kept, rows[:, 2:]
    B[0, 0], B[1, 0], B[2, 0] = 0.5 * (1.0 + A[0, 0]), 0.5 * A[1, 0], 1.0
    for i in range(3):
        for j in range(3):
            A[i, j] = A[i, j] * sigma[j] / sigma[i]
        B[i, 0] = B[i, 0] * sigma[2] / sigma[i]
        G[i, 0], G[i, 1] = G[i, 0] / sigma[i], G[i, 1] / sigma[i]
    known, first = G @ inputs, np.zeros(3)
    first[:2] = y
    if head.has_before == 0.0:
        _begin(head, method, A, B, C, first)
        head.has_before = 1.0
    _, state, innovation = _take(head, method, A, B, C, known, y)
    if not (isfinite(np.sum(state)) and abs(innovation[0]) < FAR and abs(innovation[1]) < FAR):
        _begin(head, method, A, B, C, first)
        _, state, innovation = _take(head, method, A, B, C, known, y)
    e_alpha, e_q = innovation[0] * sigma[0], innovation[1] * sigma[1]
    to.alpha_rad, to.q_rad_s, to.reconstructed_rad = state[0] * sigma[0], state[1] * sigma[1], state[2] * sigma[2]
    to.innovation_alpha_rad = e_alpha if isfinite(e_alpha) else nan
    to.innovation_q_rad_s = e_q if isfinite(e_q) else nan
