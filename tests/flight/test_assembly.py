"""From scenario keys to flight parts: given gains, state feedback, estimator input u, process noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.stats import chi2

from flightbed import load_scenario, run
from flightbed.control.base import Gains
from flightbed.core.signals import Estimate, Measurement
from flightbed.core.units import DEG
from flightbed.flight.assembly import assemble
from flightbed.flight.loop import fly
from flightbed.flight.parts import Flight
from flightbed.flight.plan import law_of, plan

GIVEN = ["control.gains={alpha=0.3, q_s=0.8, elevator=-0.3, reference_s=-0.9}"]
SHORT = ["duration_s=6"]


@pytest.mark.parametrize(
    ("sets", "integral"),
    [
        ([], 0.0),
        (["control.law=proportional-integral"], 0.0),
        (["control.law=proportional-integral", "control.gains.integral=-2"], -2.0),
    ],
)
def test_the_law_uses_exactly_the_given_gains(sets: list[str], integral: float) -> None:
    planned = plan(load_scenario("thesis-loss", [*GIVEN, *sets]))
    assert planned.gains == Gains(0.3, 0.8, -0.3, -0.9, integral)
    flown = law_of(planned.scenario, planned.design)
    felt = Measurement(alpha_rad=0.02, q_rad_s=-0.05, elevator_rad=9.0, elevator_mean_rad=9.0)
    demands = [flown.demand(felt, q_ref_rad_s=0.1, elevator_rad=0.03, hold=False) for _ in range(3)]
    proportional = 0.3 * 0.02 + 0.8 * -0.05 - 0.3 * 0.03 - 0.9 * 0.1
    assert np.diff(demands) == pytest.approx([integral * 0.15 / 100] * 2)
    assert demands[0] - proportional == pytest.approx(0.0, abs=abs(integral) * 0.15 / 100 + 1e-15)


def test_given_gains_do_not_change_with_the_aircraft() -> None:
    assert plan(load_scenario("nominal", GIVEN)).gains == Gains(0.3, 0.8, -0.3, -0.9)
    assert plan(load_scenario("nominal")).gains != Gains(0.3, 0.8, -0.3, -0.9)


@pytest.mark.parametrize("feeder", ["", "window", "expanding"])
def test_the_law_uses_the_state_of_the_named_estimator(feeder: str) -> None:
    """The command is recomputed from the trace: gains on that estimator's alpha and q, then the 1/K correction of the whole demand."""
    result = run(load_scenario("thesis-loss", [*GIVEN, *SHORT, f"control.state_from={feeder}"]))
    t = result.trace
    fed = (f"{feeder}.alpha_deg", f"{feeder}.q_deg_s") if feeder else ("alpha_meas_deg", "q_meas_deg_s")
    alpha, q = (t[column] for column in fed)
    believed = np.maximum(t["window.effectiveness_smoothed"], 0.08)
    demand = 0.3 * alpha + 0.8 * q - 0.3 * believed * t["elevator_meas_deg"] - 0.9 * t["q_ref_deg_s"]
    assert t["elevator_cmd_deg"] == pytest.approx(demand / believed, abs=1e-9)
    other = {"": "window", "window": "expanding", "expanding": "window"}[feeder]
    assert np.abs(t[f"{other}.q_deg_s"] - q).max() > 0.01  # the two estimators differ, so that a mix-up would show


class _Says:
    """An estimator whose state differs from the readings and from the other estimator's."""

    def __init__(self, alpha_rad: float, q_rad_s: float) -> None:
        self.estimate = Estimate(1.0, 0.1, 1.0, 1.0, alpha_rad, q_rad_s, 2.0)

    def update(self, measurement: Measurement) -> Estimate:
        return self.estimate


def _flight() -> Flight:
    scenario = load_scenario("thesis-loss", [*GIVEN, "adaptation.enabled=false", "estimators=[]", "duration_s=5"])
    return replace(assemble(plan(scenario)), estimators=[_Says(0.01, -0.02), _Says(-0.03, 0.05)])


@pytest.mark.parametrize(("index", "fed"), [(0, (0.01, -0.02)), (1, (-0.03, 0.05))])
def test_only_alpha_and_q_are_replaced(index: int, fed: tuple[float, float]) -> None:
    """The deflection and the recorded measurements remain the readings."""
    plain, ours = (list(fly(replace(_flight(), state_from=i))) for i in (None, index))
    for sample in ours:
        expected = 0.3 * fed[0] + 0.8 * fed[1] - 0.3 * sample.measurement.elevator_rad - 0.9 * sample.q_ref_rad_s
        assert sample.elevator_cmd_rad == pytest.approx(expected, abs=1e-15)
    assert ours[0].measurement == plain[0].measurement
    assert ours[0].elevator_cmd_rad != plain[0].elevator_cmd_rad


def test_state_from_a_missing_estimator_is_an_error() -> None:
    with pytest.raises(ValueError, match="state_from: the flight has 2 estimates .got 2."):
        replace(_flight(), state_from=2)


@pytest.mark.parametrize("key", ["input_at", "prior.first_reading"])
def test_input_at_and_first_reading_change_the_estimate_in_flight(key: str) -> None:
    values = {"input_at": ("mean", "start", "end"), "prior.first_reading": ("left-out", "used")}[key]
    flown = {
        value: run(
            load_scenario("thesis-loss", [*SHORT, "adaptation.enabled=false", f"estimators.1.{key}={value}"])
        ).trace
        for value in values
    }
    assert len({t["expanding.effectiveness_raw"][:400].tobytes() for t in flown.values()}) == len(values)
    assert len({t["window.effectiveness_raw"].tobytes() for t in flown.values()}) == 1  # of the other estimator


def test_process_noise_reaches_the_plant_in_its_units_and_from_a_stream_of_its_own() -> None:
    """The noise is recovered from the motion, w = G^-1 (x+ - Phi x), G the integral of exp(A t); the bounds fail for one seed in 10,000."""
    still = ["control.gains={alpha=0, q_s=0, elevator=0, reference_s=0}", "adaptation.enabled=false", "estimators=[]"]
    still += ["command.kind=none", "duration_s=4", "failures=[]"]
    stds = ["process_noise.alpha_std_deg_s=0.05", "process_noise.q_std_deg_s2=0.8"]

    def flown(*sets: str) -> list[np.ndarray]:
        trace = run(load_scenario("thesis-loss", [*still, *sets])).trace
        return [np.column_stack([trace[f"alpha{m}_deg"], trace[f"q{m}_deg_s"]]) for m in ("", "_meas")]

    motion, readings = flown(*stds, "seed=5")
    calm, calm_readings = flown("seed=5")
    assert not calm.any()
    assert readings - motion == pytest.approx(calm_readings, abs=1e-12)  # the sensors' noise is unchanged
    block = np.zeros((4, 4))
    block[:2, :2], block[:2, 2:] = plan(load_scenario("thesis-loss")).design.A, np.eye(2)
    held = expm(block * 0.01)
    w = np.linalg.solve(held[:2, 2:], motion[1:].T - held[:2, :2] @ motion[:-1].T) / [[0.05], [0.8]]
    n = w.shape[1]
    assert n == 399
    for row in w:
        assert chi2.ppf(0.5e-4, n) < row @ row < chi2.ppf(1 - 0.5e-4, n)
    assert abs(w[0] @ w[1]) < 3.9 * np.sqrt(n)
    third = np.random.SeedSequence(5).spawn(3)[2]  # sensors, air, process; further consumers are appended
    assert w.T == pytest.approx(np.random.default_rng(third).standard_normal((n, 2)), abs=1e-6)
    assert not np.array_equal(flown(*stds, "seed=6")[0], motion)
    assert np.array_equal(flown(*stds, "seed=5")[0], motion)
    only_q = flown(stds[1], "seed=5")[0]
    assert only_q[1] * DEG == pytest.approx(held[:2, 3] * w[1, 0] * 0.8 * DEG, abs=1e-12)
