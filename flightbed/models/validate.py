"""Validation of a linear model: responses of the linear model and of the nonlinear aircraft to small doublets."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from flightbed.aircraft.overlay import Aircraft
from flightbed.avionics.short_period import zero_order_hold
from flightbed.core.units import DEG
from flightbed.models.linearize import LATERAL, LONGITUDINAL, STATES, LinearModel
from flightbed.plant.airframe import JsbsimAirframe
from flightbed.plant.base import Controls

Matrix = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Validation:
    """Errors of the linear model's response at one plant rate.

    Attributes:
        plant_hz: plant rate, Hz.
        errors: state -> largest difference between the two responses, relative to the largest response.

    """

    plant_hz: int
    errors: dict[str, float]


def validate(
    airframe: JsbsimAirframe,
    model: LinearModel,
    *,
    plant_hz: tuple[int, ...] = (200, 400),
    amplitude: float = 0.05 * DEG,
    duration_s: float = 2.0,
) -> tuple[Validation, ...]:
    """Compare JSBSim and the linear model in one-second doublets of the elevator and of the rudder.

    The elevator doublet is compared in airspeed, alpha, theta, q and altitude, the rudder doublet in beta, phi, p, r and psi. The linear
    model includes the overlay's elevator actuator; it does not include the actuators and filters of a stock aircraft, which therefore
    appear as errors. A flight without the doublet is subtracted from the nonlinear response, because an aircraft that burns fuel
    departs slowly from trim. The remaining error has two sources: JSBSim's integration step (the error decreases with the step) and
    nonlinearity at this amplitude.

    Args:
        airframe: the nonlinear aircraft at its condition.
        model: its full linear model.
        plant_hz: plant rates, Hz.
        amplitude: amplitude of the doublets, in the unit of the input.
        duration_s: duration of each flight, s.

    Returns:
        One Validation per plant rate.

    """
    trim = model.trim
    inputs = [name for name, _ in model.inputs]
    if isinstance(airframe.aircraft, Aircraft):
        model = model.with_actuator("elevator", airframe.aircraft.actuator.lag_rad_s)
    n = len(model.states)

    def fly(hz: int, control: str, size: float) -> Matrix:
        place = Controls._fields.index(control)
        commands = []
        for k in range(round(duration_s * hz)):
            values = list(trim.controls)
            values[place] += size * _doublet(k / hz)
            commands.append(Controls(*values))
        return airframe.free_flight(trim.motion, trim.controls, commands, hz=hz)

    results = []
    for hz in plant_hz:
        errors: dict[str, float] = {}
        for control, states in (("elevator", LONGITUDINAL), ("rudder", LATERAL)):
            discrete = zero_order_hold(model.A, model.B[:, inputs.index(control)], 1.0 / hz)
            x, predicted = np.zeros(n), []
            for k in range(round(duration_s * hz)):
                x = discrete.A @ x + discrete.b * amplitude * _doublet(k / hz)
                predicted.append(x[: len(STATES)].copy())
            response = fly(hz, control, amplitude) - fly(hz, control, 0.0)
            error = np.max(np.abs(response - np.array(predicted)), axis=0) / np.max(np.abs(response), axis=0)
            errors |= {name: float(error[STATES.index((name, unit))]) for name, unit in states}
        results.append(Validation(hz, errors))
    return tuple(results)


def _doublet(t_s: float) -> float:
    return 1.0 if t_s < 0.5 else -1.0 if t_s < 1.0 else 0.0
