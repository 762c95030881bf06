"""The exact linear plant against python-control and against integration by scipy."""

from __future__ import annotations

import control
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from flightbed.plant.linear import LinearPlant
from flightbed.short_period import ShortPeriod


def test_equals_python_controls_response(design: ShortPeriod) -> None:
    plant, commands = LinearPlant(design, control_hz=100), 0.05 * np.sin(0.07 * np.arange(200))
    for command in commands:
        plant.advance(float(command) + design.elevator_trim_rad, 1.0, 1.0)
    A, b = design.with_actuator()
    discrete = control.c2d(control.ss(A, b[:, None], np.eye(3), 0), 0.01)
    response = control.forced_response(discrete, np.arange(201) * 0.01, np.append(commands, 0.0))
    truth = plant.sense()
    assert truth.alpha_rad - design.alpha_trim_rad == pytest.approx(response.outputs[0, -1], abs=1e-12)
    assert truth.q_rad_s == pytest.approx(response.outputs[1, -1], abs=1e-12)
    assert truth.elevator_rad - design.elevator_trim_rad == pytest.approx(response.outputs[2, -1], abs=1e-12)


@pytest.mark.parametrize("absolute", [True, False])
def test_lost_effectiveness_and_mean_deflection_against_integration(design: ShortPeriod, absolute: bool) -> None:
    plant, K, command = LinearPlant(design, control_hz=100, absolute=absolute), 0.3, design.elevator_trim_rad + 0.04
    plant.advance(command, K, K)
    plant.advance(command, K, K)

    def rates(_t: float, y: np.ndarray) -> list[float]:
        alpha, q, delta, _ = y
        acting = K * delta - design.elevator_trim_rad if absolute else K * (delta - design.elevator_trim_rad)
        x = design.A @ [alpha, q] + design.b * acting
        return [*x, design.actuator_rad_s * (command - delta), delta]

    start = [0.0, 0.0, design.elevator_trim_rad, 0.0]
    half = solve_ivp(rates, (0, 0.01), start, rtol=1e-11, atol=1e-14).y[:, -1]
    end = solve_ivp(rates, (0, 0.01), [*half[:3], 0.0], rtol=1e-11, atol=1e-14).y[:, -1]
    truth = plant.sense()
    assert [truth.alpha_rad - design.alpha_trim_rad, truth.q_rad_s, truth.elevator_rad] == pytest.approx(
        end[:3], abs=1e-11
    )
    assert truth.elevator_mean_rad == pytest.approx(end[3] / 0.01, abs=1e-11)


def test_at_rest_it_stays_at_trim(design: ShortPeriod) -> None:
    plant = LinearPlant(design, control_hz=100)
    for _ in range(500):
        plant.advance(design.elevator_trim_rad, 1.0, 1.0)
    assert plant.sense().alpha_rad == design.alpha_trim_rad
