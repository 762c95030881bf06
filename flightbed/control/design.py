"""Gains for the proportional and the proportional-integral law, by pole placement on the design model."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from flightbed.avionics.short_period import ShortPeriod, zero_order_hold
from flightbed.control import placement
from flightbed.control.base import Gains
from flightbed.core.errors import DesignError

Matrix = npt.NDArray[np.float64]

# Sillence (1999), Table 3, closed loop at K = 1.
_THESIS_SLOW_POLE = -1.4724
_THESIS_FAST_POLE = complex(-14.4615, 15.5040)
_FAST_TO_ACTUATOR = 0.6
_PITCH_RATE = np.array([0.0, 1.0, 0.0])


def default_poles(design: ShortPeriod) -> tuple[complex, ...]:
    """Return closed-loop poles near those of Sillence's Table 3, scaled to leave the actuator a margin.

    The slow pole stays; the fast pair keeps its damping ratio (0.68) but moves to 0.6 of the actuator's bandwidth; in the thesis it
    lies at 1.06. The margin is needed after a failure, because the correction 1/K multiplies every command to the actuator.
    """
    fast = _THESIS_FAST_POLE * (_FAST_TO_ACTUATOR * design.actuator_rad_s / abs(_THESIS_FAST_POLE))
    return complex(_THESIS_SLOW_POLE), fast, fast.conjugate()


def design_proportional(design: ShortPeriod, poles: Sequence[complex] | None = None) -> Gains:
    """Place the poles of (alpha, q, elevator); the reference gain gives unit DC gain from r to q (Sillence S 3.2).

    Raises:
        DesignError: the poles cannot be placed, or no reference gain exists.

    """
    A, b = design.with_actuator()
    k = _place(A, b, tuple(poles) if poles is not None else default_poles(design))
    return Gains(alpha=k[0], q=k[1], elevator=k[2], reference=reference_gain(design, k))


def design_integral(
    design: ShortPeriod, poles: Sequence[complex] | None = None, *, integral_pole: float = -0.5
) -> Gains:
    """Place the poles of (alpha, q, elevator, integral of r - q) (Sillence S 3.3); the reference gain is that of the P law."""
    A3, b3 = design.with_actuator()
    A, b = _with_integrator(A3, b3)
    k = _place(A, b, (*(poles if poles is not None else default_poles(design)), complex(integral_pole)))
    return Gains(alpha=k[0], q=k[1], elevator=k[2], reference=reference_gain(design, k[:3]), integral=k[3])


def reference_gain(design: ShortPeriod, feedback: Sequence[float]) -> float:
    """Return K_r = -1 / (c A_cl^-1 b), which gives unit DC gain from reference to pitch rate (Sillence S 3.2 omits the minus)."""
    A, b = design.with_actuator()
    dc = float(_PITCH_RATE @ np.linalg.solve(A + np.outer(b, feedback), b))
    if abs(dc) < 1e-9:
        raise DesignError("the elevator has no steady effect on pitch rate: no reference gain exists")
    return -1.0 / dc


def closed_loop(design: ShortPeriod, gains: Gains, *, effectiveness: float = 1.0, correction: float = 1.0) -> Matrix:
    """Return the closed-loop matrix of (alpha, q, elevator[, integral]); the integral is a state only if its gain is not 0.

    Args:
        effectiveness: K of the plant.
        correction: factor on the summed command at the actuator's input.

    """
    A, b = design.with_actuator(effectiveness)
    feedback = correction * np.array([gains.alpha, gains.q, gains.elevator])
    if gains.integral == 0.0:
        return A + np.outer(b, feedback)
    A4, b4 = _with_integrator(A, b)
    return A4 + np.outer(b4, [*feedback, correction * gains.integral])


def peak_deflection(design: ShortPeriod, gains: Gains, filter_rad_s: float) -> float:
    """Return the largest effective deflection from trim after a step of the command, rad per rad/s, of the healthy aircraft.

    The step passes through the prefilter, as in flight. Simulated for 5 s at 200 Hz.
    """
    A = closed_loop(design, gains)
    b = np.zeros(len(A))
    b[2] = design.actuator_rad_s * gains.reference
    if gains.integral:
        b[3] = 1.0
    held = zero_order_hold(A, b, 1.0 / 200.0)
    keep = np.exp(-filter_rad_s / 200.0) if filter_rad_s else 0.0
    x, r, peak = np.zeros(len(A)), 0.0, 0.0
    for _ in range(1000):
        r = keep * r + (1.0 - keep)
        x = held.A @ x + held.b * r
        peak = max(peak, abs(float(x[2])))
    return peak


def _with_integrator(A: Matrix, b: Matrix) -> tuple[Matrix, Matrix]:
    A4 = np.zeros((4, 4))
    A4[:3, :3] = A
    A4[3, :3] = -_PITCH_RATE
    return A4, np.append(b, 0.0)


def _place(A: Matrix, b: Matrix, poles: tuple[complex, ...]) -> list[float]:
    """Return the gains k for which the eigenvalues of A + b k are the poles."""
    wanted = ", ".join(f"{p.real:.4g}{p.imag:+.4g}j" if p.imag else f"{p.real:.4g}" for p in poles)
    try:
        return [-float(gain) for gain in placement.gains(A, b, poles)]
    except ValueError as problem:
        raise DesignError(f"cannot place the poles {wanted}: {problem}") from None
