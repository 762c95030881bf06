"""Simulation of one run of an example, Wu et al. (2000) S 5: plant, two-stage filter, test and LQ law.

Filter and law use the model of the healthy system; only the plant has the effectiveness. Inputs are held over a sample. Choices that the
paper leaves open are named constants.
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

from flightbed.avionics.short_period import Discrete, zero_order_hold
from flightbed.control.lq import LqServo, offset_weights, regulator
from flightbed.estimation.two_stage.change_test import BiasTest, BiasTestConfig
from flightbed.estimation.two_stage.filter import (
    ConstantForgetting,
    Forgetting,
    NoForgetting,
    TwoStageConfig,
    TwoStageFilter,
    VariableForgetting,
)
from flightbed.studies.wu import printed
from flightbed.studies.wu.printed import Change

Array = npt.NDArray[np.float64]

# Choices that the paper leaves open.
PERIOD_S = 0.1
EXTERNAL = (1.0, 1.0)  # constant external input of example 1, rad; it excites both inputs
NONE, CONSTANT, VARIABLE = NoForgetting(), ConstantForgetting(0.95), VariableForgetting(0.001, 1.0)
LEFT = 0.1  # K of the first input of example 2; the fixed law needs 0.29 for stability, see the table of margins
FLOOR = 0.05  # smallest effectiveness in the design of the law
FORGETTING: Mapping[str, Forgetting] = MappingProxyType({"none": NONE, "constant": CONSTANT, "variable": VARIABLE})


class Law(Enum):
    """Reaction of the control law to a confirmed loss.

    FIXED: none. REDESIGNED: LQ design for the estimated effectiveness, eqs (47)-(49). OFFSET: LQ design with new weights of the inputs that
    give the loop of the healthy system, and division of the external input by the effectiveness. OPEN: no feedback.
    """

    FIXED = "fixed"
    REDESIGNED = "redesigned"
    OFFSET = "offset"
    OPEN = "open"


@dataclass(frozen=True)
class Case:
    """Settings of a simulation.

    Attributes:
        example: 1 or 2.
        changes: changes of effectiveness; empty for a run without failure.
        forgetting: forgetting of the filter.
        law: reaction of the law to a loss.
        external: constant external input, per input.
        period_s: sample period, s.
        prior_variance: P_0 of each gamma.
        window, threshold: L and epsilon of the test.
        noise: factor on the standard deviations of process noise and readings, in the plant and in the filter.

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
    """Return a case of example 1 with a scenario of Table I, or without failure if ``scenario`` is None."""
    changes = () if scenario is None else printed.SCENARIOS[scenario]
    return Case(1, changes, forgetting, law, external)


def unstable(left: float | None, forgetting: Forgetting = VARIABLE, law: Law = Law.FIXED) -> Case:
    """Return a case of example 2 with effectiveness ``left`` of the first input from 5 s on, or without failure if ``left`` is None."""
    return Case(2, () if left is None else (Change(printed.FAILED_AT_S, 0, left),), forgetting, law)


class Model(NamedTuple):
    """Discrete model of an example: x+ = A x + B u, y = C x, weight of the state Q = C' Q_c C and of the inputs R = R_c."""

    A: Array
    B: Array
    C: Array
    Q: Array
    R: Array


@cache
def model(example: int, period_s: float = PERIOD_S) -> Model:
    """Return the discrete model of an example for inputs held over the period, s."""
    given = printed.EXAMPLES[example]
    held: Discrete = zero_order_hold(np.array(given.A), np.array(given.B), period_s)
    C = np.array(given.C)
    return Model(held.A, held.b, C, C.T @ np.diag(given.Q_c) @ C, np.diag(given.R_c))


def effectiveness(case: Case) -> Array:
    """Return the effectiveness K of both inputs over each sample, (N, 2)."""
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
    """History of one run over N samples.

    Row k of states, estimates and statistics is at t_s[k], the end of the sample over which row k of the inputs is held.

    Attributes:
        t_s: (N,), time, s, from one period on.
        effectiveness: (N, 2), K over the sample.
        estimate, deviation: (N, 2), K-hat = 1 + gamma-hat, and its standard deviation according to the filter.
        state, inputs: (N, 4), state of the plant, and (N, 2), inputs of the law.
        statistic: (N, 2), d of eq (33).
        nis: (N,), normalized innovation squared.
        redesigns: number of redesigns of the law.

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
    """Simulate a run; the noise depends on the seed and the period only, so all cases of one period share it."""
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
    designed, redesigns = np.ones(2), 0  # effectiveness in the design of the law
    found, nis = np.empty((5, samples, 2)), np.empty(samples)  # K, K-hat, deviation, inputs, statistic
    states = np.empty((samples, n))
    state = kalman.estimate.state
    for k in range(samples):
        reference = external / designed if case.law is Law.OFFSET else external
        u = reference if case.law is Law.OPEN else law.command(state, external=reference)
        x = A @ x + B @ (K[k] * u) + w[k]
        estimate = kalman.step(A, B, C, u, C @ x + v[k])
        state = estimate.state
        statistic, raised = test.update(estimate.gamma, estimate.gamma_covariance)
        found[:, k] = K[k], estimate.effectiveness, np.sqrt(np.diag(estimate.gamma_covariance)), u, statistic
        states[k], nis[k] = x, estimate.nis
        if case.law in (Law.REDESIGNED, Law.OFFSET) and np.any(raised):
            designed = np.where(raised, np.clip(estimate.effectiveness, FLOOR, 1.0), designed)
            law.redesign(designed, R=offset_weights(R, designed) if case.law is Law.OFFSET else None)
            redesigns += 1
    t_s = case.period_s * np.arange(1, samples + 1, dtype=np.float64)
    return Run(t_s, found[0], found[1], found[2], states, found[3], found[4], nis, redesigns)
