"""Airframe + TrimPoint -> LinearModel, by central differences of the equations of motion, with a checked step."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import asin
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from flightbed.plant.base import Airframe, Controls, Motion
from flightbed.trim import TrimPoint
from flightbed.units import DEG, FT

if TYPE_CHECKING:
    import control

Matrix = npt.NDArray[np.float64]
Names = tuple[tuple[str, str], ...]

LONGITUDINAL: Names = (("airspeed", "m/s"), ("alpha", "rad"), ("theta", "rad"), ("q", "rad/s"), ("altitude", "m"))
LATERAL: Names = (("beta", "rad"), ("phi", "rad"), ("p", "rad/s"), ("r", "rad/s"), ("psi", "rad"))
STATES: Names = LONGITUDINAL + LATERAL
LOADS: Names = (("nz", "g"), ("nz_pilot", "g"), ("ny", "g"), ("gamma", "rad"))

# Part -> states, inputs and outputs beside the states.
PARTS: dict[str, tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...]]] = {
    "longitudinal": (tuple(n for n, _ in LONGITUDINAL), ("elevator", "throttle"), ("nz", "nz_pilot", "gamma")),
    "lateral": (tuple(n for n, _ in LATERAL), ("aileron", "rudder"), ("ny",)),
    "short-period": (("alpha", "q"), ("elevator",), ("nz", "nz_pilot")),
}

# Steps of the differences. Small, because tables and switches have kinks: 1e-3 deg keeps the truncation error below 1e-7
# and a kink outside the stencil at almost every trim point.
_ANGLE = 1e-3 * DEG
_STEPS = np.array([1e-2, _ANGLE, _ANGLE, 1e-4, 1.0, _ANGLE, _ANGLE, 1e-4, 1e-4, _ANGLE])
# Two one-sided slopes that differ by more than this share of the largest entry of their row: a kink, not curvature.
_KINK = 1e-3
_NEAR = {"mach": 1e-4, "alpha": 2e-3 * DEG, "beta": 2e-3 * DEG, "elevator": 2e-3 * DEG, "altitude": 2.0}
_MOVES: Mapping[str, Sequence[str]] = {
    "airspeed": ("mach",), "altitude": ("mach", "altitude"), "alpha": ("alpha",), "beta": ("beta",), "elevator": ("elevator",),
}  # fmt: skip


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
        drift: how far the equations of motion themselves moved while differences were taken (integrators of a stock control
            system), relative to the largest change of each row in them; 0 for an overlay aircraft.

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
    drift: float = 0.0

    def eigenvalues(self) -> npt.NDArray[np.complex128]:
        """Return the eigenvalues of A, rad/s."""
        return np.asarray(np.linalg.eigvals(self.A), dtype=np.complex128)

    def part(self, states: Sequence[str], inputs: Sequence[str]) -> tuple[Matrix, Matrix]:
        """Return the rows and columns of (A, B) that belong to the named states and inputs."""
        rows, columns = _places(self.states, states), _places(self.inputs, inputs)
        return self.A[np.ix_(rows, rows)], self.B[np.ix_(rows, columns)]

    def subset(self, name: str) -> LinearModel:
        """Return the ``"longitudinal"``, ``"lateral"`` or ``"short-period"`` model, the other states held at trim; else KeyError."""
        states, inputs, loads = PARTS[name]
        inputs = tuple(i for i in inputs if i in dict(self.inputs))
        x, u = _places(self.states, states), _places(self.inputs, inputs)
        y = _places(self.outputs, (*states, *loads))
        rows = {*(f"{s}'" for s in states), *states, *loads}
        return dataclasses.replace(
            self,
            states=tuple(self.states[i] for i in x),
            inputs=tuple(self.inputs[i] for i in u),
            outputs=tuple(self.outputs[i] for i in y),
            A=self.A[np.ix_(x, x)],
            B=self.B[np.ix_(x, u)],
            C=self.C[np.ix_(y, x)],
            D=self.D[np.ix_(y, u)],
            kinks=tuple(k for k in self.kinks if k.row in rows and k.column in (*states, *inputs)),
        )

    def with_actuator(self, name: str, lag_rad_s: float) -> LinearModel:
        """Return the model with a first-order actuator on an input: the position becomes the last state, the input a command."""
        i, n = _places(self.inputs, (name,))[0], len(self.states)
        A = np.block([[self.A, self.B[:, i : i + 1]], [np.zeros((1, n)), np.array([[-lag_rad_s]])]])
        B = np.vstack([self.B, np.zeros((1, self.B.shape[1]))])
        B[:, i] = 0.0
        B[n, i] = lag_rad_s
        D = self.D.copy()
        D[:, i] = 0.0
        unit = self.inputs[i][1]
        position = np.zeros((1, n + 1))
        position[0, n] = 1.0
        return dataclasses.replace(
            self,
            states=(*self.states, (f"{name}_position", unit)),
            inputs=tuple((f"{name}_cmd", u) if j == i else (m, u) for j, (m, u) in enumerate(self.inputs)),
            outputs=(*self.outputs, (f"{name}_position", unit)),
            A=A,
            B=B,
            C=np.vstack([np.hstack([self.C, self.D[:, i : i + 1]]), position]),
            D=np.vstack([D, np.zeros((1, D.shape[1]))]),
        )

    def to_control(self) -> control.StateSpace:
        """Return a python-control StateSpace with signal names."""
        import control  # slow to import, and only some users need it

        names: dict[str, Any] = {
            "states": [name for name, _ in self.states],
            "inputs": [name for name, _ in self.inputs],
            "outputs": [name for name, _ in self.outputs],
        }
        return control.ss(self.A, self.B, self.C, self.D, **names)


def _places(names: Names, wanted: Sequence[str]) -> list[int]:
    have = [name for name, _ in names]
    return [have.index(name) for name in wanted]


def linearize(airframe: Airframe, trim: TrimPoint) -> LinearModel:
    """Linearize the rigid-body motion (airspeed, alpha, theta, q, altitude; beta, phi, p, r, psi) about a trim point.

    Inputs are those of the airframe: for a surface its position (no actuator in the model; ``with_actuator`` adds one), or a
    normalized command. The other hidden states are as the airframe holds them: it says how. Theta is held while alpha moves, so the
    flight path carries the difference. Each derivative is a central difference at two steps, extrapolated (Richardson); where
    the slopes on the two sides differ, or the function jumps, the model has their mean and ``kinks`` says so.
    """
    inputs: Names = tuple((i.name, i.unit) for i in airframe.inputs)
    point = np.array([*trim.motion, *trim.controls[: len(inputs)]])
    n = len(STATES)
    steps = np.array([*_STEPS, *(1e-4 if i.name == "throttle" else _ANGLE * i.high / 0.4363 for i in airframe.inputs)])

    def values(offset: Matrix) -> list[float]:
        x = (point + offset).tolist()
        motion = Motion(*x[:n])
        rates, nz, nz_pilot, ny = airframe.respond(motion, Controls(*x[n:]))
        return [*rates, *x[:n], nz, nz_pilot, ny, asin(motion.climb_m_s / motion.airspeed_m_s)]

    # Stencil of each variable: -h, -h/2, 0, h/2, h.
    centre = values(np.zeros_like(point))
    stencil = np.empty((5, len(centre), len(point)))
    for j, offsets in enumerate(np.diag(steps)):
        for i, share in enumerate((-1.0, -0.5, 0.0, 0.5, 1.0)):
            stencil[i, :, j] = values(share * offsets) if share else centre
    minus, half_minus, _, half_plus, plus = stencil
    coarse = (plus - minus) / (2.0 * steps)
    J = (4.0 * (half_plus - half_minus) / steps - coarse) / 3.0
    # Slopes over the four parts of the stencil. A jump spoils one of them: of the two on a side the one nearer to the median
    # of all is the slope of that side.
    slopes = np.diff(stencil, axis=0) / (steps / 2.0)
    off = np.abs(slopes - np.median(slopes, axis=0))
    below = np.where(off[0] < off[1], slopes[0], slopes[1])
    above = np.where(off[3] < off[2], slopes[3], slopes[2])
    mean = (above + below) / 2.0
    size = np.max(np.abs(mean) * steps, axis=1, keepdims=True) / steps + 1e-12  # row, in each column's unit
    # Round-off of the row itself is no kink.
    floor = 1e-11 * (np.abs(np.array(centre))[:, None] + 1.0) / steps
    jumps = np.abs(J - mean) > _KINK * size + floor
    sharp = jumps | (np.abs(above - below) > _KINK * size + floor)
    heights = np.where(jumps, plus - minus - 2.0 * mean * steps, 0.0)
    columns = (*STATES, *inputs)
    kinks = tuple(
        Kink(_row(i), columns[j][0], below[i, j], above[i, j], heights[i, j], _where(airframe, trim, columns[j][0]))
        for i, j in np.argwhere(sharp)
    )
    error = float(np.max(np.where(sharp, 0.0, np.abs(J - coarse) / size)))
    J = np.where(sharp, mean, J)
    again = np.abs(np.array(values(np.zeros_like(point))) - centre)
    moved = np.max(np.abs(mean) * steps, axis=1)
    drift = float(np.max(np.where(moved > 1e-9, again / np.maximum(moved, 1e-9), 0.0)))
    acting = [i for i, (name, _) in enumerate(inputs) if name != "throttle" or airframe.throttle_acts]
    B, D = J[:n, n:][:, acting], J[n:, n:][:, acting]
    inputs = tuple(inputs[i] for i in acting)
    return LinearModel(STATES, inputs, (*STATES, *LOADS), J[:n, :n], B, J[n:, :n], D, trim, error, kinks, drift)


def _row(i: int) -> str:
    n = len(STATES)
    return f"{STATES[i][0]}'" if i < n else (*STATES, *LOADS)[i - n][0]


def _where(airframe: Airframe, trim: TrimPoint, column: str) -> str:
    """Name the table breakpoints that a variable meets at the trim point."""
    mach = trim.airspeed_m_s / airframe.airspeed_m_s * airframe.mach
    here = {
        "mach": mach,
        "alpha": trim.alpha_rad,
        "beta": trim.motion.beta_rad,
        "elevator": trim.controls.elevator,
        "altitude": trim.altitude_m,
    }
    return " and ".join(
        f"Mach {value:g}" if quantity == "mach"
        else f"{value / FT:.0f} ft" if quantity == "altitude"
        else f"{quantity} {value / DEG:.3g} deg"
        for quantity in _MOVES.get(column, ())
        for value in airframe.breakpoints(quantity)
        if abs(value - here[quantity]) <= _NEAR[quantity]
    )  # fmt: skip
