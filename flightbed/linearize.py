"""Airframe + TrimPoint -> LinearModel, by central differences of the equations of motion, with a checked step."""

from __future__ import annotations

from collections.abc import Sequence
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
Names = tuple[tuple[str, str], ...]

STATES: Names = (("airspeed", "m/s"), ("alpha", "rad"), ("theta", "rad"), ("q", "rad/s"), ("altitude", "m"))
INPUTS: Names = (("elevator", "rad"), ("throttle", "1"))
OUTPUTS: Names = (*STATES, ("nz", "g"), ("nz_pilot", "g"), ("gamma", "rad"))

# Steps of the differences. Small, because tables and switches have kinks: 1e-3 deg keeps the truncation error below 1e-7
# and a kink outside the stencil at almost every trim point.
_STEPS = np.array([1e-2, 1e-3 * DEG, 1e-3 * DEG, 1e-4, 1.0, 1e-3 * DEG, 1e-4])
# Two one-sided slopes that differ by more than this share of the largest entry of their row: a kink, not curvature.
_KINK = 1e-3
_BREAKPOINT_RANGE = {"mach": 1e-4, "alpha": 2e-3 * DEG, "elevator": 2e-3 * DEG}


@dataclass(frozen=True)
class Kink:
    """A derivative that does not exist: the point lies on a kink or a jump, and the model has the mean of both sides.

    Attributes:
        row, column: names of the derivative, d(row)/d(column), in units of the model.
        below, above: the slopes on either side.
        jump: by how much the row itself jumps there; 0 for a kink.
        where: table breakpoints nearby, in words; empty if none is known.

    """

    row: str
    column: str
    below: float
    above: float
    jump: float
    where: str

    def __str__(self) -> str:
        """One line."""
        place = f", at {self.where}" if self.where else ""
        jump = f", and {self.row} jumps by {self.jump:.2g}" if self.jump else ""
        return f"d({self.row})/d({self.column}) is {self.below:.4g} on one side and {self.above:.4g} on the other{jump}{place}"


@dataclass(frozen=True)
class LinearModel:
    """x' = A x + B u, y = C x + D u, in deviations from a trim point. SI, radians.

    Attributes:
        states, inputs, outputs: (name, unit) of each.
        A: (n, n); B: (n, m); C: (p, n); D: (p, m).
        trim: the point it was taken at.
        step_error: largest change of an entry when the step is halved, relative to the largest of its row.
        kinks: derivatives that are averages across a kink.

    """

    states: Names
    inputs: Names
    outputs: Names
    A: Matrix
    B: Matrix
    C: Matrix
    D: Matrix
    trim: TrimPoint
    step_error: float = 0.0
    kinks: tuple[Kink, ...] = ()

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
            "outputs": [name for name, _ in self.outputs],
        }
        return control.ss(self.A, self.B, self.C, self.D, **names)


def linearize(airframe: Airframe, trim: TrimPoint) -> LinearModel:
    """Linearize the longitudinal motion (airspeed, alpha, theta, q, altitude) about a trim point.

    Inputs are surface position and throttle: the actuator is not part of the model (ShortPeriod adds it), the engine
    is at its steady state. Theta is held while alpha moves, so the flight path carries the difference. Each
    derivative is a central difference at two steps, extrapolated (Richardson); where the slopes on the two sides differ, or
    the function jumps, the model has their mean and ``kinks`` says so.
    """
    point = np.array([*trim.motion, *trim.controls])
    n, m = len(STATES), len(INPUTS)

    def values(offset: Matrix) -> Matrix:
        x = point + offset
        response = airframe.respond(Motion(*x[:n]), Controls(*x[n:]))
        return np.array([*response.rates, *x[:n], response.nz_g, response.nz_pilot_g, x[2] - x[1]])

    centre = values(np.zeros(n + m))
    J, coarse, below, above, rise = (np.empty((2 * n + 3, n + m)) for _ in range(5))
    for i, step in enumerate(_STEPS):
        h = step * np.eye(n + m)[i]
        plus, minus, half_plus, half_minus = values(h), values(-h), values(h / 2), values(-h / 2)
        coarse[:, i] = (plus - minus) / (2.0 * step)
        J[:, i] = (4.0 * (half_plus - half_minus) / step - coarse[:, i]) / 3.0
        # Slopes over the four parts of the stencil. A jump spoils one of them: of the two on a side the one nearer to
        # the median of all is the slope of that side.
        slopes = np.diff([minus, half_minus, centre, half_plus, plus], axis=0) / (step / 2.0)
        off = np.abs(slopes - np.median(slopes, axis=0))
        below[:, i] = np.where(off[0] < off[1], slopes[0], slopes[1])
        above[:, i] = np.where(off[3] < off[2], slopes[3], slopes[2])
        rise[:, i] = plus - minus
    size = (
        np.max(np.abs((above + below) / 2.0) * _STEPS, axis=1, keepdims=True) / _STEPS + 1e-12
    )  # row, in each column's unit
    jumps = np.abs(J - (above + below) / 2.0) > _KINK * size
    sharp = jumps | (np.abs(above - below) > _KINK * size)
    heights = np.where(jumps, rise - (above + below) * _STEPS, 0.0)
    kinks = tuple(
        Kink(_row(i), _column(j), below[i, j], above[i, j], heights[i, j], _where(airframe, trim, _column(j)))
        for i, j in np.argwhere(sharp)
    )
    error = float(np.max(np.where(sharp, 0.0, np.abs(J - coarse) / size)))
    J = np.where(sharp, (above + below) / 2.0, J)
    return LinearModel(STATES, INPUTS, OUTPUTS, J[:n, :n], J[:n, n:], J[n:, :n], J[n:, n:], trim, error, kinks)


def _row(i: int) -> str:
    n = len(STATES)
    return f"{STATES[i][0]}'" if i < n else OUTPUTS[i - n][0]


def _column(j: int) -> str:
    return (*STATES, *INPUTS)[j][0]


def _where(airframe: Airframe, trim: TrimPoint, column: str) -> str:
    """Name the table breakpoints that a variable meets at the trim point."""
    mach = trim.airspeed_m_s / airframe.airspeed_m_s * airframe.mach
    here = {"mach": mach, "alpha": trim.alpha_rad, "elevator": trim.elevator_rad}
    moved: Sequence[str] = {
        "airspeed": ("mach",),
        "altitude": ("mach",),
        "alpha": ("alpha",),
        "elevator": ("elevator",),
    }.get(column, ())
    return " and ".join(
        f"Mach {value:g}" if quantity == "mach" else f"{quantity} {value / DEG:.3g} deg"
        for quantity in moved
        for value in airframe.breakpoints(quantity)
        if abs(value - here[quantity]) <= _BREAKPOINT_RANGE[quantity]
    )
