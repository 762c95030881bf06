"""Airframe + TrimPoint -> LinearModel, by central differences of the equations of motion, with an estimated step error."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import asin
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from flightbed.core.units import DEG, FT
from flightbed.models.trim import TrimPoint
from flightbed.plant.base import Airframe, Controls, Motion

if TYPE_CHECKING:
    import control

Matrix = npt.NDArray[np.float64]
Names = tuple[tuple[str, str], ...]

LONGITUDINAL: Names = (("airspeed", "m/s"), ("alpha", "rad"), ("theta", "rad"), ("q", "rad/s"), ("altitude", "m"))
LATERAL: Names = (("beta", "rad"), ("phi", "rad"), ("p", "rad/s"), ("r", "rad/s"), ("psi", "rad"))
STATES: Names = LONGITUDINAL + LATERAL
LOADS: Names = (("nz", "g"), ("nz_pilot", "g"), ("ny", "g"), ("gamma", "rad"))

# Part -> states, inputs and additional outputs.
PARTS: dict[str, tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...]]] = {
    "longitudinal": (tuple(n for n, _ in LONGITUDINAL), ("elevator", "throttle"), ("nz", "nz_pilot", "gamma")),
    "lateral": (tuple(n for n, _ in LATERAL), ("aileron", "rudder"), ("ny",)),
    "short-period": (("alpha", "q"), ("elevator",), ("nz", "nz_pilot")),
}

# Steps of the differences. They are small because tables and switches have kinks: 1e-3 deg keeps the truncation error below 1e-7
# and keeps kinks outside the stencil at almost every trim point.
_ANGLE = 1e-3 * DEG
_STEPS = np.array([1e-2, _ANGLE, _ANGLE, 1e-4, 1.0, _ANGLE, _ANGLE, 1e-4, 1e-4, _ANGLE])
# One-sided slopes that differ by more than this share of the largest entry of their row indicate a kink, not curvature.
_KINK = 1e-3
_NEAR = {"mach": 1e-4, "alpha": 2e-3 * DEG, "beta": 2e-3 * DEG, "elevator": 2e-3 * DEG, "altitude": 2.0}
_MOVES: Mapping[str, Sequence[str]] = {
    "airspeed": ("mach",), "altitude": ("mach", "altitude"), "alpha": ("alpha",), "beta": ("beta",), "elevator": ("elevator",),
}  # fmt: skip


@dataclass(frozen=True)
class Kink:
    """A derivative at a kink or a discontinuity: it does not exist, and the model uses the mean of the two one-sided slopes.

    Attributes:
        row, column: names of the derivative, d(row)/d(column), in units of the model.
        below, above: one-sided slopes.
        jump: step of the row itself at a discontinuity; 0 for a kink.
        where: description of the table breakpoints nearby; empty if none is known.

    """

    row: str
    column: str
    below: float
    above: float
    jump: float
    where: str

    def __str__(self) -> str:
        """One-line description."""
        place = f", at {self.where}" if self.where else ""
        jump = f", and {self.row} jumps by {self.jump:.2g}" if self.jump else ""
        return f"d({self.row})/d({self.column}) is {self.below:.4g} on one side and {self.above:.4g} on the other{jump}{place}"


@dataclass(frozen=True)
class LinearModel:
    """x' = A x + B u, y = C x + D u, in deviations from a trim point. SI, radians.

    Attributes:
        states, inputs, outputs: (name, unit) of each.
        A: (n, n); B: (n, m); C: (p, n); D: (p, m).
        trim: trim point of the linearization.
        step_error: largest change of an entry when the step is halved, relative to the largest entry of its row.
        kinks: derivatives that are means across a kink.
        drift: change of the equations of motion themselves during the differences (integrators of a stock control system),
            relative to the largest difference of each row; 0 for an overlay aircraft.

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
        """Return the rows and columns of (A, B) of the named states and inputs: (s, s) and (s, i)."""
        rows, columns = _places(self.states, states), _places(self.inputs, inputs)
        return self.A[np.ix_(rows, rows)], self.B[np.ix_(rows, columns)]

    def subset(self, name: str) -> LinearModel:
        """Return the ``"longitudinal"``, ``"lateral"`` or ``"short-period"`` model, the other states held at trim.

        Raises KeyError for another name.
        """
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
        """Return the model with a first-order actuator on an input: its position is the last state, the input is its command."""
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
        import control  # slow to import, needed by few users

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

    The inputs are those of the airframe: surface positions (without actuators; ``with_actuator`` adds one) or normalized commands.
    The airframe determines the other hidden states (``JsbsimAirframe.notes``). Theta is constant while alpha varies, so the flight-path
    angle varies. Each derivative is a central difference at two steps with Richardson extrapolation; where the one-sided slopes
    differ, or the function is discontinuous, the model uses the mean slope and lists the derivative in ``kinks``.
    """
    inputs: Names = tuple((i.name, i.unit) for i in airframe.inputs)
    point = np.array([*trim.motion, *trim.controls[: len(inputs)]])
    n = len(STATES)
    steps = np.array([*_STEPS, *(1e-4 if i.name == "throttle" else _ANGLE * i.high / 0.4363 for i in airframe.inputs)])

    def values(offset: Matrix) -> list[float]:
        x = (point + offset).tolist()
        motion = Motion(*x[:n])
        rates, nz, nz_pilot, ny = airframe.respond(motion, Controls(*x[n:]))
        return [*rates, nz, nz_pilot, ny, asin(motion.climb_m_s / motion.airspeed_m_s)]

    slopes = _differentiate(values, steps)
    columns = (*STATES, *inputs)
    kinks = tuple(
        Kink(_row(i), columns[j][0], below, above, jump, _where(airframe, trim, columns[j][0]))
        for i, j, below, above, jump in slopes.sharp
    )
    J = slopes.J
    acting = [i for i, (name, _) in enumerate(inputs) if name != "throttle" or airframe.throttle_acts]
    B = J[:n, n:][:, acting]
    C, D = np.vstack([np.eye(n), J[n:, :n]]), np.vstack([np.zeros((n, len(acting))), J[n:, n:][:, acting]])
    inputs = tuple(inputs[i] for i in acting)
    return LinearModel(STATES, inputs, (*STATES, *LOADS), J[:n, :n], B, C, D, trim, slopes.error, kinks, slopes.drift)


class _Slopes(NamedTuple):
    """Derivatives (rows, variables), step error and drift as in LinearModel, and (row, variable, below, above, jump) per kink."""

    J: Matrix
    error: float
    drift: float
    sharp: list[tuple[int, int, float, float, float]]


def _differentiate(values: Callable[[Matrix], list[float]], steps: Matrix) -> _Slopes:
    """Differentiate a function of offsets at 0.

    The stencil of each variable is -h, -h/2, 0, h/2, h. The point at -h/2 is evaluated only where the value at h/2 deviates from the
    parabola through the other three points: elsewhere there is no kink, and the cubic through four points interpolates the value.
    """
    offsets = np.diag(steps)
    centre = np.array(values(np.zeros_like(steps)))
    minus, plus, half_plus = (np.array([values(share * h) for h in offsets]).T for share in (-1.0, 1.0, 0.5))
    here = centre[:, None]
    off_parabola = half_plus - (0.375 * plus + 0.75 * here - 0.125 * minus)
    half_minus = 0.375 * minus + 0.75 * here - 0.125 * plus - off_parabola
    rise = plus - minus
    floor = 1e-11 * (np.abs(here) + 1.0)  # round-off of the row itself
    reach = np.max(np.abs(rise), axis=1, keepdims=True) / 2.0
    doubtful = np.flatnonzero(np.any(np.abs(off_parabola) > 1e-5 * reach + floor, axis=0))
    for j in doubtful:
        half_minus[:, j] = values(-0.5 * offsets[j])
    coarse = rise / (2.0 * steps)
    J = (4.0 * (half_plus - half_minus) / steps - coarse) / 3.0
    sharp = []
    smooth = np.ones(J.shape, dtype=bool)
    if doubtful.size:
        # Slopes over the four intervals of the stencil. A discontinuity corrupts one of them: the slope of a side is that of its two
        # intervals which is nearer to the median of all four.
        stencil = np.stack([minus, half_minus, np.broadcast_to(here, plus.shape), half_plus, plus])
        parts = np.diff(stencil, axis=0) / (steps / 2.0)
        off = np.abs(parts - np.median(parts, axis=0))
        below = np.where(off[0] < off[1], parts[0], parts[1])
        above = np.where(off[3] < off[2], parts[3], parts[2])
        mean = (above + below) / 2.0
        reach = np.max(np.abs(mean) * steps, axis=1, keepdims=True)  # without the jumps
        jumps = np.abs(J - mean) * steps > _KINK * reach + floor
        smooth = ~(jumps | (np.abs(above - below) * steps > _KINK * reach + floor))
        heights = np.where(jumps, rise - 2.0 * mean * steps, 0.0)
        sharp = [
            (int(i), int(j), float(below[i, j]), float(above[i, j]), float(heights[i, j]))
            for i, j in np.argwhere(~smooth)
        ]
        J = np.where(smooth, J, mean)
    error = float(np.max(np.where(smooth, np.abs(J - coarse) * steps, 0.0) / (reach + 1e-12 * steps)))
    again = np.abs(np.array(values(np.zeros_like(steps))) - centre)
    drift = float(np.max(again / np.maximum(reach[:, 0], 1e-9)))
    return _Slopes(J, error, drift, sharp)


def _row(i: int) -> str:
    n = len(STATES)
    return f"{STATES[i][0]}'" if i < n else LOADS[i - n][0]


def _where(airframe: Airframe, trim: TrimPoint, column: str) -> str:
    """Describe the table breakpoints of a variable at the trim point."""
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
