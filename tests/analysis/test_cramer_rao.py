"""The Cramer-Rao bound against independently computed batch least-squares covariances."""

from __future__ import annotations

from decimal import Context, Decimal, localcontext

import control
import numpy as np
import pytest
from scipy.linalg import expm

from flightbed import load_scenario, run
from flightbed.analysis.cramer_rao import _bounds, bound, design_models, schedule_models
from flightbed.analysis.result import Result
from flightbed.avionics import pitch_kernels
from flightbed.avionics.short_period import ShortPeriod
from flightbed.core.units import DEG, FT
from flightbed.flight.assembly import sensor_noise
from flightbed.studies.methods.record import estimate_record


def test_against_the_covariance_of_batch_least_squares(rng: np.random.Generator) -> None:
    """Sensitivities are differences of simulated records; the covariance is numpy's pseudo-inverse."""
    T, r = 40, np.array([2.7e-7, 3.7e-6])
    models = np.zeros((T, 2, 4))
    for model in models:
        model[:, :2] = [[0.99, 0.0095], [0.02 + 0.01 * rng.standard_normal(), 0.99]]
        model[:, 2] = [5e-4, -0.14]
    u = 0.05 * rng.standard_normal(T) + 0.03

    def record(p: np.ndarray, first: int, last: int) -> np.ndarray:
        x, out = p[:2].copy(), [p[:2].copy()]
        for j in range(first + 1, last + 1):
            x = models[j, :, :2] @ x + models[j, :, 2] * u[j] * p[2] + models[j, :, 3]
            out.append(x.copy())
        return (np.array(out) / np.sqrt(r)).ravel()

    first = np.maximum(0, np.arange(T) - 20).astype(float)
    found = _bounds(models, u, first, np.sqrt(r))
    p = np.array([0.01, 0.02, 0.6])
    for k in (3, 10, 25, 39):
        H = np.column_stack(
            [(record(p + h, int(first[k]), k) - record(p - h, int(first[k]), k)) / 2 for h in np.eye(3)]
        )
        expected = np.sqrt(np.linalg.pinv(H.T @ H)[2, 2])
        assert abs(found[k] / expected - 1.0) < 1e-6, k
    assert np.isinf(found[0])


@pytest.mark.parametrize("seconds", [2, 16, 60])
def test_round_off_does_not_grow_with_the_stretch_of_an_unstable_aircraft(
    rng: np.random.Generator, seconds: int
) -> None:
    """Against the sum and its inverse in sufficient precision: the effect of the first state grows by up to e^60 here."""
    T, std = 100 * seconds, (5e-4, 2e-3)
    A, b, u = expm(0.01 * np.array([[-1.0, 1.0], [4.0, -1.0]])), (5e-4, -0.14), (0.1 * rng.standard_normal(T)).tolist()
    models = np.zeros((T, 2, 4))
    models[:, :, :2], models[:, :, 2] = A, b
    J = np.full((3, 3), Decimal(0))
    with localcontext(Context(prec=400)):
        step, S = (
            np.array([[Decimal(x) for x in row] for row in A.tolist()]),
            np.array([[Decimal(int(i == j)) for j in range(3)] for i in range(2)]),
        )
        for k in range(T):
            if k:
                S = step @ S
                S[:, 2] += np.array([Decimal(x) for x in b]) * Decimal(u[k])
            for i in range(2):
                J += np.outer(S[i], S[i]) / Decimal(std[i]) ** 2
        (c, d), (e, f) = J[0, :2], J[1, :2]
        spent = (J[2, 0] * (f * J[0, 2] - d * J[1, 2]) + J[2, 1] * (c * J[1, 2] - e * J[0, 2])) / (c * f - d * e)
        expected = float(1 / (J[2, 2] - spent).sqrt())
    assert _bounds(models, np.array(u), np.zeros(T), np.array(std))[-1] == pytest.approx(expected, rel=1e-9)


@pytest.fixture(scope="module")
def losing() -> Result:
    """The F-16 on its schedule, with an elevator loss at tick 450."""
    return run(load_scenario("elevator-loss", ["duration_s=6"]))


def test_models_on_the_schedule_are_its_tangents_along_the_true_motion(losing: Result) -> None:
    """Against scipy's matrix exponential of the rates at the start of the period, with the deflection and the K of that period.

    The model truncates the series of [A | b | c] dt after |A dt|^2 / 6; the remainder is |A dt|^3 / 24, and a twentieth of this for
    the higher orders, with |A dt| below 0.2.
    """
    trace, schedule = losing.trace, losing.plan.schedule
    assert schedule is not None
    models = schedule_models(trace, schedule, control_hz=100)
    packed, rates = schedule.packed(), np.zeros((2, 4))
    assert not models[0].any()  # no period ends at tick 0
    for k in (1, 200, 449, 450, 451, 452, 500, 599):
        K, u = trace["effectiveness_true"][k - 1], trace["elevator_mean_meas_deg"][k] * DEG
        alpha, q, theta, phi = (trace[c][k - 1] * DEG for c in ("alpha_deg", "q_deg_s", "theta_deg", "phi_deg"))
        pitch_kernels.rates(
            packed, rates, alpha, q, K * u, trace["mach"][k - 1], trace["altitude_ft"][k - 1] * FT, theta, phi
        )
        A, b = rates[:, 1:3], rates[:, 3]
        M = np.zeros((4, 4))
        M[:2, :2], M[:2, 2], M[:2, 3] = A, b, rates[:, 0] - A @ [alpha, q] - b * K * u
        moved, size = expm(M * 0.01)[:2], np.linalg.norm(A * 0.01, 2)
        assert size < 0.2
        left = np.linalg.norm(models[k] - moved, 2) / np.linalg.norm(M[:2] * 0.01, 2)
        assert left < 1.05 * size**3 / 24, k
    assert [trace["effectiveness_true"][k] for k in (449, 450)] == [1.0, 0.2]


def test_models_on_the_schedule_reproduce_the_motion(losing: Result) -> None:
    """x+ = A x + b K u + c holds where the aircraft agrees with its tables, far better than the model at trim.

    The median error of the pitch rate in a period is that of the schedule, 0.05 deg/s^2 (see test_schedule), that of alpha 0.02 deg/s.
    """
    trace, schedule = losing.trace, losing.plan.schedule
    assert schedule is not None
    x = np.column_stack([trace["alpha_deg"], trace["q_deg_s"]]) * DEG
    acting = trace["effectiveness_true"][:-1] * trace["elevator_mean_meas_deg"][1:] * DEG

    def errors(models: np.ndarray) -> np.ndarray:
        m = models[1:]
        predicted = np.einsum("kij,kj->ki", m[:, :, :2], x[:-1]) + m[:, :, 2] * acting[:, None] + m[:, :, 3]
        found: np.ndarray = np.median(np.abs(predicted - x[1:]), axis=0) / (0.01 * DEG)
        return found

    scheduled = errors(schedule_models(trace, schedule, control_hz=100))
    assert np.all(scheduled < [0.02, 0.05])
    assert np.all(errors(design_models(trace, losing.plan.design, control_hz=100)) > 5 * scheduled)


def test_the_bound_decreases_with_data_and_restarts_at_a_change(losing: Result) -> None:
    assert losing.plan.schedule is not None
    noise = sensor_noise(losing.plan.scenario)
    models = schedule_models(losing.trace, losing.plan.schedule, control_hz=100)
    everything = bound(losing.trace, models, noise)
    window = bound(losing.trace, models, noise, window=30)
    assert np.all(everything <= window * (1 + 1e-9))
    assert np.all(np.diff(everything[455:]) <= 1e-12)
    assert (
        np.isinf(everything[450]) or everything[450] < everything[451]
    )  # the sample at the change belongs to the old stretch
    assert everything[452] > 10 * everything[450]
    assert np.array_equal(losing.trace["effectiveness_bound"], window)


@pytest.mark.parametrize("window", [1, 30])
def test_a_window_holds_the_last_periods_since_the_change(losing: Result, window: int) -> None:
    """Against the covariance of a least-squares fit to the readings of that stretch alone, by a QR of its sensitivities."""
    trace, schedule, noise = losing.trace, losing.plan.schedule, sensor_noise(losing.plan.scenario)
    assert schedule is not None
    models = schedule_models(trace, schedule, control_hz=100)
    found = bound(trace, models, noise, window=window)
    u = trace["elevator_mean_meas_deg"] * DEG
    weights = 1.0 / np.array([noise.alpha_rad, noise.q_rad_s])
    for k in (40, 300, 449, 450, 451, 452, 470, 479, 480, 481, 599):
        first = max(0, k - window, 450 if k > 450 else 0)  # K from tick 450 on affects the reading at 451 first
        S, rows = np.eye(2, 3), []
        for j in range(first, k + 1):
            if j > first:
                S = models[j, :, :2] @ S
                S[:, 2] += models[j, :, 2] * u[j]
            rows.append(weights[:, None] * S)
        # The last diagonal element of the triangle is the part of K's column orthogonal to those of the state.
        left = abs(np.linalg.qr(np.vstack(rows), mode="r")[2, 2])
        assert found[k] == pytest.approx(1.0 / left, rel=1e-6), k


@pytest.fixture(scope="module")
def thesis() -> Result:
    """The thesis's aircraft in doublets without failure, under a fixed law."""
    return run(load_scenario("thesis-loss", ["failures=[]", "adaptation.enabled=false", "duration_s=6"]))


def test_models_of_a_linear_flight_are_the_discrete_matrices(thesis: Result) -> None:
    design = thesis.plan.design
    models = design_models(thesis.trace, design, control_hz=100)
    discrete = control.c2d(control.ss(design.A, design.b[:, None], np.eye(2), 0), 0.01)
    assert models.shape == (600, 2, 4)
    assert np.ptp(models, axis=0).max() == 0.0
    assert models[0, :, :3] == pytest.approx(np.column_stack([discrete.A, discrete.B]), abs=1e-14)
    assert not models[:, :, 3].any()  # the linear aircraft has no trim


def test_models_of_a_linear_flight_reproduce_its_motion(thesis: Result) -> None:
    """x+ = A x + b u along the true motion, u the mean over the period; the error by the variation of u is dt^3 |A b u'| / 12.

    The largest u' follows a step of the command: 1.1 times its mean over the period, because it decays with exp(-20 t); another tenth
    for the next order of A dt. With the mean of the previous period the error is larger.
    """
    trace, design, dt = thesis.trace, thesis.plan.design, 0.01
    models = design_models(trace, design, control_hz=100)[1:]
    x = np.column_stack([trace["alpha_deg"], trace["q_deg_s"]]) * DEG
    u = trace["elevator_mean_meas_deg"] * DEG
    free = np.einsum("kij,kj->ki", models[:, :, :2], x[:-1])
    rate = 1.2 * np.abs(np.diff(trace["elevator_deg"])).max() * DEG / dt
    bounds = dt**3 / 12 * np.abs(design.A @ design.b) * rate
    assert np.all(np.abs(free + models[:, :, 2] * u[1:, None] - x[1:]).max(axis=0) < bounds)
    assert np.all(np.abs(free + models[:, :, 2] * u[:-1, None] - x[1:]).max(axis=0) > 5 * bounds)


def test_the_affine_term_comes_from_the_trim_deflection(design: ShortPeriod, thesis: Result) -> None:
    """At trim, with full effectiveness, the model stays at rest."""
    (model, *_) = design_models(thesis.trace, design, control_hz=100)
    assert design.elevator_trim_rad != 0.0
    assert model[:, 2] * design.elevator_trim_rad + model[:, 3] == pytest.approx([0.0, 0.0], abs=1e-17)


def test_the_bound_equals_the_covariance_of_the_joint_filter_without_prior(thesis: Result) -> None:
    """All readings, no process noise, the same u: filter and bound use the same information.

    The filter starts from the first reading and its variances, and with a variance of K of 1e4. The bound is at most 1e-2 where they are
    compared, so this prior changes the variance by at most 1e-6 of its value; round-off is smaller.
    """
    trace, noise = thesis.trace, sensor_noise(thesis.plan.scenario)
    A, b = thesis.plan.design.discrete(100)
    R = np.diag([noise.alpha_rad**2, noise.q_rad_s**2])
    z = np.column_stack([trace["alpha_meas_deg"], trace["q_meas_deg_s"]]) * DEG
    found = bound(trace, design_models(trace, thesis.plan.design, control_hz=100), noise)
    P0 = np.zeros((3, 3))
    P0[:2, :2], P0[2, 2] = R, 1e4
    u = trace["elevator_mean_meas_deg"][1:] * DEG
    filtered = estimate_record(A, b, np.eye(2), Q=np.zeros((2, 2)), R=R, u=u, z=z[1:], x0=np.append(z[0], 1.0), P0=P0)
    sigma = np.sqrt(filtered.P[:, 2, 2])
    observable = sigma < 0.1
    assert observable.sum() > 500
    assert found[1:][observable] == pytest.approx(sigma[observable], rel=1e-6)
    assert sigma[-1] < 0.01 < sigma[observable].max()


@pytest.mark.parametrize("stretches", ["moving", "irregular", "one", "change"])
def test_a_bound_is_that_of_its_stretch_alone(stretches: str, rng: np.random.Generator) -> None:
    """Windows that overlap are computed together, also where K becomes observable late; each is equal to the last bit to its own."""
    for T in (1, 7, 60):
        models = np.tile([[0.99, 0.01, -0.002, 0.0], [0.02, 0.98, -0.1, 0.0]], (T, 1, 1)) + 1e-3 * rng.normal(
            size=(T, 2, 4)
        )
        u = 0.1 * rng.normal(size=T) * (rng.random(T) > 0.5) * (np.arange(T) > T // 3)
        k = np.arange(T)
        first = {
            "moving": np.maximum(0, k - 9), "irregular": np.maximum.accumulate(np.minimum(rng.integers(0, T, T), k)),
            "one": np.zeros(T), "change": np.maximum(np.maximum(0, k - 9), (k > T // 2) * (T // 2)),
        }[stretches].astype(float)  # fmt: skip
        std = np.array([5e-4, 2e-3])
        found = _bounds(models, u, first, std)
        alone = [
            _bounds(models[s : e + 1], u[s : e + 1], np.zeros(e + 1 - s), std)[-1]
            for e, s in enumerate(first.astype(int))
        ]
        assert found.tobytes() == np.array(alone).tobytes()
