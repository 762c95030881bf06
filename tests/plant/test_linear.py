"""The exact linear plant against python-control and against integration by scipy."""

from __future__ import annotations

from math import pi

import control
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from flightbed.gusts import calm, one_minus_cosine
from flightbed.plant.linear import LinearPlant
from flightbed.short_period import ShortPeriod
from flightbed.signals import HEALTHY, Health


def test_equals_python_controls_response(design: ShortPeriod) -> None:
    plant, commands = LinearPlant(design, control_hz=100), 0.05 * np.sin(0.07 * np.arange(200))
    for command in commands:
        plant.advance(float(command) + design.elevator_trim_rad, HEALTHY, HEALTHY)
    A, b = design.with_actuator()
    discrete = control.c2d(control.ss(A, b[:, None], np.eye(3), 0), 0.01)
    response = control.forced_response(discrete, np.arange(201) * 0.01, np.append(commands, 0.0))
    truth = plant.sense()
    assert truth.alpha_rad - design.alpha_trim_rad == pytest.approx(response.outputs[0, -1], abs=1e-12)
    assert truth.q_rad_s == pytest.approx(response.outputs[1, -1], abs=1e-12)
    assert truth.elevator_rad - design.elevator_trim_rad == pytest.approx(response.outputs[2, -1], abs=1e-12)


@pytest.mark.parametrize("absolute", [True, False])
@pytest.mark.parametrize("health", [Health(0.3, 0.3), Health(0.3, 0.9), Health(1.0, 0.2)])
def test_lost_effectiveness_and_mean_deflection_against_integration(
    design: ShortPeriod, absolute: bool, health: Health
) -> None:
    plant, command = LinearPlant(design, control_hz=100, absolute=absolute), design.elevator_trim_rad + 0.04
    plant.advance(command, health, health)
    plant.advance(command, health, health)
    left = np.array([health.elevator_force, health.effectiveness]) * design.b

    def rates(_t: float, y: np.ndarray) -> list[float]:
        alpha, q, delta, _ = y
        trim = (design.b if absolute else left) * design.elevator_trim_rad
        x = design.A @ [alpha, q] + left * delta - trim
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
        plant.advance(design.elevator_trim_rad, HEALTHY, HEALTHY)
    assert plant.sense().alpha_rad == design.alpha_trim_rad


def test_a_gust_enters_as_angle_of_attack_and_is_seen_by_the_vane(design: ShortPeriod) -> None:
    """Against integration of the continuous gust; held at its mean over a period, the plant is off by (dt / rise)^2 pi^2 / 24."""
    speed, up, rise, start = 250.0, 1.5, 0.2, 0.05
    gusts = one_minus_cosine(calm, at_s=start, up_m_s=up, rise_s=rise, hold_s=0.1)
    plant = LinearPlant(design, control_hz=100, airspeed_m_s=speed, gusts=gusts)

    def gust(t: float) -> float:
        x = min(max(t - start, 0.0), max(0.0, 2 * rise + 0.1 - (t - start)), rise)
        return up / 2 * (1 - np.cos(pi * x / rise))

    def rates(t: float, y: np.ndarray) -> np.ndarray:
        rising: np.ndarray = design.A @ [y[0] + gust(t) / speed, y[1]]
        return rising

    times = np.arange(80) / 100
    exact = solve_ivp(rates, (0, 1), [0.0, 0.0], t_eval=times, rtol=1e-10, atol=1e-13, max_step=0.005).y
    flown = []
    for _ in times:
        flown.append(plant.sense())
        plant.advance(design.elevator_trim_rad, HEALTHY, HEALTHY)
    blown = np.array([truth.gust_up_m_s for truth in flown])
    assert blown == pytest.approx([gust(t) for t in times], abs=1e-12)
    alpha = np.array([truth.alpha_rad for truth in flown]) - design.alpha_trim_rad
    q = np.array([truth.q_rad_s for truth in flown])
    tolerance = pi**2 / 24 * (0.01 / rise) ** 2
    assert np.abs(alpha - blown / speed - exact[0]).max() < tolerance * np.abs(exact[0]).max()
    assert np.abs(q - exact[1]).max() < tolerance * np.abs(exact[1]).max()
    assert np.abs(q).max() > 0.1 * design.A[1, 0] * up / speed


def test_what_it_cannot_fly_is_refused(design: ShortPeriod) -> None:
    shifted = Health(cg_shift_cbar=0.02)
    with pytest.raises(ValueError, match=r"a c\.g\. shift of 0\.02 cbar has no meaning for A and b alone"):
        LinearPlant(design, control_hz=100).advance(0.0, shifted, shifted)
    gusts = one_minus_cosine(calm, at_s=1.0, up_m_s=1.0, rise_s=1.0, hold_s=1.0)
    with pytest.raises(ValueError, match="needs airspeed_m_s"):
        LinearPlant(design, control_hz=100, gusts=gusts)
