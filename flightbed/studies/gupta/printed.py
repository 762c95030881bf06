"""Printed data of the examples of Gupta et al. (2012), section V; no value in this module is computed."""

from __future__ import annotations

from types import MappingProxyType
from typing import NamedTuple

AMPLITUDE, RAD_PER_SAMPLE = 0.6, 0.2  # u(k) = 0.6 sin(0.2 k), all examples except the third
MASS_KG, DAMPING, STIFFNESS = 1.0, 5.0, 2.0  # kg, N s/m, N/m
MODEL_DAMPING_3, MODEL_DAMPING_4 = 3.0, (4.0, 10.0)  # initial damping of examples 3 and 4, N s/m
K_OPT = (-2.0740, 11.7514, -119.0269)  # (73): gains on A_z (g), q (rad/s), fin (rad); fin rate in rad/s


class Settings(NamedTuple):
    """Printed settings of an example.

    Attributes:
        order: order n_c of the feedback.
        initial_covariance: factor of the identity in P(0).
        regularization: eta_0.
        period_s: T_s, s; None if not printed.
        converges: quantities that the text and the figures report as converging.

    """

    order: int
    initial_covariance: float
    regularization: float
    period_s: float | None
    converges: str


SETTINGS = MappingProxyType(
    {
        "1": Settings(15, 0.1, 0.01, 1.0, "input and states, though unstable and nonminimum-phase"),
        "2": Settings(10, 1.0, 0.0, 1.0, "input and states"),
        "3": Settings(1, 1.0, 0.0, 0.1, "states and damping"),
        "4": Settings(5, 1.0, 0.0, 0.1, "the input, if the damping is near"),
        "5": Settings(5, 1.0, 0.0, None, "input and states"),
    }
)

# Not printed: duration, initial states, lambda, the rule (one of three) for eta in example 1, aerodynamics and period of example 5.
