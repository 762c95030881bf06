"""One run of an example: plant, two-stage filter, test, LQ law. Wu and others (2000) S 5, with the choices that they leave open named.

The filter and the law know the healthy system; the effectiveness is the plant's. Inputs are held over a sample.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from functools import cache
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from flightbed.control.lq import LqServo, offset_weights, regulator
from flightbed.estimation.bias_test import BiasTest, BiasTestConfig
from flightbed.estimation.two_stage import (
    ConstantForgetting,
    Forgetting,
    NoForgetting,
    TwoStageConfig,
    TwoStageFilter,
    VariableForgetting,
)
from flightbed.short_period import Discrete, zero_order_hold
from flightbed.studies.wu import printed
from flightbed.studies.wu.printed import Change

Array = npt.NDArray[np.float64]

# Choices: what the paper does not say.
PERIOD_S = 0.1
EXTERNAL = (1.0, 1.0)  # the constant external input of example 1, rad; that both inputs be excited
NONE, CONSTANT, VARIABLE = NoForgetting(), ConstantForgetting(0.95), VariableForgetting(0.001, 1.0)
LEFT = 0.1  # of the first input of example 2; the fixed law needs 0.29 to be stable, see the table of margins
FLOOR = 0.05  # least effectiveness that the law is designed for
FORGETTING: Mapping[str, Forgetting] = MappingProxyType({"none": NONE, "constant": CONSTANT, "variable": VARIABLE})


class Law(Enum):
    """What the control law does about a confirmed loss.

    FIXED does nothing. REDESIGNED is the LQ design for the effectiveness as estimated, eqs (47)-(49). OFFSET weights the inputs anew as
    well, so that the loop is that of the healthy system, and divides the external input likewise. OPEN feeds nothing back at all.
    """

    FIXED = "fixed"
    REDESIGNED = "redesigned"
    OFFSET = "offset"
    OPEN = "open"


@dataclass(frozen=True)
class Case:
    """What is simulated.

    Attributes:
        example: 1 or 2.
        changes: of effectiveness; none for a run without failure.
        forgetting: of the filter.
        law: what is done about a loss.
        external: constant external input, of each input.
        period_s: of samples.
        prior_variance: P_0 of every gamma.
        window, threshold: L and epsilon of the test.
        noise: factor on the standard deviations of process noise and readings, which the filter knows.

    """

    example: int
    changes: tuple[Change, ...] = ()
    forgetting: Forgetting = VARIABLE
    law: Law = Law.FIXED
    external: tuple[float, float] = (0.0, 0.0)
    period_s: float = PERIOD_S
    prior_variance: float = printed.PRIOR_VARIANCE
    window: int = printed.WINDOW
    threshold: float = printed.THRESHOLD
    noise: float = 1.0


def aircraft(
    scenario: int | None,
    forgetting: Forgetting = VARIABLE,
    law: Law = Law.FIXED,
    *,
    external: tuple[float, float] = EXTERNAL,
) -> Case:
    """Return a case of example 1: a scenario of Table I, or None for no failure."""
    changes = () if scenario is None else printed.SCENARIOS[scenario]
    return Case(1, changes, forgetting, law, external)


def unstable(left: float | None, forgetting: Forgetting = VARIABLE, law: Law = Law.FIXED) -> Case:
    """Return a case of example 2: what is left of the first input, or None for no failure."""
    return Case(2, () if left is None else (Change(printed.FAILED_AT_S, 0, left),), forgetting, law)


class Model(NamedTuple):
    """An example at a sample rate: x+ = A x + B u, y = C x, and the weight of the state C' Q_c C and of the inputs."""

    A: Array
    B: Array
    C: Array
    Q: Array
    R: Array


@cache
def model(example: int, period_s: float = PERIOD_S) -> Model:
    """Return an example, its inputs held over the period."""
    given = printed.EXAMPLES[example]
    held: Discrete = zero_order_hold(np.array(given.A), np.array(given.B), period_s)
    C = np.array(given.C)
    return Model(held.A, held.b, C, C.T @ np.diag(given.Q_c) @ C, np.diag(given.R_c))


def effectiveness(case: Case) -> Array:
    """Return K of both inputs over every sample, (N, 2)."""
    samples = round(printed.DURATION_S / case.period_s)
    K = np.ones((samples, 2))
    began = [0, 0]
    for change in case.changes:
        at, i = round(change.at_s / case.period_s), change.input
        if change.ramp:
            since = np.arange(began[i], at)
            K[since, i] += (change.to - K[began[i], i]) * (since - began[i]) / (at - began[i])
        K[at:, i] = change.to
        began[i] = at
    return K


class Run(NamedTuple):
    """One run; N samples, row k of what plant or filter say is at t_s[k], the end of the sample over which row k of the inputs held.

    Attributes:
        t_s: (N,), from one period on.
        effectiveness: (N, 2), K over the sample.
        estimate, deviation: (N, 2), K-hat = 1 + gamma-hat and its standard deviation as the filter has it.
        state, inputs: (N, 4) and (N, 2).
        statistic: (N, 2), d of eq (33).
        nis: (N,).
        redesigns: samples after which the law was designed anew.

    """

    t_s: Array
    effectiveness: Array
    estimate: Array
    deviation: Array
    state: Array
    inputs: Array
    statistic: Array
    nis: Array
    redesigns: int


def simulate(seed: int, case: Case) -> Run:
    """Simulate a run; the noise depends on the seed alone, and so is the same in all cases of one period."""
    rng = np.random.default_rng(seed)
    A, B, C, Q, R = model(case.example, case.period_s)
    x = np.array(printed.EXAMPLES[case.example].x0)
    n, m, samples = len(x), len(C), round(printed.DURATION_S / case.period_s)
    process_std, reading_std = case.noise * printed.PROCESS_STD, case.noise * printed.READING_STD
    w, v = process_std * rng.standard_normal((samples, n)), reading_std * rng.standard_normal((samples, m))
    K = effectiveness(case)
    kalman = TwoStageFilter(TwoStageConfig(
        Q=process_std**2 * np.eye(n), R=reading_std**2 * np.eye(m), Q_gamma=printed.GAMMA_STD**2 * np.eye(2),
        state=x, state_covariance=printed.PRIOR_VARIANCE * np.eye(n),
        gamma=np.zeros(2), gamma_covariance=case.prior_variance * np.eye(2), forgetting=case.forgetting,
    ))  # fmt: skip
    test = BiasTest(BiasTestConfig(case.window, (case.threshold, case.threshold)))
    law = LqServo(regulator(A, B, Q, R))
    external = np.array(case.external)
    believed, redesigns = np.ones(2), 0  # what the law was designed for
    found, nis = np.empty((5, samples, 2)), np.empty(samples)  # K, K-hat, deviation, inputs, statistic
    states = np.empty((samples, n))
    state = kalman.estimate.state
    for k in range(samples):
        asked = external / believed if case.law is Law.OFFSET else external
        u = asked if case.law is Law.OPEN else law.command(state, external=asked)
        x = A @ x + B @ (K[k] * u) + w[k]
        told = kalman.step(A, B, C, u, C @ x + v[k])
        state = told.state
        statistic, raised = test.update(told.gamma, told.gamma_covariance)
        found[:, k] = K[k], told.effectiveness, np.sqrt(np.diag(told.gamma_covariance)), u, statistic
        states[k], nis[k] = x, told.nis
        if case.law in (Law.REDESIGNED, Law.OFFSET) and np.any(raised):
            believed = np.where(raised, np.clip(told.effectiveness, FLOOR, 1.0), believed)
            law.redesign(believed, R=offset_weights(R, believed) if case.law is Law.OFFSET else None)
            redesigns += 1
    t_s = case.period_s * np.arange(1, samples + 1, dtype=np.float64)
    return Run(t_s, found[0], found[1], found[2], states, found[3], found[4], nis, redesigns)
