"""Airframe -> TrimPoint: straight and level flight, or the reason why there is none."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
import numpy.typing as npt

from flightbed.errors import NoTrimError
from flightbed.plant.base import Airframe, Controls, Motion
from flightbed.units import DEG, G0

Vector = npt.NDArray[np.float64]
Residual = Callable[[Vector], Vector]

_TOLERANCE = 1e-10  # largest residual of an accepted trim (g, g, rad/s^2); the contract promises 1e-8
_STEP = np.array([1e-5, 1e-5, 1e-5])  # of the Jacobian: rad, rad, throttle
_STARTS = (
    (2.0, -1.0, 0.25),
    (10.0, -2.0, 0.3),
    (20.0, -2.0, 0.5),
    (0.0, -1.0, 0.6),
)  # alpha deg, elevator deg, throttle
_EQUATIONS = ("speed", "lift", "pitch")
_UNITS = ("g", "g", "rad/s^2")


@dataclass(frozen=True)
class TrimPoint:
    """Steady symmetric equilibrium of an airframe. SI, radians.

    Attributes:
        residual: largest of |V'|/g, V|alpha'|/g and |q'| (g, g, rad/s^2) at the point.

    """

    airspeed_m_s: float
    alpha_rad: float
    theta_rad: float
    elevator_rad: float
    throttle_norm: float
    residual: float
    altitude_m: float

    @property
    def motion(self) -> Motion:
        """The trimmed state of motion."""
        return Motion(self.airspeed_m_s, self.alpha_rad, self.theta_rad, 0.0, self.altitude_m)

    @property
    def controls(self) -> Controls:
        """The trimmed controls."""
        return Controls(self.elevator_rad, self.throttle_norm)


def trim(airframe: Airframe, *, gamma_rad: float = 0.0) -> TrimPoint:
    """Find (alpha, elevator, throttle) of steady symmetric flight at the airframe's airspeed.

    Damped Newton from several starts on the residuals of the speed, lift and pitch equations; a bounded
    least-squares search afterwards only to say what is wrong when none converges inside the limits.

    Args:
        airframe: the equations of motion at one altitude, with ``airspeed_m_s`` of the condition.
        gamma_rad: flight-path angle, rad.

    Raises:
        NoTrimError: no equilibrium within the limits; carries the nearest point, its residual and what binds.

    """
    lower, upper = _bounds(airframe)

    def residual(x: Vector) -> Vector:
        v = airframe.airspeed_m_s
        motion = Motion(v, x[0], x[0] + gamma_rad, 0.0, airframe.altitude_m)
        rates = airframe.respond(motion, Controls(x[1], x[2])).rates
        return np.array([rates.airspeed / G0, v * rates.alpha / G0, rates.q])

    outside: Vector | None = None
    for alpha_deg, elevator_deg, throttle in _STARTS:
        x = _newton(residual, np.array([alpha_deg * DEG, elevator_deg * DEG, throttle]))
        if x is None:
            continue
        if np.all((lower <= x) & (x <= upper)):
            worst = float(np.max(np.abs(residual(x))))
            return TrimPoint(
                airframe.airspeed_m_s,
                float(x[0]),
                float(x[0] + gamma_rad),
                float(x[1]),
                float(x[2]),
                worst,
                airframe.altitude_m,
            )
        outside = x
    raise _no_trim(residual, lower, upper, outside)


def _bounds(airframe: Airframe) -> tuple[Vector, Vector]:
    limits, actuator = airframe.limits, airframe.actuator
    low, high = zip(limits.alpha_rad, (actuator.min_rad, actuator.max_rad), limits.throttle_norm, strict=True)
    return np.array(low), np.array(high)


def _jacobian(residual: Residual, x: Vector) -> Vector:
    columns = []
    for i, step in enumerate(_STEP):
        offset = np.zeros(3)
        offset[i] = step
        columns.append((residual(x + offset) - residual(x - offset)) / (2.0 * step))
    return np.array(columns).T


def _newton(residual: Residual, x: Vector) -> Vector | None:
    """Return a root, inside or outside the limits, or None when the iteration does not get there."""
    r = residual(x)
    for _ in range(40):
        norm = float(np.max(np.abs(r)))
        if norm < _TOLERANCE:
            return x
        try:
            step = np.linalg.solve(_jacobian(residual, x), -r)
        except np.linalg.LinAlgError:
            return None
        # Damped: short enough to stay in the tables, and never uphill.
        step *= min(1.0, 0.1 / float(np.max(np.abs(step[:2])) + 1e-300), 0.2 / (abs(float(step[2])) + 1e-300))
        for _ in range(6):
            trial = residual(x + step)
            if np.max(np.abs(trial)) < norm:
                break
            step *= 0.5
        else:
            return None
        x, r = x + step, trial
    return None


def _no_trim(residual: Residual, lower: Vector, upper: Vector, outside: Vector | None) -> NoTrimError:
    """Say why: which limit a trim would break, or which equation cannot be met and what binds there."""
    from scipy.optimize import least_squares  # slow to import, and only needed here

    fits = [
        least_squares(
            residual,
            np.clip(np.array([a * DEG, e * DEG, t]), lower + 1e-6, upper - 1e-6),
            bounds=(lower, upper),
            jac=partial(_jacobian, residual),
            x_scale=[0.1, 0.1, 0.3],
        )
        for a, e, t in _STARTS
    ]
    best = min(fits, key=lambda fit: float(fit.cost))
    x, r = best.x, best.fun
    names = ("alpha", "elevator", "throttle")
    margin = 1e-3 * (upper - lower)
    at_min, at_max = x <= lower + margin, x >= upper - margin
    binding = [
        f"{n} {'min' if low else 'max'}" for n, low, high in zip(names, at_min, at_max, strict=True) if low or high
    ]
    worst = int(np.argmax(np.abs(r)))
    # A trim outside the limits is worth telling only where the bounded search leans on the same limit.
    needs = (
        []
        if outside is None
        else [
            f"needs {n} {_show(n, v)}, limit is {_show(n, lo if low else hi)}"
            for n, v, lo, hi, low, high in zip(names, outside, lower, upper, at_min, at_max, strict=True)
            if (low and v < lo) or (high and v > hi)
        ]
    )
    nearest = ", ".join(f"{n} {_show(n, v)}" for n, v in zip(names, x, strict=True))
    why = "; ".join(needs) or f"nearest point {nearest}" + (
        f", at the limit of {' and '.join(binding)}" if binding else ""
    )
    return NoTrimError(
        f"{why} (residual {abs(r[worst]):.2g} {_UNITS[worst]} in {_EQUATIONS[worst]})",
        nearest={"alpha_rad": float(x[0]), "elevator_rad": float(x[1]), "throttle_norm": float(x[2])},
        residual=dict(zip(_EQUATIONS, map(float, r), strict=True)),
        binding=binding,
    )


def _show(name: str, value: float) -> str:
    return f"{value:.2f}" if name == "throttle" else f"{value / DEG:.1f} deg"
