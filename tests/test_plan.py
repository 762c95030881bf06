"""Plans of the linear aircraft: what it flies with, and what it does not have."""

from __future__ import annotations

from pathlib import Path

import pytest

from flightbed.errors import AircraftError, ScenarioError
from flightbed.linear_aircraft import LinearAircraft
from flightbed.plan import plan
from flightbed.scenario import load_scenario
from flightbed.units import FT
from tests.command_line import flightbed

# override -> the line that it earns; estimators on the schedule are absolute
BEYOND = {
    "condition.mach=0.8": "condition.mach: must be 0.9 with the linear aircraft sillence (got 0.8)",
    "condition.altitude_ft=10000": "condition.altitude_ft: must be 20000.0 with the linear aircraft sillence (got 10000.0)",
    "condition.gamma_deg=5": "condition.gamma_deg: must be 0.0 with the linear aircraft sillence (got 5.0)",
    "aircraft.cg_shift_cbar=0.01": "aircraft.cg_shift_cbar: must be 0.0 with the linear aircraft sillence (got 0.01)",
    "atmosphere.turbulence=light": "atmosphere.turbulence: must be 'none' with the linear aircraft sillence (got 'light')",
    "model_error.cg_shift_cbar=0.02": "model_error.cg_shift_cbar: must be 0.0 with the linear aircraft sillence (got 0.02)",
    "model_error.fuel_lbs=-300": "model_error.fuel_lbs: must be 0.0 with the linear aircraft sillence (got -300.0)",
    "failures.1={kind='cg-shift', at_s=5, shift_cbar=0.03}": "failures.1.shift_cbar: must be 0.0 with the linear aircraft sillence (got 0.03)",
    "estimators.1={name='expanding', memory='expanding'}": "estimators.1.model: must be 'short-period' with the linear aircraft sillence (got 'scheduled')",
}  # fmt: skip


@pytest.mark.parametrize("override", list(BEYOND))
def test_each_thing_that_a_linear_aircraft_does_not_have_is_refused(override: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        plan(load_scenario("thesis-loss", [override]))
    assert caught.value.problems == (BEYOND[override],)


def test_all_of_them_come_at_once(tmp_path: Path) -> None:
    sets = [text for override in BEYOND for text in ("--set", override)]
    done = flightbed("run", "thesis-loss", *sets, cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.splitlines() == [f"flightbed: {line}" for line in BEYOND.values()]
    assert list(tmp_path.iterdir()) == []


def test_the_plan_of_the_shipped_scenario() -> None:
    scenario = load_scenario("thesis-loss")
    found = plan(scenario)
    assert isinstance(found.aircraft, LinearAircraft)
    assert found.design is found.aircraft.design
    assert found.schedule is None
    assert found.scenario.aircraft.model == "sillence"
    assert found.scenario.aircraft.sha256 == found.aircraft.sha256
    point = found.trim
    assert (point.alpha_rad, point.elevator_rad, point.theta_rad, point.residual) == (0.0, 0.0, 0.0, 0.0)
    assert point.motion.altitude_m == 20000 * FT
    assert plan(found.scenario).design.A.tolist() == found.design.A.tolist()  # bound to the aircraft, it is found again


def test_another_aircraft_than_the_one_that_was_flown_is_refused() -> None:
    with pytest.raises(AircraftError, match=r"sillence is not the one that this scenario was flown with"):
        plan(load_scenario("thesis-loss", ["aircraft.sha256=ab12"]))


@pytest.mark.parametrize("key", ["alpha_std_deg_s", "q_std_deg_s2"])
def test_process_noise_is_not_for_a_nonlinear_aircraft(key: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        plan(load_scenario("nominal", [f"process_noise.{key}=0.1"]))
    assert caught.value.problems == (
        "process_noise: only a linear aircraft has it; what disturbs a nonlinear one is atmosphere.turbulence",
    )
    assert caught.value.exit_code == 2
