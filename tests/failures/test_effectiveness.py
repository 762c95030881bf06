"""A small version of tools/tables/effectiveness.py against the results of a prototype (docs/effectiveness.md has the full one)."""

from __future__ import annotations

import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flightbed import load_scenario, run

PATH = Path(__file__).resolve().parents[2] / "tools" / "tables" / "effectiveness.py"


@pytest.fixture(scope="module")
def study() -> Any:
    spec = spec_from_file_location("effectiveness_study", PATH)
    assert spec
    assert spec.loader
    module = module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def _fly_all(study: Any) -> Any:
    return lambda jobs: [study.fly(job) for job in jobs]


# Prototype: median error, RMS of the smoothed estimate, tracking (None: unknown), in the order of the study's rows.
PROTOTYPE = ((0.004, 0.011, 1.93), (0.002, 0.010, 2.61), (0.004, 0.013, 1.82), (0.005, 0.016, 2.32), (0.014, 0.043, None),
             (None, 0.011, None), (0.020, 0.03, None))  # fmt: skip


def test_conditions_are_as_good_as_the_prototype(study: Any) -> None:
    """4 seeds; the tolerance includes the prototype's rounding, half a unit of its last digit."""
    for (name, base), (error, smoothed, _) in zip(study.CONDITIONS, PROTOTYPE, strict=True):
        flights = [study.fly({**base, "seed": seed}) for seed in range(4)]
        assert not any(f.metrics.departed for f in flights), name
        found = [f.metrics.estimators["scheduled"] for f in flights]
        if error is not None:
            assert np.median([f.median_abs_error_post for f in found]) <= error + 0.0005, name
        assert np.median([f.rms_error_smoothed_post for f in found]) <= smoothed, name
        assert all(f.detected_at_s < 0.35 for f in found), name
        assert 0.5 < np.median([f.nees_mean_post for f in found]) < 2.0, name


def test_every_rival_estimates_on_the_same_flight_and_the_order_is_the_papers(study: Any) -> None:
    flight = study.fly(study.job(to=0.4, rivals=tuple(study.RIVALS)))
    smoothed = {name: m.rms_error_smoothed_post for name, m in flight.metrics.estimators.items()}
    assert smoothed["scheduled"] < smoothed["baseline"] < smoothed["absolute"] < smoothed["thesis"]
    assert 0.3 < flight.metrics.estimators["scheduled"].efficiency < 3.0


def test_random_failures_cost_little_more_than_the_oracle(study: Any, capsys: pytest.CaptureFixture[str]) -> None:
    """12 random failures; the full study flies 200."""
    regrets, needless = study.regret(_fly_all(study), 12)
    assert needless == 0
    assert np.median(regrets) < 0.03
    assert "12 random failures" in capsys.readouterr().out


def test_no_false_alarm_in_moderate_turbulence(study: Any) -> None:
    """2.2 min; the full study flies more than an hour."""
    flights = [
        study.fly(study.job(to=None, seed=seed, set=("atmosphere.turbulence=moderate",))) for seed in range(100, 108)
    ]
    assert sum(f.metrics.estimators["scheduled"].false_alarms for f in flights) == 0


@pytest.mark.parametrize(
    "name",
    ["ramp-loss", "two-step-loss", "recovery", "level-loss", "transonic-loss", "turbulent-loss", "climbing-loss", "aft-cg-loss", "marginal-authority"],
)  # fmt: skip
def test_shipped_losses_are_flown_to_their_end(name: str) -> None:
    result = run(load_scenario(name))
    assert not result.metrics.departed
    found, truth = result.trace["scheduled.effectiveness_smoothed"], result.trace["effectiveness_true"]
    settled = result.trace["t_s"] > 12.0
    assert np.sqrt(np.mean((found - truth)[settled] ** 2)) < 0.05


@pytest.mark.parametrize(
    ("name", "error", "tracking"), [("structural-damage", 0.004, 2.1), ("elevator-and-cg", 0.052, 3.6)]
)
def test_unmodelled_damage_is_survived_and_the_fixed_law_departs(name: str, error: float, tracking: float) -> None:
    """Two seeds of the twenty of docs/effectiveness.md, with their 95th percentiles and a tenth."""
    for seed in range(2):
        metrics = run(load_scenario(name, [f"seed={seed}"])).metrics
        assert not metrics.departed
        assert metrics.estimators["scheduled"].median_abs_error_post <= error
        assert metrics.tracking_rms_post_deg_s <= tracking
    assert run(load_scenario(name, ["adaptation.enabled=false"])).metrics.departed


def test_a_shifted_cg_biases_the_estimate_beyond_its_sigma(study: Any) -> None:
    """Row of the study: the error of the estimate is many sigma when the model has only K as unknown."""
    rows = dict(study.DAMAGE)
    found = study.fly(rows["K 0.2, c.g. +3%"]).metrics.estimators["scheduled"]
    plain = study.fly(rows["moment 0.2, force 0.2"]).metrics.estimators["scheduled"]
    assert found.median_abs_error_post > 10.0 * plain.median_abs_error_post
    assert found.nees_mean_post > 20.0 > 2.0 > plain.nees_mean_post


def test_the_scenarios_have_their_purpose() -> None:
    assert run(
        load_scenario("marginal-authority", ["adaptation.limit_command=false", "failures.0.to=0.08"])
    ).metrics.departed
    assert not run(load_scenario("marginal-authority", ["failures.0.to=0.08"])).metrics.departed
    assert run(load_scenario("level-loss", ["adaptation.enabled=false"])).metrics.departed
    assert run(load_scenario("aft-cg-loss", ["duration_s=5"])).plan.design.A[1, 0] == pytest.approx(3.5, abs=0.05)
    climbing = run(load_scenario("climbing-loss", ["duration_s=5"]))
    assert climbing.plan.trim.gamma_rad == pytest.approx(0.0873, abs=1e-3)
    ramp = run(load_scenario("ramp-loss")).trace["effectiveness_true"]
    assert ramp[[449, 450, 649, 849, -1]] == pytest.approx([1.0, 1 - 0.7 / 400, 0.65, 0.3, 0.3])


def test_the_oracle_and_the_errors_of_the_model_do_what_they_say() -> None:
    oracle = run(load_scenario("elevator-loss", ["adaptation.oracle=true", "failures.0.at_s=4.0"]))
    blind = run(load_scenario("elevator-loss", ["adaptation.oracle=true", "failures.0.at_s=4.0", "estimators=[]"]))
    assert np.array_equal(oracle.trace["q_deg_s"], blind.trace["q_deg_s"])  # no estimate is used
    biased = run(load_scenario("elevator-loss", ["model_error.cm_delta=1.1", "failures.0.to=0.5"]))
    late = biased.trace["scheduled.effectiveness"][600:]
    assert np.median(late) == pytest.approx(0.5 / 1.1, abs=0.01)  # only the product K b is observable
    heavy = run(load_scenario("nominal", ["model_error.fuel_lbs=-2000", "duration_s=3"]))
    normal = run(load_scenario("nominal", ["duration_s=3"]))
    assert heavy.trace["nz_g"][0] == pytest.approx(20630 / 18630 * normal.trace["nz_g"][0], rel=0.02)
    late_command = run(load_scenario("nominal", ["rates.delay_ticks=3", "duration_s=3"])).trace
    moved = [np.flatnonzero(np.abs(np.diff(t["elevator_deg"])) > 1e-9)[0] for t in (normal.trace, late_command)]
    assert moved[1] - moved[0] == 3


def test_gusts_have_the_same_sense_in_every_flight() -> None:
    """The air ahead of the nose comes first: a gust that lowers alpha turns the air past the aircraft nose down."""
    from flightbed.core.signals import HEALTHY
    from flightbed.flight.assembly import assemble
    from flightbed.flight.plan import plan
    from flightbed.plant.nonlinear import JsbsimPlant

    for seed in range(3):
        plant = assemble(plan(load_scenario("nominal", ["atmosphere.turbulence=moderate", f"seed={seed}"]))).plant
        assert isinstance(plant, JsbsimPlant)
        fdm = plant._fdm
        gust, turn = fdm.getter("atmosphere/total-wind-down-fps"), fdm.getter("atmosphere/q-turb-rad_sec")
        w, q = [], []
        for _ in range(300):
            plant.advance(-0.017, HEALTHY, HEALTHY)
            w.append(gust())
            q.append(turn())
        assert np.corrcoef(np.diff(w), q[1:])[0, 1] < -0.3
