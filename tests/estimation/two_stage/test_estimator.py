"""The two-stage filter on the aircraft: model against JSBSim, kernel against the general filter, identification of losses in flight."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
import pytest

from flightbed.analysis.result import fly_plan
from flightbed.analysis.trace import Trace
from flightbed.avionics.lateral_kernels import local_model
from flightbed.avionics.onboard import OnBoard
from flightbed.core.errors import ScenarioError
from flightbed.core.units import DEG, FT
from flightbed.estimation.two_stage.change_test import BiasTest, BiasTestConfig, chi_square_threshold
from flightbed.estimation.two_stage.estimator import SurfacesConfig, _Filter
from flightbed.estimation.two_stage.filter import (
    ConstantForgetting,
    Forgetting,
    NoForgetting,
    TwoStageConfig,
    TwoStageFilter,
    VariableForgetting,
)
from flightbed.flight.assembly import assemble
from flightbed.flight.loop import fly
from flightbed.flight.parts import Flight
from flightbed.flight.plan import Plan, plan
from flightbed.plant.airframe import JsbsimAirframe
from flightbed.plant.base import Controls, Motion
from flightbed.scenario.reading import load_scenario

SURFACES = {"elevator": "two-stage", "aileron": "two-stage.aileron", "rudder": "two-stage.rudder"}


@pytest.fixture(scope="module")
def rolling() -> Plan:
    return plan(load_scenario("aileron-loss", ["failures=[]", "duration_s=6"]))


def test_the_model_is_the_equations_of_motion(rolling: Plan, rng: np.random.Generator) -> None:
    """One step of a thousandth of a second against JSBSim's derivatives, in banked, slipping, rolling flight."""
    assert rolling.schedule is not None
    assert rolling.lateral is not None
    airframe = JsbsimAirframe(rolling.aircraft, mach=0.8, altitude_m=20000 * FT)  # type: ignore[arg-type]
    schedule, tables, work, dt = rolling.schedule.packed(), rolling.lateral.tables.packed(), np.zeros((10, 9)), 1e-3
    throttle = rolling.trim.throttle_norm
    largest = np.zeros(5)
    for _ in range(40):
        alpha, theta, phi, beta = rng.uniform((-2.0, -5.0, -40.0, -1.5), (6.0, 5.0, 40.0, 1.5)) * DEG
        q, p, r = rng.uniform((-5.0, -20.0, -3.0), (5.0, 20.0, 3.0)) * DEG
        u = rng.uniform((-4.0, -5.0, -4.0), (4.0, 5.0, 4.0)) * DEG
        motion = Motion(airframe.airspeed_m_s, alpha, theta, q, airframe.altitude_m, beta, phi, p, r)
        rates = airframe.respond(motion, Controls(u[0], throttle, u[1], u[2])).rates
        local_model(
            schedule, tables, work, 1.0, dt, u[0], alpha, q, airframe.mach, airframe.altitude_m, theta, phi, beta, p, r
        )
        x = np.array([alpha, q, beta, p, r])
        predicted = (work[:5, :5] @ x + work[:5, 5:8] @ u + work[:5, 8] - x) / dt
        largest = np.maximum(largest, np.abs(predicted - [rates.alpha, rates.q, rates.beta, rates.p, rates.r]))
    # Of rates up to 0.1 rad/s and accelerations up to 3 rad/s^2; the residual is due to beta in the tables and half a step.
    assert np.all(largest < [4e-3, 2e-2, 3e-3, 3e-2, 1e-2]), largest


def test_the_model_at_trim_is_the_linear_one() -> None:
    """Beside the kink that the tables have at Mach 0.80."""
    rolling = plan(load_scenario("aileron-loss", ["condition.mach=0.75"]))
    assert rolling.schedule is not None
    assert rolling.lateral is not None
    point, work = rolling.trim, np.zeros((10, 9))
    local_model(
        rolling.schedule.packed(), rolling.lateral.tables.packed(), work, 1.0, 1e-5, point.elevator_rad,
        point.alpha_rad, 0.0, 0.75, 20000 * FT, point.theta_rad, 0.0, 0.0, 0.0, 0.0,
    )  # fmt: skip
    np.testing.assert_allclose((work[2:5, 2:5] - np.eye(3)) / 1e-5, rolling.lateral.A, rtol=1e-3, atol=5e-3)
    np.testing.assert_allclose(work[2:5, 6:8] / 1e-5, rolling.lateral.B, rtol=1e-3, atol=5e-3)


@pytest.mark.parametrize("forgetting", [NoForgetting(), ConstantForgetting(0.97), VariableForgetting(2e-5, 1.0)])
def test_the_kernel_is_the_filter_and_its_test(forgetting: Forgetting, rng: np.random.Generator) -> None:
    n, inputs, ticks = 5, 3, 200
    config = SurfacesConfig(forgetting=forgetting, test_window=4, false_alarm=1e-2, follow_disturbances=False)
    noise, b = rng.uniform(0.01, 0.02, n), 0.01 * rng.standard_normal((n, inputs))
    ours = _Filter(config, noise, b, 0.01)
    disturbed = np.array(config.disturbances) * 0.01
    first = rng.standard_normal(n)
    theirs = TwoStageFilter(
        TwoStageConfig(
            Q=np.diag(disturbed**2) + b @ b.T,
            R=np.diag(noise**2),
            Q_gamma=config.walk_std**2 * np.eye(inputs),
            state=first,
            state_covariance=np.diag(noise**2),
            gamma=np.zeros(inputs),
            gamma_covariance=config.prior_std**2 * np.eye(inputs),
            forgetting=forgetting,
        )
    )
    test = BiasTest(BiasTestConfig(4, (chi_square_threshold(4, 1e-2),) * inputs))
    ours.take(first, np.eye(n), np.zeros((n, inputs)), np.zeros(n), np.zeros(inputs), 0.0)
    test.update(theirs.estimate.gamma, theirs.estimate.gamma_covariance)
    x, raised = first, 0
    for k in range(ticks):
        A = np.eye(n) + 0.02 * rng.standard_normal((n, n))
        B, u, c = 0.1 * rng.standard_normal((n, inputs)), rng.standard_normal(inputs), 0.01 * rng.standard_normal(n)
        left = np.array([1.0, 1.0, 1.0 if k < 100 else 0.5])
        x = A @ x + B @ (left * u) + c
        y = x + noise * rng.standard_normal(n)
        estimates = ours.take(y, A, B, c, u, 0.1)
        found = theirs.step(A, B, np.eye(n), u, y, c)
        tested = test.update(found.gamma, found.gamma_covariance)
        np.testing.assert_allclose([e.effectiveness_raw for e in estimates], found.effectiveness, rtol=0, atol=1e-10)
        variances = np.diag(found.gamma_covariance)
        np.testing.assert_allclose([e.effectiveness_std**2 for e in estimates], variances, rtol=1e-8)
        assert estimates[0].alpha_rad == pytest.approx(found.state[0] + 0.1, abs=1e-10)
        assert estimates[0].nis == pytest.approx(found.nis, rel=1e-6, abs=1e-9)
        assert [bool(v) for v in ours._state.raised] == tested.raised.tolist()
        raised += int(tested.raised[2])
    assert raised > 50


def _flown(surface: str, to: float, seed: int, *more: str) -> Trace:
    failure = f'failures=[{{surface="{surface}", at_s=4.2, to={to}}}]'
    return fly_plan(plan(load_scenario("aileron-loss", [failure, "duration_s=5.5", f"seed={seed}", *more])))[0]


def _first_alarms(trace: Trace) -> dict[str, float]:
    found = {}
    for surface, name in SURFACES.items():
        raised = np.flatnonzero(np.diff(trace[f"{name}.alarms"], prepend=0.0) > 0.0)
        found[surface] = float(trace["t_s"][raised[0]]) if raised.size else np.inf
    return found


@pytest.mark.parametrize("surface", SURFACES)
@pytest.mark.parametrize("to", [0.2, 0.6])
def test_a_loss_is_found_on_its_surface_and_its_k_within_a_second(surface: str, to: float) -> None:
    for seed in range(2):
        trace = _flown(surface, to, seed)
        alarms = _first_alarms(trace)
        assert min(alarms, key=lambda s: alarms[s]) == surface, (seed, alarms)
        assert 4.2 < alarms[surface] < 4.5, (seed, alarms)
        at = np.searchsorted(trace["t_s"], 5.2)
        assert abs(trace[f"{SURFACES[surface]}.effectiveness"][at] - to) < 0.05, seed
        for other in set(SURFACES) - {surface}:
            assert abs(trace[f"{SURFACES[other]}.effectiveness"][at] - 1.0) < 0.08, (seed, other)


def test_two_losses_at_different_times_are_both_found() -> None:
    trace = fly_plan(plan(load_scenario("elevator-and-aileron", ["duration_s=11"])))[0]
    alarms = _first_alarms(trace)
    assert 5.0 < alarms["elevator"] < 5.2
    assert 9.0 < alarms["aileron"] < 9.3
    assert alarms["rudder"] > alarms["aileron"]  # the rudder's estimate also moves until the two are distinguished
    assert trace["two-stage.effectiveness"][-1] == pytest.approx(0.3, abs=0.03)
    assert trace["two-stage.aileron.effectiveness"][-1] == pytest.approx(0.5, abs=0.03)


def test_no_alarm_without_a_failure_in_calm_air() -> None:
    planned = plan(load_scenario("aileron-loss", ["failures=[]", "duration_s=8"]))
    for seed in range(4):
        trace, _ = fly_plan(dataclasses.replace(planned, scenario=planned.scenario.with_seed(seed)))
        assert [trace[f"{name}.alarms"][-1] for name in SURFACES.values()] == [0.0] * 3, seed


def test_the_elevator_alone_on_schedule_and_short_period() -> None:
    both = [
        'estimators.1={name="two", kind="two-stage", memory="variable", window=3}',
        'estimators.2={name="short", kind="two-stage", memory="variable", window=3, model="short-period"}',
        "duration_s=8",
    ]
    trace, metrics = fly_plan(plan(load_scenario("elevator-loss", both)))
    for name, error in (("two", 0.02), ("short", 0.1)):
        found = metrics.estimators[name]
        assert found.median_abs_error_post is not None
        assert found.median_abs_error_post < error
    assert metrics.estimators["two"].detected_at_s is not None
    assert metrics.estimators["two"].detected_at_s < 0.2
    assert 1.6 < float(np.mean(trace["two.nis"][1:450])) < 2.4


def _with(scenario: str, settings: Sequence[str]) -> Flight:
    return assemble(plan(load_scenario(scenario, settings)))


def test_three_surfaces_need_commands_to_them(rolling: Plan) -> None:
    flight = assemble(rolling)
    with pytest.raises(ValueError, match="needs a flight with lateral axes"):
        dataclasses.replace(flight, lateral=None)
    with pytest.raises(ValueError, match="not on board"):
        type(flight.estimators[0])(  # type: ignore[call-arg]
            SurfacesConfig(forgetting=NoForgetting()), OnBoard(rolling.design, flight_noise(), 100, rolling.schedule)
        )
    with pytest.raises(ScenarioError, match="lateral.enabled"):
        load_scenario("elevator-loss", ["failures.0.surface=aileron"])


def flight_noise() -> object:
    from flightbed.flight.assembly import sensor_noise

    return sensor_noise(load_scenario("elevator-loss"))


def test_corrected_surfaces_act_as_healthy_ones_do() -> None:
    """With K from the oracle the command of a weak aileron is multiplied by 1/K, and the aircraft rolls as the healthy one."""
    settings = ["adaptation.oracle=true", "estimators=[]", "duration_s=5.5"]
    healthy, lost = (
        list(fly(_with("aileron-loss", [f"failures=[{failure}]", *settings])))
        for failure in ("", '{surface="aileron", at_s=3, to=0.5}')
    )
    apart = [
        abs(a.lateral.truth.p_rad_s - b.lateral.truth.p_rad_s)
        for a, b in zip(healthy, lost, strict=True)
        if a.lateral is not None and b.lateral is not None
    ]
    assert len(apart) == 550
    assert max(apart[:300]) == 0.0
    assert 0.0 < max(apart) < 3.0 * DEG  # of 20 deg/s: the actuator runs at its rate limit more often
