"""Airframe + TrimPoint -> LinearModel, by central differences of the equations of motion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from flightbed.plant.base import Airframe, Controls, Motion
from flightbed.trim import TrimPoint
from flightbed.units import DEG

if TYPE_CHECKING:
    import control

Matrix = npt.NDArray[np.float64]

STATES = (("airspeed", "m/s"), ("alpha", "rad"), ("theta", "rad"), ("q", "rad/s"))
INPUTS = (("elevator", "rad"), ("throttle", "1"))

# Central-difference steps. Small, because tables and flap switches have kinks: 1e-3 deg keeps the truncation error
# below 1e-7 and a switch outside the stencil at almost every trim point.
_STATE_STEPS = (1e-2, 1e-3 * DEG, 1e-3 * DEG, 1e-4)
_INPUT_STEPS = (1e-3 * DEG, 1e-4)


@dataclass(frozen=True)
class LinearModel:
    """x' = A x + B u, y = C x + D u, in deviations from a trim point. SI, radians.

    Attributes:
        states, inputs: (name, unit) of each.
        A: (n, n); B: (n, m); C: (p, n); D: (p, m).
        trim: the point it was taken at.

    """

    states: tuple[tuple[str, str], ...]
    inputs: tuple[tuple[str, str], ...]
    A: Matrix
    B: Matrix
    C: Matrix
    D: Matrix
    trim: TrimPoint

    def eigenvalues(self) -> npt.NDArray[np.complex128]:
        """Return the eigenvalues of A, rad/s."""
        return np.asarray(np.linalg.eigvals(self.A), dtype=np.complex128)

    def part(self, states: tuple[str, ...], inputs: tuple[str, ...]) -> tuple[Matrix, Matrix]:
        """Return the rows and columns of (A, B) that belong to the named states and inputs."""
        rows = [[name for name, _ in self.states].index(s) for s in states]
        columns = [[name for name, _ in self.inputs].index(i) for i in inputs]
        return self.A[np.ix_(rows, rows)], self.B[np.ix_(rows, columns)]

    def to_control(self) -> control.StateSpace:
        """Return a python-control StateSpace with signal names."""
        import control  # slow to import, and only some users need it

        names: dict[str, Any] = {
            "states": [name for name, _ in self.states],
            "inputs": [name for name, _ in self.inputs],
            "outputs": [name for name, _ in self.states],
        }
        return control.ss(self.A, self.B, self.C, self.D, **names)


def linearize(airframe: Airframe, trim: TrimPoint) -> LinearModel:
    """Linearize the longitudinal motion (airspeed, alpha, theta, q) about a trim point.

    Inputs are surface position and throttle: the actuator is not part of the model (ShortPeriod adds it), the engine
    is at its steady state. Theta is held while alpha moves, so the flight path carries the difference.
    """
    x0, u0 = np.array(trim.motion), np.array(trim.controls)

    def rates(x: Matrix, u: Matrix) -> Matrix:
        return np.array(airframe.rates(Motion(*x), Controls(*u)))

    A = np.empty((4, 4))
    for i, step in enumerate(_STATE_STEPS):
        dx = step * np.eye(4)[i]
        A[:, i] = (rates(x0 + dx, u0) - rates(x0 - dx, u0)) / (2.0 * step)
    B = np.empty((4, 2))
    for i, step in enumerate(_INPUT_STEPS):
        du = step * np.eye(2)[i]
        B[:, i] = (rates(x0, u0 + du) - rates(x0, u0 - du)) / (2.0 * step)
    return LinearModel(STATES, INPUTS, A, B, np.eye(4), np.zeros((4, 2)), trim)
