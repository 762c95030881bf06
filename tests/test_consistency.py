"""Keys of the thesis's experiment: what contradicts, and what another key leaves without effect."""

from __future__ import annotations

import pytest

from flightbed.consistency import idle_keys
from flightbed.errors import ScenarioError
from flightbed.scenario import load_scenario

PLACE = "scenarios/thesis-loss.toml"


@pytest.mark.parametrize(
    ("overrides", "problems"),
    [
        (["control.poles=[[-1,0],[-5,5],[-5,-5]]"], [f"{PLACE}: control.poles: cannot go with control.gains, which are not designed; give one of them"]),
        (["control.state_from=windw"], [f"{PLACE}: control.state_from: no estimator is named 'windw'; did you mean window?; there is: window, expanding"]),
        (["control.state_from=x", "adaptation.enabled=false", "estimators=[]"], [f"{PLACE}: control.state_from: no estimator is named 'x'; there is: none"]),
        (["control.gains.q=1"], ["--set: unknown key control.gains.q; did you mean q_s?"]),
        (["estimators.0.input_at=middle"], ["--set estimators.0.input_at: must be 'mean', 'start' or 'end' (got 'middle')"]),
        (["estimators.0.prior.first_reading=kept"], ["--set estimators.0.prior.first_reading: must be 'left-out' or 'used' (got 'kept')"]),
        (["process_noise.q_std_deg_s2=-1"], ["--set process_noise.q_std_deg_s2: must be between 0 and 1000000 (got -1)"]),
        (["process_noise.q_std_deg_s=1"], ["--set: unknown key process_noise.q_std_deg_s; did you mean q_std_deg_s2?"]),
        # idle
        (["control.integral_pole_rad_s=-1"], ["--set control.integral_pole_rad_s: has no effect with control.law = 'proportional'"]),
        (["control.law=proportional-integral", "control.integral_pole_rad_s=-1"], ["--set control.integral_pole_rad_s: has no effect with control.gains"]),
        (["control.gains.integral=-3"], ["--set control.gains.integral: has no effect with control.law = 'proportional'"]),
        (["estimators.1.prior.state=measurement", "estimators.1.prior.first_reading=used"], ["--set estimators.1.prior.first_reading: has no effect with estimators.1.prior.state = 'measurement'"]),
        (["estimators.1.kind=differentiated-rls", "estimators.1.input_at=start"], ["--set estimators.1.input_at: has no effect with estimators.1.kind = 'differentiated-rls'"]),
        (["estimators.1.kind=differentiated-rls", "estimators.1.prior.first_reading=used"], ["--set estimators.1.prior.first_reading: has no effect with estimators.1.kind = 'differentiated-rls'"]),
    ],
)  # fmt: skip
def test_each_problem_is_one_line_with_place_value_and_cure(overrides: list[str], problems: list[str]) -> None:
    with pytest.raises(ScenarioError) as caught:
        load_scenario("thesis-loss", overrides)
    assert list(caught.value.problems) == problems


def test_a_gain_that_is_missing_is_named() -> None:
    with pytest.raises(ScenarioError) as caught:
        load_scenario("nominal", ["control.gains={alpha=1, q_s=1, elevator=0}"])
    assert [p.partition(": ")[2] for p in caught.value.problems] == ["control.gains.reference_s: is missing"]


def test_the_same_keys_are_welcome_where_they_act() -> None:
    sets = ["control.law=proportional-integral", "control.gains.integral=-3", "control.state_from=expanding"]
    sets += ["estimators.0.input_at=start", "estimators.0.prior.first_reading=used", "process_noise.q_std_deg_s2=1"]
    idle = idle_keys(load_scenario("thesis-loss", sets))
    assert not {text.partition("=")[0] for text in sets} & set(idle)
    assert "control.integral_pole_rad_s" in idle
    assert "control.integral_pole_rad_s" not in idle_keys(
        load_scenario("nominal", ["control.law=proportional-integral"])
    )
