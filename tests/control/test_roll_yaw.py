"""The regulator of roll and yaw: gains against python-control, DC gain, and effective feedback of a weak surface."""

from __future__ import annotations

import control
import numpy as np
import pytest

from flightbed.aircraft.overlay import Aircraft
from flightbed.avionics.lateral import LateralDirectional
from flightbed.avionics.short_period import zero_order_hold
from flightbed.control.correction import Adaptation
from flightbed.control.lq import spectral_radius
from flightbed.control.roll_yaw import RollYaw, RollYawWeights
from flightbed.core.errors import DesignError
from flightbed.core.signals import LateralMeasurement
from flightbed.core.units import DEG, FT
from flightbed.models.linearize import linearize
from flightbed.models.reduce import lateral_directional
from flightbed.models.trim import trim
from flightbed.plant.airframe import JsbsimAirframe

HZ = 100
WEIGHTS = RollYawWeights(2 * DEG, 20 * DEG, 10 * DEG, 10 * DEG, 10 * DEG)


@pytest.fixture(scope="module")
def turning(f16: Aircraft) -> LateralDirectional:
    airframe = JsbsimAirframe(f16, mach=0.8, altitude_m=20000 * FT)
    return lateral_directional(linearize(airframe, trim(airframe)), airframe, actuators_rad_s=(20.2, 20.2))


@pytest.fixture(scope="module")
def law(turning: LateralDirectional) -> RollYaw:
    return RollYaw(turning, WEIGHTS, control_hz=HZ)


def test_the_gain_is_that_of_python_control(turning: LateralDirectional, law: RollYaw) -> None:
    A, B = zero_order_hold(*turning.with_actuators(), 1.0 / HZ)
    w = WEIGHTS
    Q = np.diag([w.beta_rad**-2, w.p_rad_s**-2, w.r_rad_s**-2, 0.0, 0.0])
    R = np.diag([w.aileron_rad**-2, w.rudder_rad**-2])
    F, _, poles = control.dlqr(A, B, Q, R)
    np.testing.assert_allclose(law.F, F, rtol=1e-6, atol=1e-9)
    found = np.sort_complex(np.linalg.eigvals(law.closed_loop))
    np.testing.assert_allclose(found, np.sort_complex(np.asarray(poles)), rtol=1e-6, atol=1e-9)
    assert spectral_radius(law.closed_loop) < 1.0 < spectral_radius(A) + 0.01


def test_the_dc_gain_is_one_on_the_design_model(turning: LateralDirectional, law: RollYaw) -> None:
    """A thousand ticks of the loop as it flies, u = N r - F x: p and beta go to their references, each alone."""
    A, B = zero_order_hold(*turning.with_actuators(), 1.0 / HZ)
    for p_ref, beta_ref in ((0.3, 0.0), (0.0, 0.04), (-0.2, 0.02)):
        x = np.zeros(5)
        for _ in range(1000):
            reading = LateralMeasurement(*x[:3], x[3], x[4], x[3], x[4])
            u = law.demand(reading, p_ref_rad_s=p_ref, beta_ref_rad=beta_ref, aileron_rad=x[3], rudder_rad=x[4])
            x = A @ x + B @ np.array(u)
        assert x[1] == pytest.approx(p_ref, abs=1e-6)
        assert x[0] == pytest.approx(beta_ref, abs=1e-6)


@pytest.mark.parametrize("shares", [(1.0, 1.0), (0.4, 1.0), (1.0, 0.25), (0.3, 0.5)])
def test_effective_feedback_makes_the_loop_healthy_at_any_effectiveness(
    turning: LateralDirectional, law: RollYaw, shares: tuple[float, float]
) -> None:
    """With K known, K times position and the state move as those of the whole aircraft, exactly."""

    def flown(left: tuple[float, float]) -> np.ndarray:
        B = turning.B * left
        lag = np.diag(turning.actuators_rad_s)
        A5 = np.block([[turning.A, B], [np.zeros((2, 3)), -lag]])
        A, G = zero_order_hold(A5, np.vstack([np.zeros((3, 2)), lag]), 1.0 / HZ)
        corrections = [
            Adaptation(enabled=True, estimator=0, floor=0.08, feedback="effective", min_rad=-9.0, max_rad=9.0)
            for _ in left
        ]
        x, rows = np.array([0.02, 0.1, -0.05, 0.0, 0.0]), []
        for k in range(300):
            rows.append(np.concatenate([x[:3], x[3:] * left]))
            effectiveness = [c.effectiveness_used(share) for c, share in zip(corrections, left, strict=True)]
            fed = [c.position_feedback(p, K) for c, p, K in zip(corrections, x[3:], effectiveness, strict=True)]
            demand = law.demand(
                LateralMeasurement(*x[:3], *x[3:], *x[3:]),
                p_ref_rad_s=0.2 if k < 150 else -0.2,
                beta_ref_rad=0.03,
                aileron_rad=fed[0],
                rudder_rad=fed[1],
            )
            u = [c.command(d, K) for c, d, K in zip(corrections, demand, effectiveness, strict=True)]
            x = A @ x + G @ np.array(u)
        return np.array(rows)

    np.testing.assert_allclose(flown(shares), flown((1.0, 1.0)), rtol=1e-9, atol=1e-12)


def test_surfaces_that_do_not_do_different_things_are_refused(turning: LateralDirectional) -> None:
    same = np.column_stack([turning.B[:, 0], turning.B[:, 0]])
    model = LateralDirectional(
        turning.A, same, turning.gravity, turning.alpha_trim_rad, turning.actuators_rad_s, turning.tables
    )
    with pytest.raises(DesignError, match="do not control roll rate and sideslip independently"):
        RollYaw(model, WEIGHTS, control_hz=HZ)
