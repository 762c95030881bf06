"""Redesigned laws: gains against python-control, no step of the command, flights that a fixed law loses."""

from __future__ import annotations

from math import exp

import control
import numpy as np
import pytest

from flightbed.avionics.short_period import ShortPeriod
from flightbed.control.redesign import PitchWeights, Redesign, RedesignedPitch, pitch_lq
from flightbed.core.errors import ScenarioError
from flightbed.core.signals import Estimate, Measurement
from flightbed.core.units import DEG
from flightbed.runs.run import run
from flightbed.scenario.reading import load_scenario

WEIGHTS = PitchWeights(3.0 * DEG, 3.0 * DEG, 3.0 * DEG)
Q, R = np.diag([(3.0 * DEG) ** -2, (3.0 * DEG) ** -2, 0.0]), np.array([[(3.0 * DEG) ** -2]])


@pytest.mark.parametrize("K", [1.0, 0.5, 0.1])
def test_gains_are_those_of_python_control(design: ShortPeriod, K: float) -> None:
    A, b = design.with_actuator(K)
    sampled = control.c2d(control.ss(A, b[:, None], np.eye(3), 0), 0.01)
    F, _, _ = control.dlqr(sampled.A, sampled.B, Q, R)
    gains = pitch_lq(design, WEIGHTS, control_hz=100, effectiveness=K)
    np.testing.assert_allclose([-gains.alpha, -gains.q, -gains.elevator], F[0], rtol=1e-7)
    closed = control.ss(sampled.A - sampled.B @ F, sampled.B * gains.reference, [[0.0, 1.0, 0.0]], 0, 0.01)
    assert control.dcgain(closed) == pytest.approx(1.0)


def _estimate(smoothed: float, alarms: float) -> Estimate:
    return Estimate(smoothed, 0.01, smoothed, smoothed, 0.0, 0.0, 2.0, alarms)


def test_nothing_is_designed_before_an_alarm_and_small_changes_are_let_pass(design: ShortPeriod) -> None:
    law = RedesignedPitch(design, WEIGHTS, control_hz=100)
    redesign = Redesign((law, 0), None, floor=0.08)
    for estimate, K in (
        (_estimate(0.5, 0.0), 1.0),
        (_estimate(0.5, 1.0), 0.5),
        (_estimate(0.53, 1.0), 0.5),
        (_estimate(0.44, 1.0), 0.44),
        (_estimate(0.01, 2.0), 0.08),
    ):
        redesign.update([estimate])
        assert law.effectiveness == K
    assert law.gains == pitch_lq(design, WEIGHTS, control_hz=100, effectiveness=0.08)


def test_the_command_does_not_step(design: ShortPeriod) -> None:
    law = RedesignedPitch(design, WEIGHTS, control_hz=100)
    reading = Measurement(design.alpha_trim_rad + 0.02, 0.03, design.elevator_trim_rad - 0.01, design.elevator_trim_rad)

    def demand() -> float:
        return law.demand(reading, q_ref_rad_s=0.05, elevator_rad=reading.elevator_rad, hold=False)

    before = demand()
    law.redesign(0.3)
    after = [demand() for _ in range(200)]
    assert after[0] == pytest.approx(before, abs=1e-12)
    aim = after[-1]
    assert abs(aim - before) > 0.01
    shares = (np.array(after) - aim) / (before - aim)
    np.testing.assert_allclose(shares, [exp(-k * 0.01 / 0.2) for k in range(200)], atol=1e-3)


def test_an_aircraft_that_the_fixed_law_loses_is_kept() -> None:
    lost = run(load_scenario("elevator-redesign", ["adaptation.enabled=false"])).metrics
    kept = run(load_scenario("elevator-redesign")).metrics
    assert lost.departed
    assert not kept.departed


@pytest.mark.parametrize(
    ("override", "problem"),
    [
        ("control.law=proportional", "control.law: must be 'lq'"),
        ("adaptation.oracle=true", "adaptation.oracle: cannot be combined with method = 'redesign'"),
        (
            'estimators.0={name="two-stage", kind="loop-gain", alarm_threshold=0.0}',
            "adaptation.estimator: must raise alarms",
        ),
    ],
)
def test_an_impossible_redesign_is_refused(override: str, problem: str) -> None:
    with pytest.raises(ScenarioError) as raised:
        load_scenario("elevator-redesign", [override])
    assert any(problem in line for line in str(raised.value).splitlines()), raised.value
