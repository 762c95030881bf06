"""How far the linear model is from the nonlinear aircraft: a small elevator doublet through both."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from flightbed.aircraft import Aircraft
from flightbed.linearize import LinearModel
from flightbed.plant.jsbsim import JsbsimPlant, Start
from flightbed.short_period import zero_order_hold
from flightbed.units import DEG

Matrix = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Validation:
    """Largest difference between the two responses at one plant rate, per state, relative to the largest response.

    Attributes:
        plant_hz: the rate.
        errors: state -> error.

    """

    plant_hz: int
    errors: dict[str, float]


def validate(
    aircraft: Aircraft,
    model: LinearModel,
    *,
    plant_hz: tuple[int, ...] = (200, 400),
    amplitude_rad: float = 0.05 * DEG,
    duration_s: float = 2.0,
    cg_shift_cbar: float = 0.0,
    effectiveness: float = 1.0,
) -> tuple[Validation, ...]:
    """Fly a doublet of the elevator command, one second long, through JSBSim and through the linear model.

    The linear model gets the overlay's actuator lag as a further state. From the nonlinear response a flight without the doublet
    is subtracted: an aircraft that burns fuel does not stay at trim quite. What remains is JSBSim's integration step (the
    error falls with it) and what is nonlinear at this amplitude.
    """
    trim = model.trim
    start = Start(
        trim.altitude_m, trim.airspeed_m_s, trim.alpha_rad, trim.theta_rad, trim.elevator_rad, trim.throttle_norm
    )
    n = model.A.shape[0]
    A, b = np.zeros((n + 1, n + 1)), np.zeros(n + 1)
    A[:n, :n], A[:n, n] = model.A, model.B[:, 0]
    A[n, n], b[n] = -aircraft.actuator.lag_rad_s, aircraft.actuator.lag_rad_s

    def flown(hz: int, size_rad: float) -> Matrix:
        plant = JsbsimPlant(
            aircraft, start, control_hz=hz, plant_hz=hz, cg_shift_cbar=cg_shift_cbar, effectiveness=effectiveness
        )
        rows = []
        for k in range(round(duration_s * hz)):
            plant.advance(trim.elevator_rad + size_rad * _doublet(k / hz), effectiveness, effectiveness)
            truth = plant.sense()
            rows.append([truth.airspeed_m_s, truth.alpha_rad, truth.theta_rad, truth.q_rad_s, truth.altitude_m])
        return np.array(rows)

    results = []
    for hz in plant_hz:
        discrete = zero_order_hold(A, b, 1.0 / hz)
        x, predicted = np.zeros(n + 1), []
        for k in range(round(duration_s * hz)):
            x = discrete.A @ x + discrete.b * amplitude_rad * _doublet(k / hz)
            predicted.append(x[:n].copy())
        response = flown(hz, amplitude_rad) - flown(hz, 0.0)
        error = np.max(np.abs(response - np.array(predicted)), axis=0) / np.max(np.abs(response), axis=0)
        names = [name for name, _ in model.states]
        results.append(Validation(hz, dict(zip(names, map(float, error), strict=True))))
    return tuple(results)


def _doublet(t_s: float) -> float:
    return 1.0 if t_s < 0.5 else -1.0 if t_s < 1.0 else 0.0
