"""Microseconds per tick of a 30-sample moving window of the joint filter, by three methods with the same results.

    python tools/tables/window.py

bank      30 staggered filters, advanced together by one compiled call per tick (what flightbed flies)
refilter  one filter, run afresh over the stored window by one compiled call per tick
filterpy  one filter of the filterpy package, run afresh over the window in Python

The three are timed in turn over the same record; medians and ranges over the rounds, and the ratios round by round.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from filterpy.kalman import KalmanFilter
from numba import njit

from flightbed.core.timing import interleaved, ratios, seconds, spread
from flightbed.estimation.loop_gain import filter_bank
from flightbed.studies.methods import joint

WINDOW, TICKS, ROUNDS = 30, 1000, 7
A, B = np.array([[0.9912, 0.00942], [0.0203, 0.99]]), np.array([-0.0002, -0.1372])
R, Q = np.array([2.7e-7, 3.7e-6]), np.diag([1e-8, 1e-6])
X0, P0 = np.array([0.0, 0.0, 0.8]), np.diag([2.7e-7, 3.7e-6, 0.4])
MODEL = np.column_stack([A, B, np.zeros(2)])

rng = np.random.default_rng(0)
u = 0.02 * rng.standard_normal(TICKS)
z = np.empty((TICKS, 2))
x = np.zeros(2)
for k in range(TICKS):
    x = A @ x + 0.5 * B * u[k]
    z[k] = x + np.sqrt(R) * rng.standard_normal(2)


def bank() -> list[float]:
    """Advance the bank; K-hat at every tick."""
    state = filter_bank.new_bank(WINDOW)
    settings = filter_bank.pack_settings(
        Q=Q, x0=X0, P0=P0, inflation=1.0, begin=filter_bank.FIXED, keep=0.9, bounds=(-9.0, 9.0), r=R, model=MODEL
    )
    return [filter_bank.tick(state, settings, u[k], z[k, 0], z[k, 1], k)[3] for k in range(TICKS)]


@njit(cache=True)
def _refilter(X, P, T, model, Q, R, H, u, z, x0, P0):
    X[:, 0] = x0
    P[:, :, 0] = P0
    for k in range(len(u)):
        joint.predict(X, P, T, model, u[k], Q, 1.0)
        joint.correct(X, P, T, H, R, (z[k, 0], z[k, 1]))
    return X[2, 0]


def refilter() -> list[float]:
    """Run one filter over each window."""
    X, P, T, H = np.zeros((3, 1)), np.zeros((3, 3, 1)), np.zeros((4, 3, 1)), np.eye(2)
    return [
        _refilter(X, P, T, MODEL, Q, R, H, u[k - WINDOW + 1 : k + 1], z[k - WINDOW + 1 : k + 1], X0, P0)
        for k in range(WINDOW, TICKS)
    ]


def with_filterpy(ticks: int = 60) -> list[float]:
    """Run filterpy over each window; fewer ticks, because it is slow."""
    found = []
    for k in range(WINDOW, ticks):
        f = KalmanFilter(dim_x=3, dim_z=2)
        f.x, f.P, f.R, f.H, f.Q = X0.copy(), P0.copy(), np.diag(R), np.eye(2, 3), np.zeros((3, 3))
        f.Q[:2, :2] = Q
        for i in range(k - WINDOW + 1, k + 1):
            f.F = np.block([[A, (B * u[i])[:, None]], [np.zeros((1, 2)), np.ones((1, 1))]])
            f.predict()
            f.update(z[i])
        found.append(float(f.x[2]))
    return found


def _timed(way: Callable[[], list[float]], ticks: int) -> float:
    return seconds(way) / ticks * 1e6


if __name__ == "__main__":
    one, two, three = bank(), refilter(), with_filterpy()
    np.testing.assert_allclose(one[WINDOW:], two, rtol=0, atol=1e-10)
    np.testing.assert_allclose(two[: len(three)], three, rtol=0, atol=1e-10)
    ways = {"bank": (bank, one), "refilter": (refilter, two), "filterpy": (with_filterpy, three)}
    times = interleaved({name: partial(_timed, way, len(found)) for name, (way, found) in ways.items()}, ROUNDS)
    for name, values in times.items():
        print(f"{name:9} {spread(values, '.2f')} us, {spread(ratios(values, times['bank']), '.1f')} x the bank")
