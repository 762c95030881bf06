"""One run of an example: signals from a seed, reconstruction of the input, and error measures."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf, pi, sqrt
from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from flightbed.estimation.reconstruction.input_model import InputModel
from flightbed.estimation.reconstruction.retrospective_cost import RetrospectiveConfig, RetrospectiveCost
from flightbed.studies.gupta import plants, printed

Array = npt.NDArray[np.float64]

LAST = 100  # samples at the end of a run over which errors are taken
WITHIN = 0.02  # a run has converged if its error, as a share of the input's amplitude, is below this
FORGETTING = 0.99  # lambda of "with forgetting"; the paper defines lambda and prints no value
COVARIANCE_BOUND = 1e12  # with forgetting only; see RetrospectiveConfig
_DIVERGED = 1e9  # |u^| in amplitudes at which a run is stopped
_RIGID_STD, _MISSILE_STD = (1.0, 1.0), (1.0, 0.1, 0.05)  # initial states: m, m/s; g, rad/s, rad


@dataclass(frozen=True)
class Case:
    """Settings of an example; the estimator starts from x^ = 0.

    Attributes:
        example: "1" ... "5".
        model_damping: damping in the estimator's model, N s/m; None for the true damping.
        period_s: T_s, s.
        samples: number of samples.
        order, initial_covariance, regularization, regularized_by, forgetting, saturation, delays, retained: as in RetrospectiveConfig.
        initial_scale: factor on the standard deviations of the initial states.
        noise_share: standard deviation of the output's noise, as a share of the output's RMS under the input alone.

    """

    example: str
    period_s: float
    samples: int
    order: int
    initial_covariance: float
    regularization: float = 0.0
    model_damping: float | None = None
    regularized_by: Literal["constant", "performance", "error"] = "constant"
    forgetting: float = 1.0
    saturation: float = inf
    delays: tuple[int, ...] = (0,)
    retained: tuple[tuple[int, ...], ...] = ((1,),)
    initial_scale: float = 1.0
    noise_share: float = 0.0


_CHOSEN_PERIOD_S = 0.2  # example 5
_SAMPLES = {"1": 1000, "2": 1000, "3": 300, "4": 3000, "5": 1000}


def as_printed(example: str, model_damping: float | None = None) -> Case:
    """Return an example with the printed settings, without forgetting.

    Args:
        example: "1" ... "5".
        model_damping: damping of the estimator's model, N s/m, for example 4.

    """
    p = printed.SETTINGS[example]
    if example == "3":
        model_damping = printed.MODEL_DAMPING_3
    period_s = p.period_s or _CHOSEN_PERIOD_S
    return Case(example, period_s, _SAMPLES[example], p.order, p.initial_covariance, p.regularization, model_damping)


def forgetful(case: Case) -> Case:
    """Return the case with forgetting factor ``FORGETTING``."""
    return replace(case, forgetting=FORGETTING)


EXAMPLES = {
    "1 rigid body": as_printed("1"),
    "2 damped rigid body": as_printed("2"),
    "4 oscillator, c_0 = 4": as_printed("4", printed.MODEL_DAMPING_4[0]),
    "4 oscillator, c_0 = 10": as_printed("4", printed.MODEL_DAMPING_4[1]),
    "5 missile": as_printed("5"),
}


def models(case: Case) -> tuple[InputModel, InputModel]:
    """Return the models of the plant and of the estimator."""
    if case.example == "5":
        return plants.missile(case.period_s), plants.missile(case.period_s)
    damping = 0.0 if case.example == "1" else printed.DAMPING
    stiffness = printed.STIFFNESS if case.example in ("3", "4") else 0.0
    model_damping = damping if case.model_damping is None else case.model_damping
    return plants.oscillator(damping, stiffness, case.period_s), plants.oscillator(
        model_damping, stiffness, case.period_s
    )


def initial_std(case: Case) -> Array:
    """Return the standard deviations of the initial states, (n,)."""
    return case.initial_scale * np.array(_MISSILE_STD if case.example == "5" else _RIGID_STD)


class Signals(NamedTuple):
    """Simulated signals of a plant.

    Attributes:
        input: (N,) u; in example 3 the force (c_0 - c) q' of the damping error.
        equivalent: (N,) steady-state input with which the estimator's model has the plant's output under u; in example 3 equal to
            ``input``, an approximation for short periods.
        states: (N, n).
        outputs: (N,) outputs with noise.
        noise_std: standard deviation of the noise.

    """

    input: Array
    equivalent: Array
    states: Array
    outputs: Array
    noise_std: float


def signals(seed: int, case: Case) -> Signals:
    """Simulate the plant of a case from a random initial state, with a random phase of the input and the noise of the case."""
    rng = np.random.default_rng(seed)
    plant, model = models(case)
    x = rng.standard_normal(plant.states) * initial_std(case)
    phase = rng.uniform(0.0, 2.0 * pi)
    amplitude = 0.0 if case.example == "3" else printed.AMPLITUDE
    angles = printed.RAD_PER_SAMPLE * np.arange(case.samples) + phase
    u, states = amplitude * np.sin(angles), np.empty((case.samples, plant.states))
    for k in range(case.samples):
        states[k] = x
        x = plant.A @ x + plant.B[:, 0] * u[k]
    gain = plants.response(plant, printed.RAD_PER_SAMPLE)
    std = case.noise_share * abs(gain) * amplitude / sqrt(2.0)
    outputs = states @ plant.C[0] + std * rng.standard_normal(case.samples)
    if case.example == "3":
        assert case.model_damping is not None
        missing = (case.model_damping - printed.DAMPING) * states[:, 1]
        return Signals(missing, missing, states, outputs, std)
    ratio = gain / plants.response(model, printed.RAD_PER_SAMPLE)
    return Signals(u, amplitude * np.imag(ratio * np.exp(1j * angles)), states, outputs, std)


class History(NamedTuple):
    """History of a reconstruction; nan after a run is stopped.

    Attributes:
        signals: signals of the plant.
        input: (N,) u^(k).
        states: (N, n) x^(k).
        performance: (N,) z(k).
        gains: (N, n_c (m + p)) theta(k).

    """

    signals: Signals
    input: Array
    states: Array
    performance: Array
    gains: Array


def history(seed: int, case: Case) -> History:
    """Reconstruct the input of one run."""
    given, (_, model) = signals(seed, case), models(case)
    config = RetrospectiveConfig(
        case.order,
        case.initial_covariance,
        delays=case.delays,
        retained=case.retained,
        regularization=case.regularization,
        regularized_by=case.regularized_by,
        saturation=(-case.saturation, case.saturation),
        forgetting=case.forgetting,
        covariance_bound=COVARIANCE_BOUND if case.forgetting < 1.0 else inf,
    )
    estimator, N = RetrospectiveCost(config, model), case.samples
    u, z, states = (np.full(shape, np.nan) for shape in ((N,), (N,), (N, model.states)))
    gains = np.full((N, 2 * case.order), np.nan)
    for k in range(N):
        found = estimator.update(given.outputs[k])
        if not abs(found.input[0]) < _DIVERGED * printed.AMPLITUDE:
            break
        u[k], z[k], states[k], gains[k] = found.input[0], found.performance[0], found.state, estimator.gains[0]
    return History(given, u, states, z, gains)


class RunMeasures(NamedTuple):
    """Measures of a run; errors are RMS over the last 100 samples, infinite if the run was stopped.

    Attributes:
        error: error of u^ against u, as a share of u's amplitude.
        equivalent_error: error of u^ against the equivalent input, as a share of u's amplitude.
        state_error: largest error of a state, each as a share of the state's RMS under the input alone.
        peak: largest |u^|, in amplitudes.
        converged_at: sample from which the error against the equivalent input over 100 samples stays below 2 %; None if never.
        damping: median of (54) over the last 100 samples, N s/m; nan except in example 3.

    """

    error: float
    equivalent_error: float
    state_error: float
    peak: float
    converged_at: float | None
    damping: float


def measure(seed: int, case: Case) -> RunMeasures:
    """Reconstruct the input of one run and return its measures."""
    made = history(seed, case)
    given, found = made.signals, made.input
    if not np.all(np.isfinite(found)):
        return RunMeasures(inf, inf, inf, inf, None, inf)
    unit = printed.AMPLITUDE
    against = np.cumsum(np.insert(((found - given.equivalent) / unit) ** 2, 0, 0.0))
    moving = np.sqrt(np.maximum(against[LAST:] - against[:-LAST], 0.0) / LAST)  # RMS over samples i ... i + 99
    outside = np.flatnonzero(moving >= WITHIN)
    first = 0 if outside.size == 0 else int(outside[-1]) + 1
    plant, _ = models(case)
    turn = np.exp(1j * printed.RAD_PER_SAMPLE) * np.eye(plant.states)
    usual = np.abs(np.linalg.solve(turn - plant.A, plant.B[:, 0])) * unit / sqrt(2.0)
    return RunMeasures(
        _rms(found - given.input) / unit,
        _rms(found - given.equivalent) / unit,
        max(_rms(made.states[:, i] - given.states[:, i]) / usual[i] for i in range(plant.states)),
        float(np.max(np.abs(found))) / unit,
        None if first >= moving.size else float(first),
        damping(made, case),
    )


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values[-LAST:] ** 2)))


def damping_history(made: History, model_damping: float) -> Array:
    """Return c^(k) = (c_0 q'^ - u^) / q'^ of (54), N s/m; nan where the velocity is zero."""
    velocity = np.where(made.states[:, 1] == 0.0, np.nan, made.states[:, 1])
    return model_damping - made.input / velocity


def damping(made: History, case: Case) -> float:
    """Return the median of (54) over the last 100 samples, N s/m; nan except in example 3."""
    if case.example != "3" or case.model_damping is None:
        return float("nan")
    return float(np.median(damping_history(made, case.model_damping)[-LAST:]))
