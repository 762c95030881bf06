"""Printed data of the two examples of Wu, Zhang and Zhou (2000); no value in this module is computed.

N. E. Wu, Y. Zhang, K. Zhou, Detection, estimation, and accommodation of loss of control effectiveness, Int. J. Adaptive Control and
Signal Processing 14 (2000) 775, S 5. The matrices are read as those of differential equations, although the paper prints difference
equations: then example 1 has a stable short period and a stable phugoid, and example 2 the unstable and the lightly damped mode that the
text describes. As transition matrices both systems would diverge, the first by a factor of four per sample.
"""

from __future__ import annotations

from types import MappingProxyType
from typing import NamedTuple

DURATION_S = 20.0


class Example(NamedTuple):
    """System and weights of an example.

    Attributes:
        states, inputs: names of the states and of the inputs.
        A, B, C: matrices of the differential equations, (n, n), (n, 2), (m, n).
        Q_c, R_c: diagonals of the weights of the outputs, (m,), and of the inputs, (2,).
        x0: initial state, (n,).

    """

    states: tuple[str, ...]
    inputs: tuple[str, str]
    A: tuple[tuple[float, ...], ...]
    B: tuple[tuple[float, ...], ...]
    C: tuple[tuple[float, ...], ...]
    Q_c: tuple[float, ...]
    R_c: tuple[float, ...]
    x0: tuple[float, ...]


# S 5.1, after Balas et al. 1991; u presumably in ft/s, angles in rad.
AIRCRAFT = Example(
    states=("u", "alpha", "q", "theta"),
    inputs=("elevon", "canard"),
    A=((-0.0226, -36.6, -18.9, -32.1), (0.0, -1.9, 0.983, 0.0), (0.0123, -11.7, -2.63, 0.0), (0.0, 0.0, 1.0, 0.0)),
    B=((0.0, 0.0), (-0.414, 0.0), (-77.8, 22.4), (0.0, 0.0)),
    C=((0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)),
    Q_c=(10.0, 50.0),
    R_c=(10.0, 10.0),
    x0=(50.0, 0.05, 5.0, 0.06),
)
# S 5.2, after Veillette 1995; C is the identity, so Q_c weights the states.
UNSTABLE = Example(
    states=("x1", "x2", "x3", "x4"),
    inputs=("first input", "second input"),
    A=((0.0, 1.0, 1.0, 2.0), (-1.0, -1.0, 1.0, 0.0), (2.0, 2.0, 0.0, 1.0), (0.0, 1.0, 0.0, 0.0)),
    B=((0.0, 0.0), (2.0, 0.0), (0.0, 0.0), (0.0, 1.0)),
    C=((1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0)),
    Q_c=(1.0, 0.0, 1.0, 0.0),
    R_c=(1.0, 1.0),
    x0=(1.0, 0.0, 1.0, 0.0),
)
EXAMPLES = MappingProxyType({1: AIRCRAFT, 2: UNSTABLE})

# Both examples: standard deviations per sample of process noise, readings and the random walk of gamma.
PROCESS_STD, READING_STD, GAMMA_STD = 0.01, 0.1, 0.001
PRIOR_VARIANCE = 10.0  # of every state and every gamma, example 1
WINDOW, THRESHOLD = 3, 5.0  # L of eq (33), epsilon of eq (34), example 1
FAILED_AT_S = 5.0  # example 2


class Change(NamedTuple):
    """A change of effectiveness.

    Attributes:
        at_s: time of the change, s.
        input: index of the input.
        to: effectiveness from ``at_s`` on.
        ramp: whether the effectiveness falls linearly from the input's previous change to ``at_s`` rather than in a step at ``at_s``.
    """

    at_s: float
    input: int
    to: float
    ramp: bool = False


# Table I: changes of effectiveness. In scenario 5 the first input drops to one half in a step, then falls on a ramp.
SCENARIOS = MappingProxyType(
    {
        1: (Change(5.1, 0, 0.25),),
        2: (Change(5.1, 0, 0.5), Change(10.1, 0, 0.0)),
        3: (Change(5.1, 0, 0.5), Change(12.6, 1, 0.5)),
        4: (Change(5.1, 0, 0.5), Change(10.1, 0, 0.1), Change(12.6, 1, 0.5)),
        5: (Change(5.1, 0, 0.5), Change(10.1, 0, 0.1, ramp=True), Change(12.6, 1, 0.5)),
    }
)
