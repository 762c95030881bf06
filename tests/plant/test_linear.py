"""The exact linear plant against python-control and against integration by scipy."""

from __future__ import annotations

from itertools import pairwise
from math import pi
from typing import Any

import control
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.stats import chi2, norm

from flightbed.avionics.short_period import Discrete, ShortPeriod, zero_order_hold
from flightbed.core.signals import HEALTHY, Health, Truth
from flightbed.core.units import DEG, G0
from flightbed.models.linear_aircraft import load_linear_aircraft
from flightbed.plant import linear
from flightbed.plant.gusts import Gusts, calm, one_minus_cosine
from flightbed.plant.linear import LinearPlant


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
    """Against integration of the continuous gust; holding the mean over a period has an error of (dt / rise)^2 pi^2 / 24."""
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


def test_unsupported_damage_and_gusts_are_rejected(design: ShortPeriod) -> None:
    shifted = Health(cg_shift_cbar=0.02)
    with pytest.raises(ValueError, match=r"cg_shift_cbar: A and b alone do not model a c\.g\. shift \(got 0\.02\)"):
        LinearPlant(design, control_hz=100).advance(0.0, shifted, shifted)
    gusts = one_minus_cosine(calm, at_s=1.0, up_m_s=1.0, rise_s=1.0, hold_s=1.0)
    with pytest.raises(ValueError, match="airspeed_m_s: must be given with gusts"):
        LinearPlant(design, control_hz=100, gusts=gusts)


def _by_hand(design: ShortPeriod, health: Health, *, absolute: bool, dt: float) -> np.ndarray:
    """Matrix exponential over (alpha, q, elevator, integral of elevator, command, 1), absolute deflections, written out."""
    (za, zq), (ma, mq), (zd, md) = *design.A, design.b
    force, K, lag, trim = health.elevator_force, health.effectiveness, design.actuator_rad_s, design.elevator_trim_rad
    lift, moment = (zd * trim, md * trim) if absolute else (force * zd * trim, K * md * trim)
    M = np.array([
        [za, zq, force * zd, 0, 0, -lift],
        [ma, mq, K * md, 0, 0, -moment],
        [0, 0, -lag, 0, lag, 0],
        [0, 0, 1, 0, 0, 0],
        [0, 0, 0, 0, 0, 0],
        [0, 0, 0, 0, 0, 0],
    ])  # fmt: skip
    held: np.ndarray = expm(M * dt)
    return held


@pytest.mark.parametrize("absolute", [True, False])
def test_shares_that_come_and_go_in_flight_against_matrices_written_out(design: ShortPeriod, absolute: bool) -> None:
    """Separate shares of force and moment, a ramp and a return to an earlier Health; differences are round-off."""
    structural_damage = [
        Health(0.3, 0.9),
        Health(0.3, 0.9),
        Health(1.0, 0.0),
        Health(0.0, 1.0),
        HEALTHY,
        Health(0.3, 0.9),
    ]
    ramp = [Health(1.0 - k / 40, 1.0 - k / 80) for k in range(20)]
    healths = [HEALTHY, *structural_damage, *ramp, Health(), HEALTHY, *reversed(structural_damage)]
    plant = LinearPlant(design, control_hz=100, absolute=absolute)
    y = np.array([0.0, 0.0, design.elevator_trim_rad, 0.0])
    for tick, health in enumerate(healths):
        command = design.elevator_trim_rad + 0.05 * np.cos(0.3 * tick)
        plant.advance(command, health, health)
        y = (_by_hand(design, health, absolute=absolute, dt=0.01) @ [*y[:3], 0.0, command, 1.0])[:4]
        truth = plant.sense(health)
        found = [truth.alpha_rad - design.alpha_trim_rad, truth.q_rad_s, truth.elevator_rad, truth.elevator_mean_rad]
        assert found == pytest.approx([*y[:3], y[3] / 0.01], abs=1e-13), tick
        assert (truth.effectiveness, truth.elevator_force) == (health.effectiveness, health.elevator_force)


def _noisy(design: ShortPeriod, stds: tuple[float, float], seed: int, ticks: int) -> np.ndarray:
    """(ticks + 1, 2): alpha and q, deviations from trim, with the elevator at trim."""
    plant, flown = LinearPlant(design, control_hz=100, process_noise=stds, seed=seed), [[0.0, 0.0]]
    for _ in range(ticks):
        plant.advance(design.elevator_trim_rad, HEALTHY, HEALTHY)
        truth = plant.sense()
        flown.append([truth.alpha_rad - design.alpha_trim_rad, truth.q_rad_s])
    return np.array(flown)


@pytest.mark.parametrize("stds", [(0.05, 0.0), (0.0, 0.4), (0.05, 0.4)])
def test_process_noise_has_the_covariance_of_the_sum(
    rng: np.random.Generator, design: ShortPeriod, stds: tuple[float, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    """P_n = sum of Phi^k G S G' Phi^k', G the integral of exp(A t) over a period; 1000 flights of 40 ticks, each with its own seed.

    Whitened by P, the sample covariance is that of unit normal pairs. Bounds that chance breaks once in 10,000 seeds, each.
    """
    runs, ticks = 1000, 40
    block = np.zeros((4, 4))
    block[:2, :2], block[:2, 2:] = design.A, np.eye(2)
    held = expm(block * 0.01)
    phi, G = held[:2, :2], held[:2, 2:]
    P = np.zeros((2, 2))
    for k in range(ticks):
        power = np.linalg.matrix_power(phi, k) @ G
        P += power @ np.diag(np.square(stds)) @ power.T
    # All plants share one matrix exponential (8 ms on a busy machine).
    known: dict[tuple[bytes, bytes, float], Discrete] = {}

    def once(A: np.ndarray, b: np.ndarray, period_s: float) -> Discrete:
        key = (A.tobytes(), b.tobytes(), period_s)
        if key not in known:
            known[key] = zero_order_hold(A, b, period_s)
        return known[key]

    monkeypatch.setattr(linear, "zero_order_hold", once)
    seeds = rng.integers(2**31, size=runs).tolist()
    x = np.array([_noisy(design, stds, seed, ticks)[-1] for seed in seeds])
    white = np.linalg.solve(np.linalg.cholesky(P), x.T)
    for row in white:
        assert chi2.ppf(0.5e-4, runs) < row @ row < chi2.ppf(1 - 0.5e-4, runs)
        assert abs(row.sum()) < norm.ppf(1 - 0.5e-4) * np.sqrt(runs)
    # A product of two unit normals has variance 1; the sum of 1000 is approximately normal.
    assert abs(white[0] @ white[1]) < norm.ppf(1 - 0.5e-4) * np.sqrt(runs)


def test_process_noise_is_white_repeatable_and_of_its_seed(design: ShortPeriod) -> None:
    """The noise is recovered from the motion, over more ticks than one block; each bound fails by chance for 1 seed in 10,000."""
    stds, ticks = (1e-4, 1e-3), 1300
    x = _noisy(design, stds, 7, ticks)
    assert np.array_equal(_noisy(design, stds, 7, ticks), x)
    assert np.all(_noisy(design, stds, 8, 1)[1] != x[1])
    assert np.abs(x).max() < 100.0  # small enough to resolve w, 1e-6 per period, in double precision
    block = np.zeros((4, 4))
    block[:2, :2], block[:2, 2:] = design.A, np.eye(2)
    held = expm(block * 0.01)
    w = np.linalg.solve(held[:2, 2:], x[1:].T - held[:2, :2] @ x[:-1].T) / np.array(stds)[:, None]
    for row in w:
        assert chi2.ppf(0.5e-4, ticks) < row @ row < chi2.ppf(1 - 0.5e-4, ticks)
        for lag in (1, 2, 1024):  # a repeated block would correlate fully
            assert abs(row[lag:] @ row[:-lag]) < norm.ppf(1 - 0.5e-4) * np.sqrt(ticks - lag)


def test_without_process_noise_the_seed_changes_no_bit(design: ShortPeriod) -> None:
    """The flight equals that of a plant without process noise bit for bit, and the smallest noise changes it."""

    def flown(**noise: Any) -> list[Truth]:
        plant, seen = LinearPlant(design, control_hz=100, airspeed_m_s=250.0, altitude_m=6000.0, **noise), []
        for k in range(100):
            health = HEALTHY if k < 50 else Health(0.4, 0.7)
            plant.advance(design.elevator_trim_rad + 0.02 * np.sin(0.1 * k), health, health)
            seen.append(plant.sense(health))
        return seen

    plain = flown()
    assert flown(process_noise=(0.0, 0.0), seed=np.random.SeedSequence(5)) == plain
    assert flown(process_noise=(0.0, 1e-12), seed=5) != plain


@pytest.mark.parametrize("absolute", [True, False])
def test_process_noise_adds_to_commands_failures_and_gusts(design: ShortPeriod, absolute: bool) -> None:
    """Superposition: the motion minus that without noise equals the motion by noise alone; differences are round-off."""

    def flown(*, moving: bool, stds: tuple[float, float]) -> np.ndarray:
        air: Gusts = (lambda t: 3.0 * np.cos(5.0 * t)) if moving else calm
        plant = LinearPlant(
            design, control_hz=100, absolute=absolute, airspeed_m_s=250.0, gusts=air, process_noise=stds, seed=3
        )
        seen = []
        for k in range(120):
            health = Health(0.3, 0.6) if moving and k >= 60 else HEALTHY
            truth = plant.sense(health)
            alpha = truth.alpha_rad - design.alpha_trim_rad - truth.gust_up_m_s / 250.0
            seen.append([alpha, truth.q_rad_s, truth.elevator_rad, truth.elevator_mean_rad])
            plant.advance(design.elevator_trim_rad + moving * 0.03 * np.sin(0.2 * k), health, health)
        return np.array(seen)

    stds = (0.02, 0.5)
    noise, quiet = flown(moving=False, stds=stds), flown(moving=True, stds=(0.0, 0.0))
    assert np.all(np.abs(noise[:, :2]).max(axis=0) > 1e-3)
    both = flown(moving=True, stds=stds)
    assert both[:, :2] - quiet[:, :2] == pytest.approx(noise[:, :2], abs=1e-12)
    assert np.array_equal(both[:, 2:], quiet[:, 2:])  # the noise does not act on the actuator


def test_a_gust_that_blows_from_the_start_is_felt_at_once(design: ShortPeriod) -> None:
    truth = LinearPlant(design, control_hz=100, airspeed_m_s=200.0, gusts=lambda t: 4.0 - t).sense()
    assert (truth.gust_up_m_s, truth.alpha_rad) == (4.0, design.alpha_trim_rad + 4.0 / 200.0)


def test_level_at_trim_it_flies_straight_on(design: ShortPeriod) -> None:
    """Theta equals the trim alpha and the flight path is level; quantities outside the short period are 0 or nan."""
    plant = LinearPlant(design, control_hz=100, airspeed_m_s=250.0, altitude_m=6000.0)
    for _ in range(200):
        plant.advance(design.elevator_trim_rad, HEALTHY, HEALTHY)
    truth = plant.sense()
    assert design.alpha_trim_rad > 0.01
    assert truth.theta_rad == design.alpha_trim_rad
    assert (truth.nz_g, truth.altitude_m) == (1.0, 6000.0)
    assert truth.north_m == pytest.approx(500.0, rel=1e-12)
    assert (truth.phi_rad, truth.psi_rad, truth.east_m) == (0.0, 0.0, 0.0)


def _kinematics(hz: int) -> tuple[list[Truth], np.ndarray, np.ndarray]:
    """Fly the thesis's aircraft for one second with commands that change at 25 Hz.

    Returns the truth at 25 Hz; the exact (alpha, q, elevator, theta, altitude, north) there, and nz; the largest |q''|,
    |gamma''| and |gamma'| on the way.
    """
    aircraft = load_linear_aircraft("sillence")
    design, V = aircraft.design, aircraft.airspeed_m_s
    plant = LinearPlant(design, control_hz=hz, airspeed_m_s=V, mach=0.9, altitude_m=6000.0)
    A3, b3 = design.with_actuator()

    def rates(_t: float, y: np.ndarray, command: float) -> list[float]:
        gamma = y[3] - y[0]
        return [*(A3 @ y[:3] + b3 * command), y[1], V * np.sin(gamma), V * np.cos(gamma)]

    y, flown, exact, largest = np.array([0.0, 0.0, 0.0, 0.0, 6000.0, 0.0]), [], [], np.zeros(3)
    for k in range(25):
        command = 4 * DEG * np.sin(0.25 * k + 0.5)
        for _ in range(hz // 25):
            plant.advance(command, HEALTHY, HEALTHY)
        flown.append(plant.sense())
        found = solve_ivp(rates, (0, 0.04), y, args=(command,), rtol=1e-12, atol=1e-13)
        for state in found.y.T:
            x_dot = A3 @ state[:3] + b3 * command
            second = A3 @ x_dot
            largest = np.maximum(largest, np.abs([second[1], x_dot[1] - second[0], state[1] - x_dot[0]]))
        y = found.y[:, -1]
        climb_rate = y[1] - (A3 @ y[:3] + b3 * command)[0]  # gamma'
        exact.append([*y, np.cos(y[3] - y[0]) + V * climb_rate / G0])
    return flown, np.array(exact), largest


def test_flight_path_against_integration() -> None:
    """alpha, q and elevator are exact. The others are of second order in dt, with these bounds over T = 1 s:

    theta, the trapezoidal rule on q: T dt^2 |q''| / 12. Altitude and north, V sin and V cos of the mean of gamma at both ends:
    the rule's T dt^2 (|gamma''| + gamma'^2) / 12, dt^2 gamma'^2 / 8 for the sine of a mean, and the error of theta.
    """
    flown, exact, (q_2, gamma_2, gamma_1) = _kinematics(100)
    found = np.array([[t.alpha_rad, t.q_rad_s, t.elevator_rad, t.theta_rad, t.altitude_m, t.north_m] for t in flown])
    error = np.abs(found - exact[:, :6]).max(axis=0)
    V, dt = load_linear_aircraft("sillence").airspeed_m_s, 0.01
    assert error[:3] == pytest.approx(0.0, abs=1e-11)
    assert 0.0 < error[3] < dt**2 * q_2 / 12
    assert error[4:].max() < V * dt**2 * (q_2 / 12 + (gamma_2 + gamma_1**2) / 12 + gamma_1**2 / 8)
    assert np.ptp(exact[:, 4]) > 5.0  # m: a considerable climb
    assert {t.mach for t in flown} == {0.9}
    assert {t.airspeed_m_s for t in flown} == {V}


def test_flight_path_converges_with_the_square_of_the_period_and_load_factor_with_the_period() -> None:
    """nz is cos(gamma) + V gamma' / g with the mean gamma' of the last period: half a period late, so of first order."""
    errors = []
    for hz in (100, 200, 400):
        flown, exact, _ = _kinematics(hz)
        found = np.array([[t.theta_rad, t.altitude_m, t.north_m, t.nz_g] for t in flown])
        errors.append(np.abs(found - exact[:, 3:]).max(axis=0))
    for coarse, fine in pairwise(errors):
        assert coarse / fine == pytest.approx([4.0, 4.0, 4.0, 2.0], rel=0.15)
    assert errors[0][3] < 0.1 * np.ptp(exact[:, 6])


def test_load_factor_is_the_mean_over_the_period() -> None:
    """Against the exact flight path at both ends of each period; the trapezoidal rule for theta adds at most V dt^2 |q''| / (12 g)."""
    aircraft = load_linear_aircraft("sillence")
    A, b = aircraft.design.with_actuator()
    V, dt = aircraft.airspeed_m_s, 0.01
    plant, y = LinearPlant(aircraft.design, control_hz=100, airspeed_m_s=V), np.zeros(4)
    assert plant.sense().nz_g == 1.0
    M = np.zeros((5, 5))
    M[:3, :3], M[3, 1], M[:3, 4] = A, 1.0, b
    held = expm(M * dt)
    found, mean, jerk, steepest = [], [], 0.0, 0.0
    for tick in range(120):
        command, gamma_before = -4 * DEG * (1 - np.cos(0.04 * tick)), y[3] - y[0]
        plant.advance(command, HEALTHY, HEALTHY)
        found.append(plant.sense().nz_g)
        y = (held @ [*y, command])[:4]
        mean.append(np.cos(y[3] - y[0]) + V / G0 * (y[3] - y[0] - gamma_before) / dt)
        jerk = max(jerk, abs(float(A[1] @ (A @ y[:3] + b * command))))
        steepest = max(steepest, y[3] - y[0])
    assert np.ptp(found) > 2.0
    # 20 % more for |q''| between ticks: the fastest mode is the actuator's, exp(20 x 0.01).
    tolerance = 1.2 * V / G0 * dt**2 / 12 * jerk
    assert np.abs(np.subtract(found, mean)).max() < tolerance
    assert 1.0 - np.cos(steepest) > 5 * tolerance  # the test would detect nz = 1 + V gamma'/g


def test_without_an_airspeed_there_is_attitude_but_no_flight_path(design: ShortPeriod) -> None:
    plant = LinearPlant(design, control_hz=100, altitude_m=6000.0)
    for _ in range(50):
        plant.advance(design.elevator_trim_rad - 0.02, HEALTHY, HEALTHY)
    truth = plant.sense()
    assert truth.theta_rad > design.alpha_trim_rad + 0.01
    assert np.isnan([truth.nz_g, truth.altitude_m, truth.north_m, truth.airspeed_m_s]).all()
