"""Alternatives for unknown inputs: a Kalman filter with the input in its state, and an observer without a model of the input.

The filter needs a model of the input: a random walk or a harmonic of known frequency. The observer (Gillijns and De Moor, Automatica 43
(2007) 111) inverts the plant with a delay of one sample, and exists only if the zeros of the plant allow it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from flightbed.core.compiled import compiled
from flightbed.estimation.reconstruction.input_model import InputModel

Array = npt.NDArray[np.float64]


class InputEstimate(NamedTuple):
    """Estimate at a sample.

    Attributes:
        input: (m,) from the Kalman filter u(k), the input of the period that begins now; from the observer u(k-1), the previous one.
        input_std: (m,) standard deviation of the input; infinite before the first estimate.
        state: (n,) x(k), from outputs up to y(k).
        innovation: (p,) y(k) minus its prediction.

    """

    input: Array
    input_std: Array
    state: Array
    innovation: Array


@dataclass(frozen=True, eq=False)
class InputDynamics:
    """Model of an input: s(k+1) = S s(k) + noise, u(k) = H s(k).

    Attributes:
        S: (l, l); H: (m, l).
        Q: (l, l) covariance of the noise, input units squared.
        P0: (l, l) covariance of s(0), whose mean is 0.

    """

    S: Array
    H: Array
    Q: Array
    P0: Array


def random_walk(inputs: int, *, step_std: float, initial_std: float) -> InputDynamics:
    """Return a random walk: u(k+1) = u(k) + white noise.

    Args:
        inputs: m, number of inputs.
        step_std: standard deviation of a step, input units.
        initial_std: standard deviation of u(0), input units.

    """
    one = np.eye(inputs)
    return InputDynamics(one, one, step_std**2 * one, initial_std**2 * one)


def harmonic(inputs: int, rad_per_sample: float, *, step_std: float, initial_std: float) -> InputDynamics:
    """Return a harmonic input of known frequency with unknown amplitude and phase: s rotates by a fixed angle per sample.

    Args:
        inputs: m, number of inputs, each with its own amplitude and phase.
        rad_per_sample: frequency, rad per sample.
        step_std: standard deviation of the change of both components of s per sample, input units.
        initial_std: standard deviation of both components of s(0), input units.

    """
    c, s = np.cos(rad_per_sample), np.sin(rad_per_sample)
    one, turn = np.eye(2 * inputs), np.array([[c, s], [-s, c]])
    S: Array = np.kron(np.eye(inputs), turn)
    H: Array = np.kron(np.eye(inputs), np.array([[1.0, 0.0]]))
    return InputDynamics(S, H, step_std**2 * one, initial_std**2 * one)


@compiled
def correct(x: Array, P: Array, C: Array, R: Array, y: Array) -> tuple[Array, Array, Array, Array]:
    """Return state, covariance (Joseph form), innovation and gain after correction by an output."""
    e = y - C @ x
    gain = np.linalg.solve(C @ P @ C.T + R, C @ P).T
    left = np.eye(x.size) - gain @ C
    corrected: tuple[Array, Array, Array, Array] = x + gain @ e, left @ P @ left.T + gain @ R @ gain.T, e, gain  # type: ignore[assignment]
    return corrected


class InputKalmanFilter:
    """Kalman filter of (x, s), the state and the state of the input's dynamics; owns its state. Takes one output per sample, in order.

    Args:
        dynamics: dynamics of the input.
        model: model of the first sample, and default of the later ones.
        process: (n, n) covariance of the other process noise in a sample.
        noise: (p, p) covariance of the output's noise, positive definite.
        state: (n,) x^(0); zeros if None.
        state_covariance: (n, n) covariance of x^(0).

    Raises:
        ValueError: dynamics and model have different numbers of inputs.

    """

    def __init__(
        self, dynamics: InputDynamics, model: InputModel, *, process: Array, noise: Array, state_covariance: Array,
        state: Array | None = None,
    ) -> None:  # fmt: skip
        if dynamics.H.shape[0] != model.inputs:
            raise ValueError(
                f"the dynamics have {dynamics.H.shape[0]} inputs, the model has {model.inputs}; they must agree"
            )
        self._dynamics, self._model = dynamics, model
        n, size = model.states, dynamics.S.shape[0]
        self._R = np.array(noise, dtype=np.float64)
        self._Q, self._P = np.zeros((n + size, n + size)), np.zeros((n + size, n + size))
        self._Q[:n, :n], self._Q[n:, n:] = process, dynamics.Q
        self._P[:n, :n], self._P[n:, n:] = state_covariance, dynamics.P0
        self._x = np.append(np.zeros(n) if state is None else state, np.zeros(size))
        self._gain, self._C = np.zeros((n + size, model.outputs)), np.zeros((model.outputs, n + size))
        self._F = np.zeros((n + size, n + size))
        self._F[n:, n:] = dynamics.S

    @property
    def gain(self) -> Array:
        """Return a copy of the gain (n + l, p) of the last correction of (x, s); zeros before the first."""
        return self._gain.copy()

    def update(self, y: Array, known: Array | None = None, *, model: InputModel | None = None) -> InputEstimate:
        """Take the output of the next sample; arguments as in ``RetrospectiveCost.update``."""
        model, d = self._model if model is None else model, self._dynamics
        n = model.states
        C, F = self._C, self._F
        C[:, :n], F[:n, :n], F[:n, n:] = model.C, model.A, model.B @ d.H
        y = np.atleast_1d(np.asarray(y, dtype=np.float64))
        x, P, innovation, self._gain = correct(self._x, self._P, C, self._R, y)
        self._x = F @ x
        self._x[:n] += model.known_part(known)
        self._P = F @ P @ F.T + self._Q
        std = np.sqrt(np.maximum(np.diag(d.H @ P[n:, n:] @ d.H.T), 0.0))
        return InputEstimate(d.H @ x[n:], std, x[:n], innovation)


def no_observer(model: InputModel) -> str | None:
    """Return the reason why no unknown-input observer exists, or None if one exists.

    Two conditions (Darouach, Zasadzinski and Xu, IEEE Trans. AC 39 (1994) 606): C B has rank m, so that each input appears in the output
    one sample later; and (T A, C) with T = I - B (C B)^+ C is detectable, so that modes hidden from the outputs decay. For equal numbers
    of inputs and outputs the undetectable modes are the zeros of (A, B, C), which must lie inside the unit circle.
    """
    CB = model.C @ model.B
    rank = int(np.linalg.matrix_rank(CB))
    if rank < model.inputs:
        return f"C B has rank {rank} for {model.inputs} unknown inputs"
    n = model.states
    free = (np.eye(n) - model.B @ np.linalg.pinv(CB) @ model.C) @ model.A
    for value in np.linalg.eigvals(free):
        if abs(value) >= 1.0 - 1e-9:
            pencil = np.vstack([free - value * np.eye(n), model.C])
            if np.linalg.matrix_rank(pencil, tol=1e-9 * max(1.0, float(np.linalg.norm(free)))) < n:
                return f"a mode at {np.real_if_close(value):.4g} is hidden behind the input and does not die away"
    return None


class UnknownInputObserver:
    """Unbiased minimum-variance estimate of state and input, for an arbitrary input; owns its state.

    Its input estimate is u(k-1) from outputs up to y(k): one sample late, with the noise of an inverse. Gillijns and De Moor (2007),
    S 3 and 4: x- = A x^, u^ = M (y - C x-), M = (F' R~^-1 F)^-1 F' R~^-1, F = C B, R~ = C P- C' + R; then x- + B u^ is corrected by the
    components of y that do not determine the input; there are none for equal numbers of inputs and outputs.

    Args:
        model: model of the first sample, and default of the later ones.
        process: (n, n) covariance of the other process noise in a sample.
        noise: (p, p) covariance of the output's noise, positive definite.
        state: (n,) x^(0); zeros if None.
        state_covariance: (n, n) covariance of x^(0).

    Raises:
        ValueError: no such observer exists for the first model; the message gives the reason.

    """

    def __init__(
        self, model: InputModel, *, process: Array, noise: Array, state_covariance: Array, state: Array | None = None
    ) -> None:
        if problem := no_observer(model):
            raise ValueError(f"no unknown-input observer: {problem}")
        self._model = model
        self._x = np.zeros(model.states) if state is None else np.array(state, dtype=np.float64)
        self._P = np.array(state_covariance, dtype=np.float64)
        self._Q, self._R = np.array(process, dtype=np.float64), np.array(noise, dtype=np.float64)
        self._before: tuple[InputModel, Array] | None = None  # model and known part of the previous period

    def update(self, y: Array, known: Array | None = None, *, model: InputModel | None = None) -> InputEstimate:
        """Take the output of the next sample; arguments as in ``RetrospectiveCost.update``. The first input estimate is nan."""
        model = self._model if model is None else model
        y, m = np.atleast_1d(np.asarray(y, dtype=np.float64)), model.inputs
        before, self._before = self._before, (model, model.known_part(known))
        if before is None:
            self._x, self._P, e, _ = correct(self._x, self._P, model.C, self._R, y)
            return InputEstimate(np.full(m, np.nan), np.full(m, np.inf), self._x, e)
        x, u, variance, self._P, e = _unbiased(
            self._x, self._P, before[0].A, before[0].B, before[1], model.C, self._Q, self._R, y
        )
        self._x = x
        return InputEstimate(u, np.sqrt(np.diag(variance)), x, e)


@compiled
def _unbiased(
    x: Array, P: Array, A: Array, B: Array, known: Array, C: Array, Q: Array, R: Array, y: Array
) -> tuple[Array, Array, Array, Array, Array]:
    """Return x^, u^, the covariance of u^, P and the innovation of one sample; Gillijns and De Moor (2007)."""
    x = A @ x + known
    P = A @ P @ A.T + Q
    e = y - C @ x
    F = C @ B
    weighted = np.linalg.solve(C @ P @ C.T + R, F)
    variance = np.linalg.inv(F.T @ weighted)
    M = variance @ np.ascontiguousarray(weighted.T)
    u = M @ e
    x = x + B @ u
    left = np.eye(x.size) - B @ M @ C
    cross = -B @ M @ R  # covariance of the error of x with the noise of y
    P = left @ P @ left.T - cross @ M.T @ B.T
    if C.shape[0] > B.shape[1]:
        PC = P @ C.T + cross
        spread = C @ PC + R + cross.T @ C.T  # covariance of y - C x, of rank p - m
        gain = PC @ np.linalg.pinv(spread, 1e-10)
        x = x + gain @ (y - C @ x)
        P = P - gain @ PC.T
    return x, u, variance, 0.5 * (P + P.T), e
