"""Load-factor laws: interface, design models, and gains scheduled over dynamic pressure.

The command is an increment over unaccelerated flight, a_n = nz - cos theta cos phi, up positive; a_n of Kemp (1987), eq (6.1), is positive
down. The accelerometer's reading contains gravity; the attitude terms remove it, so that a zero command is a straight flight path of any
slope.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import cos
from typing import Any, ClassVar, Protocol

import numpy as np
import numpy.typing as npt

from flightbed.avionics.pitch_points import PitchPoint
from flightbed.avionics.short_period import zero_order_hold
from flightbed.control import placement
from flightbed.core.atmosphere import air
from flightbed.core.by_address import by_address
from flightbed.core.compiled import compiled
from flightbed.core.errors import DesignError
from flightbed.core.signals import Measurement

Array = npt.NDArray[np.float64]
PRESSURE, ALPHA, RATE, ERROR, INTEGRAL = range(5)  # columns of a packed table of gains
POLES = (complex(-4.0, 2.0), complex(-4.0, -2.0), complex(-10.0))  # rad/s, Kemp S 6.2


class LoadFactorLaw(Protocol):
    """A law commanded in g; its demand is the *effective* deflection, trim included, as for ``base.Law``."""

    def demand(self, measurement: Measurement, *, increment_ref_g: float, hold: bool) -> float:
        """Return the demanded effective deflection, rad.

        Args:
            measurement: the sensors' readings.
            increment_ref_g: reference of a_n, up positive.
            hold: the last command was limited by the stops: stop integrating.

        """

    @property
    def model(self) -> tuple[float, float, float, float]:
        """Identified a_0, a_1, b_0, b_1, as ``Plid.parameters``; nan for a law without identification."""


# Address and call of the functions ``compiled_demand``.
LAWS = by_address(("array", "array", "float", "float", "bool", "array"), "float")


class PackableLaw(Protocol):
    """A load-factor law that the compiled flight computer can fly. The class itself, not a base class, has ``compiled_demand``.

    ``compiled_demand(memory, now, increment_ref_g, increment_g, hold, model)`` is ``demand`` in compiled code:

    - memory: as from ``packed``; updated.
    - now: fields of the Measurement.
    - increment_ref_g, increment_g: reference of a_n, and its reading.
    - hold: as in ``LoadFactorLaw``.
    - model: (4,), the identified model, written by a law that identifies one.
    """

    compiled_demand: ClassVar[Callable[..., Any]]

    def packed(self) -> Array | None:
        """Return the memory of a new law, flat; None if its settings have no compiled form."""


@dataclass(frozen=True, eq=False)
class GainTable:
    """Gains over dynamic pressure, constant beyond its ends: u = alpha a + q q + error (r - a_n) + integral I(r - a_n).

    Attributes:
        dynamic_pressure_pa: (N,) ascending.
        gains: (N, 4), alpha, q, error, integral; 1, s, rad/g, rad/(g s).

    """

    dynamic_pressure_pa: Array
    gains: Array

    def packed(self) -> Array:
        """Return the table of ``interpolated``, (N, 5)."""
        return np.column_stack([self.dynamic_pressure_pa, self.gains])

    def at(self, dynamic_pressure_pa: float) -> tuple[float, float, float, float]:
        """Return the gains (alpha, q, error, integral), interpolated linearly between the points."""
        nodes, p = self.dynamic_pressure_pa, dynamic_pressure_pa
        i = min(max(int(np.searchsorted(nodes, p)), 1), len(nodes) - 1)
        share = min(max((p - float(nodes[i - 1])) / float(nodes[i] - nodes[i - 1]), 0.0), 1.0)
        low, high = self.gains[i - 1].tolist(), self.gains[i].tolist()
        alpha, q, error, integral = (a + share * (b - a) for a, b in zip(low, high, strict=True))
        return alpha, q, error, integral


@dataclass(frozen=True, eq=False)
class LoadFactorDesign:
    """Design data of load-factor laws.

    Attributes:
        points: trim points in ascending order of dynamic pressure.
        here: trim point at the start of the flight.
        actuator_rad_s: bandwidth of the first-order actuator.
        stops_rad: lower and upper stop of the elevator.
        elevator_trim_rad: elevator deflection at the start of the flight.

    """

    points: tuple[PitchPoint, ...]
    here: PitchPoint
    actuator_rad_s: float
    stops_rad: tuple[float, float]
    elevator_trim_rad: float


@compiled
def interpolated(table: Array, dynamic_pressure_pa: float) -> tuple[float, float, float, float]:
    """Return ``GainTable.at`` for compiled callers; ``table`` is (N, 5), each row a dynamic pressure and its gains."""
    count, i = table.shape[0], 0
    while i < count and table[i, PRESSURE] < dynamic_pressure_pa:
        i += 1
    i = min(max(i, 1), count - 1)
    low, high = table[i - 1], table[i]
    share = min(max((dynamic_pressure_pa - low[PRESSURE]) / (high[PRESSURE] - low[PRESSURE]), 0.0), 1.0)
    return (
        low[ALPHA] + share * (high[ALPHA] - low[ALPHA]), low[RATE] + share * (high[RATE] - low[RATE]),
        low[ERROR] + share * (high[ERROR] - low[ERROR]), low[INTEGRAL] + share * (high[INTEGRAL] - low[INTEGRAL]),
    )  # fmt: skip


@compiled
def pressure_pa(mach: float, altitude_m: float, square: float) -> float:
    """Return ``dynamic_pressure_pa`` for compiled callers.

    ``square`` is the exponent 2: as a constant it would be compiled as a product, whose last bit differs from that of Python's power.
    """
    pressure = air(altitude_m)[0]
    return float(0.7 * pressure * mach**square)


def increment_g(measurement: Measurement) -> float:
    """Return the measured a_n, up positive, g."""
    return measurement.nz_g - level_g(measurement)


def level_g(measurement: Measurement) -> float:
    """Return the load factor of unaccelerated flight at the measured attitude, g."""
    return cos(measurement.theta_rad) * cos(measurement.phi_rad)


def design_gains(point: PitchPoint, poles: Sequence[complex] = POLES) -> tuple[float, float, float, float]:
    """Place the poles of (alpha, q, integral of the error), the feedback of Kemp S 6.1. Returns (alpha, q, error, integral).

    The gain of the error itself is a free parameter: it places the zero of the reference on the fastest pole, so that the other two
    poles determine the response.

    The design neglects the actuator and the elevator's own lift in the error feedback, error d u, an algebraic loop within a tick:
    gains that account for this loop demand the elevator's full rate. ``closed_loop_poles`` returns the poles with both effects.

    Raises:
        DesignError: the poles cannot be placed, or their number is not three.

    """
    A, b = np.zeros((3, 3)), np.append(point.b, -point.d)
    A[:2, :2], A[2, :2] = point.A, -point.c
    try:
        alpha, q, summed = placement.gains(A, b, poles).tolist()
    except ValueError as problem:
        raise DesignError(
            f"load factor at {point.dynamic_pressure_pa:.0f} Pa: cannot place the poles: {problem}"
        ) from None
    integral = -summed
    error = integral / max(abs(pole) for pole in poles)
    return -alpha + error * float(point.c[0]), -q + error * float(point.c[1]), error, integral


def closed_loop_poles(
    point: PitchPoint, gains: tuple[float, float, float, float], *, actuator_rad_s: float
) -> npt.NDArray[np.complex128]:
    """Return the poles of (alpha, q, actuator, integral) with these gains, rad/s, (4,); a_n includes the elevator's own lift."""
    alpha, q, error, integral = gains
    A = np.zeros((4, 4))
    A[:2, :2], A[:2, 2] = point.A, point.b
    A[2] = actuator_rad_s * np.array(
        [alpha - error * point.c[0], q - error * point.c[1], -error * point.d - 1.0, integral]
    )
    A[3, :3] = -point.c[0], -point.c[1], -point.d
    return np.asarray(np.linalg.eigvals(A), dtype=np.complex128)


def gain_table(points: Sequence[PitchPoint], poles: Sequence[complex] = POLES) -> GainTable:
    """Design gains at every level trim point; beyond the first and last of these points the gains are constant.

    Raises:
        DesignError: the poles cannot be placed at one of the points.

    """
    points = [point for point in points if point.level]
    return GainTable(
        np.array([point.dynamic_pressure_pa for point in points]), np.array([design_gains(p, poles) for p in points])
    )


def second_order(
    point: PitchPoint, *, pitch_rate_gain: float, actuator_rad_s: float, hz: int
) -> tuple[float, float, float, float]:
    """Return a_0, a_1, b_0, b_1 of the second-order model from the input of the inner loop, u - G q, to -a_n at the control rate.

    Least squares on the impulse response from the second sample on, with b_1 = 0. The first sample of the response contains the
    tail's own lift, whose sign is a known defect of the F-16 file, and half a period of delay: a model that includes it has a zero
    near its poles, and gains designed on it are large. The model neglects the tail's lift and the force Z_delta.

    Args:
        point: short period and load factor at the trim point.
        pitch_rate_gain: G of the inner loop, elevator = u + G q, s.
        actuator_rad_s: bandwidth of the actuator.
        hz: control rate.

    """
    A, b = np.zeros((3, 3)), np.array([0.0, 0.0, actuator_rad_s])
    A[:2, :2], A[1, 2], A[2, 2] = point.A, point.b[1], -actuator_rad_s
    held = zero_order_hold(A, b, 1.0 / hz)
    closed = held.A + np.outer(held.b, [0.0, pitch_rate_gain, 0.0])
    output = -np.append(point.c, 0.0)
    x, y = held.b.copy(), [0.0]
    for _ in range(10 * hz):
        y.append(float(output @ x))
        x = closed @ x
    answer = np.array(y)
    struck = np.zeros(len(answer) - 2)
    struck[0] = 1.0
    past = np.column_stack([answer[1:-1], answer[:-2], struck])
    a_1, a_0, b_0 = np.linalg.lstsq(past, answer[2:], rcond=None)[0].tolist()
    return a_0, a_1, b_0, 0.0
