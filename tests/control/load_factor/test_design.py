"""Laws of load factor: designs against eigenvalues and scipy, the velocity form against the plain one, PLID in the loop of a known plant."""

from __future__ import annotations

from dataclasses import replace
from math import cos

import control
import numpy as np
import pytest
from scipy.signal import cont2discrete, dimpulse

from flightbed.avionics.pitch_points import PitchPoint, dynamic_pressure_pa
from flightbed.control.load_factor.adaptive import (
    FIRST_GAINS,
    SIGNS,
    THESIS_PRIOR,
    IdentificationSettings,
    NzAdaptive,
    NzAdaptiveConfig,
    NzAdaptiveSettings,
    rest_state,
)
from flightbed.control.load_factor.autothrottle import Autothrottle
from flightbed.control.load_factor.design import (
    POLES,
    GainTable,
    LoadFactorDesign,
    closed_loop_poles,
    design_gains,
    gain_table,
    increment_g,
    second_order,
)
from flightbed.control.load_factor.integral_placement import AckermannConfig, IntegralPlacement
from flightbed.control.load_factor.scheduled import NzScheduled
from flightbed.core.atmosphere import standard_air
from flightbed.core.errors import DesignError
from flightbed.core.signals import Measurement
from flightbed.core.units import DEG
from flightbed.estimation.plid.factored import FACTORED
from flightbed.estimation.plid.identify import PlidConfig, Tracking

POINT = PitchPoint(
    14000.0, np.array([[-1.0, 0.906], [0.63, -1.04]]), np.array([0.051, -9.14]), np.array([15.2, 1.44]), -0.79
)
STOPS = (-25.0 * DEG, 25.0 * DEG)
LEVEL = Measurement(0.035, 0.0, -0.013, -0.013, 0.45, 0.0, 0.035, 0.0, cos(0.035))


def _table(*gains: float) -> GainTable:
    return GainTable(np.array([1000.0, 30000.0]), np.array([gains, gains]))


def test_the_loop_has_its_poles_follows_and_answers_with_the_slow_pair() -> None:
    alpha, q, error, integral = design_gains(POINT)
    # x = (alpha, q, z), z' = r - c x - d u, u = alpha a + q q + error (r - c x) + integral z; the error's own d is left out, as in the law's design
    k = np.array([alpha, q, 0.0]) + np.append(-error * POINT.c, integral)
    A = np.zeros((3, 3))
    A[:2, :2], A[2, :2] = POINT.A, -POINT.c
    b = np.append(POINT.b, -POINT.d)
    loop = A + np.outer(b, k)
    assert np.sort_complex(np.linalg.eigvals(loop)) == pytest.approx(np.sort_complex(np.array(POLES)), abs=1e-9)
    r = np.append(error * POINT.b, 1.0 - POINT.d * error)
    rest = np.linalg.solve(loop, -r)
    u = k @ rest + error
    assert POINT.c @ rest[:2] + POINT.d * u == pytest.approx(1.0, abs=1e-9)
    assert integral / error == pytest.approx(10.0)  # the zero of the reference
    # The design neglects the elevator's lift in the error feedback; with it the poles differ.
    assert np.linalg.eigvals(loop - error * POINT.d * np.outer(b, k))[0] != pytest.approx(POLES[0])


def test_the_poles_with_actuator_and_all_that_is_fed_back_are_those_of_the_loop_put_together() -> None:
    """python-control puts the parts together: actuator, aircraft with the elevator's lift in a_n, the error and its integral."""
    gains = alpha, q, error, integral = design_gains(POINT)
    aircraft = control.ss(
        POINT.A, POINT.b[:, None], np.vstack([np.eye(2), POINT.c]), np.array([[0.0], [0.0], [POINT.d]]),
        inputs="delta", outputs=["alpha", "q", "a_n"], name="aircraft",
    )  # fmt: skip
    actuator = control.tf(20.2, [1.0, 20.2], inputs="u", outputs="delta", name="actuator")
    summed = control.tf(-1.0, [1.0, 0.0], inputs="a_n", outputs="z", name="summed")  # of r - a_n, with r = 0
    inputs = ["alpha", "q", "a_n", "z", "r"]
    law = control.ss([], [], [], [[alpha, q, -error, integral, error]], inputs=inputs, outputs="u", name="law")
    loop = control.interconnect([aircraft, actuator, summed, law], inputs=["r"], outputs=["a_n"])
    found = np.sort_complex(closed_loop_poles(POINT, gains, actuator_rad_s=20.2))
    assert found == pytest.approx(np.sort_complex(loop.poles()), abs=1e-8)
    assert found.real.max() < -3.0


def test_an_impossible_design_is_an_error() -> None:
    with pytest.raises(DesignError, match="14000 Pa.*does not control"):
        design_gains(replace(POINT, b=np.zeros(2), d=0.0))
    with pytest.raises(DesignError, match="3 states, 2 poles"):
        design_gains(POINT, POLES[:2])


def test_gains_are_linear_between_the_points_and_held_beyond(rng: np.random.Generator) -> None:
    nodes, gains = np.array([1.0, 3.0, 4.0]), rng.standard_normal((3, 4))
    table = GainTable(nodes, gains)
    for at in (0.0, 1.0, 1.7, 3.0, 3.9, 4.0, 9.0):
        assert table.at(at) == pytest.approx([np.interp(at, nodes, column) for column in gains.T])


def test_readings_become_increment_and_dynamic_pressure() -> None:
    banked = LEVEL._replace(theta_rad=0.3, phi_rad=0.2, nz_g=2.5)
    assert increment_g(banked) == pytest.approx(2.5 - cos(0.3) * cos(0.2))
    assert dynamic_pressure_pa(LEVEL) == pytest.approx(
        0.5 * 1.225 * (0.45 * standard_air(0.0).sound_m_s) ** 2, rel=1e-4
    )


def test_the_prior_is_the_best_second_order_answer_to_an_impulse() -> None:
    G, lag, hz = 1.46, 20.2, 100
    a_0, a_1, b_0, b_1 = second_order(POINT, pitch_rate_gain=G, actuator_rad_s=lag, hz=hz)
    A, b = np.zeros((3, 3)), np.array([[0.0], [0.0], [lag]])
    A[:2, :2], A[1, 2], A[2, 2] = POINT.A, POINT.b[1], -lag
    c = np.append(-POINT.c, 0.0)[None, :]
    held, into, *_ = cont2discrete((A, b, c, np.zeros((1, 1))), 1.0 / hz)
    closed = held + into @ np.array([[0.0, G, 0.0]])
    _, (y,) = dimpulse((closed, into, c, np.zeros((1, 1)), 1.0 / hz), n=10 * hz + 1)
    y = y[:, 0]

    def cost(a_0: float, a_1: float, b_0: float) -> float:
        left = y[2:] - a_1 * y[1:-1] - a_0 * y[:-2]
        left[0] -= b_0
        return float(left @ left)

    assert b_1 == 0.0
    best = cost(a_0, a_1, b_0)
    for step in ((1e-5, 0.0, 0.0), (0.0, 1e-5, 0.0), (0.0, 0.0, 1e-5)):
        for sign in (1.0, -1.0):
            assert cost(a_0 + sign * step[0], a_1 + sign * step[1], b_0 + sign * step[2]) > best


def test_with_constant_gains_the_velocity_form_is_the_plain_one(rng: np.random.Generator) -> None:
    alpha, q, error, integral = 5.6, 1.46, -0.144, -1.44
    law = NzScheduled(
        _table(alpha, q, error, integral), control_hz=100, elevator_trim_rad=-0.013, stops_rad=(-9.0, 9.0)
    )
    z, first = 0.0, 0.0
    for k in range(50):
        m = LEVEL._replace(
            alpha_rad=0.035 + 0.01 * rng.standard_normal(), q_rad_s=0.02 * rng.standard_normal(), nz_g=1.1
        )
        r = 1.0 if k > 10 else 0.0
        found = law.demand(m, increment_ref_g=r, hold=False)
        missed = r - increment_g(m)
        z += missed / 100
        plain = alpha * m.alpha_rad + q * m.q_rad_s + error * missed
        first = plain if k == 0 else first
        assert found == pytest.approx(-0.013 + plain - first + integral * z, abs=1e-12)
    assert all(np.isnan(law.model))


def test_the_scheduled_law_stays_between_the_stops_and_holds_its_integral() -> None:
    law = NzScheduled(_table(0.0, 0.0, 0.0, -1.0), control_hz=100, elevator_trim_rad=0.0, stops_rad=STOPS)
    for _ in range(100):
        assert law.demand(LEVEL, increment_ref_g=9.0, hold=False) >= STOPS[0]
    assert law.demand(LEVEL, increment_ref_g=0.1, hold=False) == pytest.approx(STOPS[0], abs=1e-12)
    assert law.demand(LEVEL, increment_ref_g=-1.0, hold=False) == pytest.approx(STOPS[0] + 0.01)  # leaves at once
    before = law.demand(LEVEL, increment_ref_g=-1.0, hold=True)
    assert law.demand(LEVEL, increment_ref_g=-1.0, hold=True) == before


def _adaptive(**changed: object) -> NzAdaptive:
    settings = {"kept": 0.0, "filtered": 0.0} | changed
    tracking = Tracking(block_fade=1.001)
    plid = PlidConfig(2, process_var=1e-12, output_var=0.0, prior=rest_state(THESIS_PRIOR, 0.0), tracking=tracking)
    poles = tuple(complex(np.exp(p / 100)) for p in POLES)
    placed = AckermannConfig(poles, FIRST_GAINS, SIGNS, kept=float(settings["kept"]))  # type: ignore[arg-type]
    config = NzAdaptiveConfig(plid, FACTORED, placed, float(settings["filtered"]))  # type: ignore[arg-type]
    return NzAdaptive(config, _table(0.0, 1.5, 0.0, 0.0), control_hz=100, elevator_trim_rad=0.0, stops_rad=STOPS)


@pytest.mark.parametrize("changed", [{}, {"kept": 0.95}, {"filtered": 60.0}])
def test_a_plant_of_second_order_is_learned_and_followed(changed: dict[str, float], rng: np.random.Generator) -> None:
    a_0, a_1, b_0, b_1 = -0.87, 1.868, 0.015, 0.005  # y = -a_n, down positive
    law, y, u = _adaptive(**changed), [0.0, 0.0], [0.0, 0.0]
    errors = []
    for k in range(3000):
        r = 1.0 if (k // 200) % 2 else 0.0
        q = 0.05 * rng.standard_normal()  # the inner loop's share is not the plant's input
        found = law.demand(LEVEL._replace(nz_g=cos(0.035) - y[-1], q_rad_s=q), increment_ref_g=r, hold=False)
        u.append(found - 1.5 * q)
        y.append(a_1 * y[-1] + a_0 * y[-2] + b_1 * u[-1] + b_0 * u[-2])
        errors.append(abs(-y[-1] - r) if k % 200 > 180 else 0.0)
    assert law.model == pytest.approx((a_0, a_1, b_0, b_1), abs=2e-3)
    assert max(errors[2000:]) < 2e-3
    gains = law._placement.gains
    assert gains[2] < 0.0 < min(gains[:2])


@pytest.mark.parametrize("changed", [{}, {"filtered": 20.0}])
def test_the_adaptive_law_leaves_the_inner_loop_its_part_of_the_elevator(changed: dict[str, float]) -> None:
    law = _adaptive(**changed)
    for k in range(200):
        m = LEVEL._replace(q_rad_s=0.25 * (-1) ** (k // 7), nz_g=cos(0.035) + 0.3 * np.sin(k))
        demand = law.demand(m, increment_ref_g=40.0 * (-1) ** (k // 90), hold=False)
        assert STOPS[0] - 1e-12 <= demand <= STOPS[1] + 1e-12
        if k == 89 and not changed:  # a filter needs its time
            assert demand == pytest.approx(STOPS[0])


def test_gains_that_are_kept_change_by_their_share_but_for_the_first() -> None:
    poles = tuple(complex(np.exp(p / 100)) for p in POLES)
    one, other = np.array([-0.87, 1.868, 0.015, 0.005]), np.array([-0.80, 1.79, 0.02, 0.005])
    at_once, slow = (IntegralPlacement(AckermannConfig(poles, FIRST_GAINS, kept=kept)) for kept in (0.0, 0.9))
    assert at_once.design(one)
    assert slow.design(one)
    assert slow.gains == pytest.approx(at_once.gains)
    first = slow.gains
    assert at_once.design(other)
    assert slow.design(other)
    assert slow.gains == pytest.approx(0.9 * first + 0.1 * at_once.gains)
    with pytest.raises(ValueError, match="kept"):
        AckermannConfig(poles, FIRST_GAINS, kept=1.0)


def test_single_precision_flies_the_same_model() -> None:
    points = (replace(POINT, dynamic_pressure_pa=9000.0), POINT)
    design = LoadFactorDesign(points, POINT, 20.2, STOPS, -0.013)
    identified = [IdentificationSettings(precision="double"), IdentificationSettings(precision="single")]
    laws = [NzAdaptiveSettings(identification=settings).build(design, 100) for settings in identified]
    m = LEVEL._replace(nz_g=cos(0.035) + 0.2, q_rad_s=0.01)
    demands = [[law.demand(m, increment_ref_g=0.0, hold=False) for _ in range(20)] for law in laws]
    assert demands[0] != demands[1]
    assert demands[0] == pytest.approx(demands[1], abs=1e-4)
    assert gain_table(points).gains.shape == (2, 4)
    pushed = replace(POINT, dynamic_pressure_pa=1000.0, level=False)
    assert gain_table((pushed, *points)).at(1000.0) == gain_table(points).at(9000.0)


def test_the_autothrottle_goes_by_airspeed_and_time() -> None:
    sound = standard_air(0.0).sound_m_s
    auto = Autothrottle(0.1, 0.9, airspeed_m_s=0.45 * sound, then_m_s=0.6 * sound, from_tick=100)
    slow, fast = LEVEL._replace(mach=0.449), LEVEL._replace(mach=0.451)
    assert [auto.throttle(slow, 0), auto.throttle(fast, 0), auto.throttle(fast, 100)] == [0.9, 0.1, 0.9]
