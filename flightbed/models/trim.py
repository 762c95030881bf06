"""Airframe -> TrimPoint: steady flight (level, climb, pull-up, turn), or the reason for a failed trim."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from math import asin, atan2, cos, sin, sqrt, tan

import numpy as np
import numpy.typing as npt

from flightbed.core.errors import InputError, NoTrimError
from flightbed.core.units import DEG, G0
from flightbed.plant.base import Airframe, Controls, Motion

Vector = npt.NDArray[np.float64]
Residual = Callable[[Vector], Vector]

TOLERANCE = 1e-10  # largest residual of an accepted trim (g, rad/s^2); the contract promises 1e-8
# Largest residual for an aircraft whose response is not repeatable because its own control system moves between evaluations.
ACCEPTED = 1e-7
_STARTS = (
    (2.0, -1.0, 0.25),
    (10.0, -2.0, 0.3),
    (20.0, -2.0, 0.5),
    (0.0, -1.0, 0.6),
)  # alpha deg, elevator (25ths of its range), throttle
_EQUATIONS = ("speed", "lift", "pitch", "side force", "roll", "yaw")
_UNITS = ("g", "g", "rad/s^2", "g", "rad/s^2", "rad/s^2")


@dataclass(frozen=True)
class TrimPoint:
    """Steady flight of an airframe. SI, radians.

    Attributes:
        motion: state of motion at the airspeed and altitude of the condition.
        controls: elevator, throttle, aileron, rudder, in the units of the airframe's inputs.
        residual: largest of |V'|/g, V|alpha'|/g, V|beta'|/g, |q'|, |p'| and |r'| (g, rad/s^2).

    """

    motion: Motion
    controls: Controls
    residual: float

    @property
    def airspeed_m_s(self) -> float:
        """True airspeed, m/s."""
        return self.motion.airspeed_m_s

    @property
    def altitude_m(self) -> float:
        """Geometric altitude, m."""
        return self.motion.altitude_m

    @property
    def alpha_rad(self) -> float:
        """Angle of attack, rad."""
        return self.motion.alpha_rad

    @property
    def theta_rad(self) -> float:
        """Pitch attitude, rad."""
        return self.motion.theta_rad

    @property
    def gamma_rad(self) -> float:
        """Flight-path angle, rad."""
        return asin(self.motion.climb_m_s / self.motion.airspeed_m_s)

    @property
    def elevator_rad(self) -> float:
        """Elevator position, rad; for a stock aircraft the normalized elevator command."""
        return self.controls.elevator

    @property
    def throttle_norm(self) -> float:
        """Throttle command, 0 to 1."""
        return self.controls.throttle


def trim(
    airframe: Airframe, *, gamma_rad: float = 0.0, load_factor: float | None = None, bank_rad: float = 0.0
) -> TrimPoint:
    """Find alpha and the controls of steady flight at the airframe's airspeed.

    Level or climbing flight, a pull-up (``load_factor``: q = (n - cos gamma) g / V with everything else steady, as at the bottom
    of a loop), or a steady turn (``bank_rad``: turn rate g tan(phi) / (V cos gamma), theta from the rate-of-climb constraint of
    Stevens and Lewis, Aircraft Control and Simulation, eq 3.6-3). In asymmetric flight the unknowns include aileron, rudder and
    sideslip. An airframe without an engine glides: the flight-path angle replaces the throttle as an unknown.

    The method is a damped Newton iteration from several starts. If none converges within the limits, a bounded least-squares search
    finds the nearest point, for the error message.

    Args:
        airframe: the equations of motion at one altitude, with ``airspeed_m_s`` of the condition.
        gamma_rad: flight-path angle, rad.
        load_factor: lift over weight in a pull-up, g; None for steady flight.
        bank_rad: bank angle of a steady turn, right positive, rad.

    Raises:
        InputError: a load factor and a bank angle together, or a flight-path angle for a glider.
        NoTrimError: no equilibrium within the limits; carries the nearest point, its residual and the active limits.

    """
    if load_factor is not None and bank_rad:
        raise InputError(
            f"load_factor: must not be given with a bank angle (got {load_factor:g}); in a turn it follows from the bank angle"
        )
    if gamma_rad and not airframe.powered:
        raise InputError(
            f"gamma: must be 0 for {airframe.name}, which has no engine (got {gamma_rad / DEG:g} deg); "
            "the flight-path angle of a glide follows from the trim"
        )
    problem = _Problem(airframe, gamma_rad, load_factor, bank_rad)
    outside: Vector | None = None
    for alpha_deg, elevator, throttle in _STARTS:
        x = _newton(problem.residual, problem.start(alpha_deg, elevator, throttle), problem.steps)
        if x is None:
            continue
        if np.all((problem.low <= x) & (x <= problem.high)):
            worst = float(np.max(np.abs(problem.residual(x))))
            return TrimPoint(*problem.point(x), worst)
        outside = x
    best, at = _search(problem)
    x = _newton(problem.residual, best, problem.steps)
    if x is not None and np.all((problem.low <= x) & (x <= problem.high)):
        return TrimPoint(*problem.point(x), float(np.max(np.abs(problem.residual(x)))))
    raise _no_trim(problem, best, at, outside)


class _Problem:
    """Unknowns, equations and limits of one trim."""

    def __init__(self, airframe: Airframe, gamma_rad: float, load_factor: float | None, bank_rad: float) -> None:
        self.airframe, self._gamma, self._n, self._bank = airframe, gamma_rad, load_factor, bank_rad
        elevator, throttle, *lateral = airframe.inputs
        third = (throttle.low, throttle.high) if airframe.powered else (-60.0 * DEG, 30.0 * DEG)
        limits = [airframe.alpha_limits_rad, (elevator.low, elevator.high), third]
        self.names = ["alpha", "elevator", "throttle" if airframe.powered else "gamma"]
        self._elevator_scale = elevator.high / 25.0
        self._lateral = False
        if lateral:
            symmetric = np.array([1.0 * DEG, 0.0, 0.3 if airframe.powered else 0.0])
            rates = self._rates(symmetric)
            # On a rotating earth beta' of a symmetric aircraft is not exactly zero.
            self._lateral = bool(bank_rad) or max(abs(rates[3]), abs(rates[4]), abs(rates[5])) > 1e-6
            if self._lateral:
                limits += [(-20.0 * DEG, 20.0 * DEG), *((i.low, i.high) for i in lateral)]
                self.names += ["beta", "aileron", "rudder"]
        self.low, self.high = np.array(limits).T
        scales = [1.0, elevator.high / 0.4363, 1.0, 1.0, *(i.high / 0.4363 for i in lateral)]
        self.steps = 1e-5 * np.array(scales[: len(limits)])

    def start(self, alpha_deg: float, elevator: float, throttle: float) -> Vector:
        x = np.zeros(len(self.names))
        x[:3] = alpha_deg * DEG, elevator * self._elevator_scale, throttle if self.airframe.powered else -0.1
        return x

    def point(self, x: Vector) -> tuple[Motion, Controls]:
        alpha, elevator, third = map(float, x[:3])
        beta, aileron, rudder = map(float, x[3:]) if self._lateral else (0.0, 0.0, 0.0)
        gamma, throttle = (self._gamma, third) if self.airframe.powered else (third, 0.0)
        v, phi = self.airframe.airspeed_m_s, self._bank
        theta = _theta(alpha, beta, phi, gamma)
        turn = G0 * tan(phi) / (v * cos(gamma))
        q = turn * sin(phi) * cos(theta)
        if self._n is not None:
            q = (self._n - cos(gamma)) * G0 / v
        motion = Motion(
            v, alpha, theta, q, self.airframe.altitude_m, beta, phi, -turn * sin(theta), turn * cos(phi) * cos(theta)
        )
        return motion, Controls(elevator, throttle, aileron, rudder)

    def _rates(self, x: Vector) -> Vector:
        rates, v = self.airframe.respond(*self.point(x)).rates, self.airframe.airspeed_m_s
        return np.array([rates.airspeed / G0, v * rates.alpha / G0, rates.q, v * rates.beta / G0, rates.p, rates.r])

    def residual(self, x: Vector) -> Vector:
        return self._rates(x) if self._lateral else self._rates(x)[:3]


def _theta(alpha: float, beta: float, phi: float, gamma: float) -> float:
    if not beta and not phi:
        return alpha + gamma
    a = cos(alpha) * cos(beta)
    b = sin(phi) * sin(beta) + cos(phi) * sin(alpha) * cos(beta)
    s = sin(gamma)
    return atan2(a * b + s * sqrt(max(a * a - s * s + b * b, 0.0)), a * a - s * s)


def _jacobian(residual: Residual, steps: Vector, x: Vector) -> Vector:
    columns = []
    for i, step in enumerate(steps):
        offset = np.zeros(len(x))
        offset[i] = step
        columns.append((residual(x + offset) - residual(x - offset)) / (2.0 * step))
    return np.array(columns).T


def _newton(residual: Residual, x: Vector, steps: Vector) -> Vector | None:
    """Return a root, inside or outside the limits, or None if the iteration does not converge."""
    r = residual(x)
    largest = np.array([0.1, 1e4 * steps[1], 0.2, *(1e4 * steps[3:])])
    for _ in range(40):
        norm = float(np.max(np.abs(r)))
        if norm < TOLERANCE:
            return x
        try:
            step = np.linalg.solve(_jacobian(residual, steps, x), -r)
        except np.linalg.LinAlgError:
            return None
        # Damping: the step stays within the tables and never increases the residual.
        step *= min(1.0, 1.0 / float(np.max(np.abs(step) / largest) + 1e-300))
        for _ in range(6):
            trial = residual(x + step)
            if np.max(np.abs(trial)) < norm:
                break
            step *= 0.5
        else:
            return x if norm < ACCEPTED else None
        x, r = x + step, trial
    return None


def _search(problem: _Problem) -> tuple[Vector, Vector]:
    """Return the point within the limits that minimizes the sum of squared residuals, and its residuals."""
    from scipy.optimize import least_squares  # slow to import, needed only here

    lower, upper = problem.low, problem.high
    inside = 1e-5 * (upper - lower)
    if not np.all(np.isfinite(problem.residual(problem.start(*_STARTS[0])))):
        return problem.start(*_STARTS[0]), problem.residual(problem.start(*_STARTS[0]))
    fits = [
        least_squares(
            problem.residual,
            np.clip(problem.start(*start), lower + inside, upper - inside),
            bounds=(lower, upper),
            jac=partial(_jacobian, problem.residual, problem.steps),
            x_scale=1e4 * problem.steps,
        )
        for start in _STARTS
    ]
    best = min(fits, key=lambda fit: float(fit.cost))
    return np.asarray(best.x), np.asarray(best.fun)


def _no_trim(problem: _Problem, x: Vector, r: Vector, outside: Vector | None) -> NoTrimError:
    """Build the error: the limit that a trim would exceed, or the unsatisfied equation and the active limits."""
    lower, upper = problem.low, problem.high
    margin = 1e-3 * (upper - lower)
    at_min, at_max = x <= lower + margin, x >= upper - margin
    binding = [
        f"{n} {'min' if low else 'max'}"
        for n, low, high in zip(problem.names, at_min, at_max, strict=True)
        if low or high
    ]
    worst = int(np.argmax(np.abs(r)))
    # A trim outside the limits explains the failure only if the bounded search ends at the same limit.
    needs = (
        []
        if outside is None
        else [
            f"needs {n} {_show(problem, n, v)}, limit is {_show(problem, n, lo if low else hi)}"
            for n, v, lo, hi, low, high in zip(problem.names, outside, lower, upper, at_min, at_max, strict=True)
            if (low and v < lo) or (high and v > hi)
        ]
    )
    nearest = ", ".join(f"{n} {_show(problem, n, v)}" for n, v in zip(problem.names, x, strict=True))
    jumps = [] if binding else [v for v in problem.airframe.breakpoints("alpha") if abs(v - x[0]) < 2e-3 * DEG]
    why = "; ".join(needs) or f"nearest point {nearest}" + (
        f", at the limit of {' and '.join(binding)}" if binding else ""
    )
    why += f", where the forces are discontinuous at alpha {jumps[0] / DEG:.3g} deg" if jumps else ""
    return NoTrimError(
        f"{why} (residual {abs(r[worst]):.2g} {_UNITS[worst]} in {_EQUATIONS[worst]})",
        nearest={_key(problem, n): float(v) for n, v in zip(problem.names, x, strict=True)},
        residual=dict(zip(_EQUATIONS, map(float, r), strict=False)),
        binding=binding,
    )


def _angle(problem: _Problem, name: str) -> bool:
    units = {i.name: i.unit for i in problem.airframe.inputs}
    return units.get(name, "rad") == "rad"


def _key(problem: _Problem, name: str) -> str:
    return f"{name}_rad" if _angle(problem, name) else f"{name}_norm"


def _show(problem: _Problem, name: str, value: float) -> str:
    return f"{value / DEG:.1f} deg" if _angle(problem, name) else f"{value:.2f}"
