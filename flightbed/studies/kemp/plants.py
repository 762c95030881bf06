"""Plants of the thesis, constant and time-varying, in observable-canonical form, and their responses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from flightbed.core.compiled import compiled
from flightbed.studies.kemp import printed

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Record:
    """Record of a simulation: true parameters, input and readings.

    Attributes:
        theta: (N, 2n) a_0 .. a_(n-1), b_0 .. b_(n-1) at sample k, which determine y(k + 1).
        u: (N,) input at sample k.
        y: (N,) reading at sample k.

    """

    theta: Array
    u: Array
    y: Array


@compiled
def advance(x: Array, theta: Array, u: float, w: Array) -> None:
    """x+ = A x + b u + w in observable-canonical form, Kemp eq (3.1); x (n,) is updated."""
    n = x.shape[0]
    last = x[n - 1]
    for i in range(n - 1, -1, -1):
        x[i] = (x[i - 1] if i > 0 else 0.0) + theta[i] * last + theta[n + i] * u + w[i]


@compiled
def respond(theta: Array, u: Array, w: Array, v: Array) -> Array:
    """Return the readings y(k) = x_n(k) + v(k) from rest; theta (N, 2n), u (N,), w (N, n), v (N,)."""
    x = np.zeros(w.shape[1])
    y = np.zeros(u.shape[0])
    for k in range(u.shape[0]):
        y[k] = x[-1] + v[k]
        advance(x, theta[k], u[k], w[k])
    return y


def parameters(plant: str) -> Array:
    """Return a_0 .. a_(n-1), b_0 .. b_(n-1) of a plant with constant parameters, eq (2.7)."""
    denominator, numerator = printed.TRANSFER_FUNCTIONS[plant]
    return np.concatenate([-np.array(denominator[:0:-1]), np.array(numerator[::-1])])


def history(plant: str, samples: int) -> Array:
    """Return the parameters at every sample, (samples, 2n).

    Plants: A to D and F; "E" of Figures 4.1 to 4.3, which drifts from sample 50 to 100 and jumps at 150; "E stepped" of Figures 4.4 and
    7.1, which jumps at 50 to the end of that drift, and at 150.
    """
    if not plant.startswith("E"):
        return np.tile(parameters(plant), (samples, 1))
    k = np.arange(samples)
    first, second, third = printed.E_CHANGES
    drift = np.clip((k - first) / (second - first), 0.0, 1.0) if plant == "E" else (k >= first).astype(np.float64)
    alpha = np.where(k < third, 2.0 - 0.5 * drift, 2.0)
    beta = np.where(k < third, 2.0 - drift, 2.5)
    a1, a0, b2, b0 = printed.E_FIXED
    constant = np.ones(samples)
    return np.column_stack([a0 * constant, -a1 * constant, alpha, -b0 * constant, -beta, b2 * constant])


def noise(rng: np.random.Generator, samples: int, order: int, r: float, q: float) -> tuple[Array, Array]:
    """Return process noise (samples, n) of variance q on each state and measurement noise (samples,) of variance r, eq (3.3)."""
    v, w = rng.standard_normal(samples), rng.standard_normal((samples, order))
    return np.sqrt(q) * w, np.sqrt(r) * v


def record(plant: str, r: float, q: float, samples: int, seed: int) -> Record:
    """Return the response of a plant from rest to white noise of variance 1, eq (3.2).

    A seed gives the same input and, up to their standard deviations, the same noises in all cases. ``samples`` includes k = 0.
    """
    rng = np.random.default_rng(seed)
    u, theta = rng.standard_normal(samples), history(plant, samples)
    return Record(theta, u, respond(theta, u, *noise(rng, samples, theta.shape[1] // 2, r, q)))
