"""Settings of laws: the keys of each law, own code, and properties that other parts read."""

from __future__ import annotations

import pytest

from flightbed.avionics.short_period import ShortPeriod
from flightbed.config import families
from flightbed.config.kinds import LAWS, PlainLaw
from flightbed.config.own_code import using
from flightbed.config.table import known_keys
from flightbed.control.design import design_integral
from flightbed.control.redesign import LqSettings
from flightbed.core.errors import ScenarioError
from flightbed.scenario.reading import load_scenario

GAINS = "control.gains={alpha=0.3, q_s=0.8, elevator=-0.3, reference_s=-0.9, integral=-2.0}"
KEYS = {
    "proportional": {"law", "state_from", "poles", "gains"},
    "proportional-integral": {"law", "state_from", "poles", "gains", "integral_pole_rad_s"},
    "lq": {"law", "state_from", "weights"},
    "nz-adaptive": {"law", "state_from", "poles", "autothrottle", "identification"},
    "nz-scheduled": {"law", "state_from", "poles", "autothrottle"},
}


class OwnLaw:
    """A law of own code that keeps its arguments."""

    def __init__(self, *arguments: object) -> None:
        self.arguments = arguments

    def demand(self) -> float:
        return 0.0


def test_each_law_has_its_own_keys() -> None:
    assert {name: set(known_keys(LAWS.of(name), ())) for name in families.built_in("laws")} == KEYS
    assert set(known_keys(PlainLaw, ())) == {"law", "poles", "gains", "state_from", "options"}


def test_a_law_of_own_code_gets_its_table_design_and_rate(design: ShortPeriod) -> None:
    with using({"own": OwnLaw}):
        scenario = load_scenario("elevator-loss", ["control.law=own", GAINS, "control.options.weight=2"])
        law = scenario.control.build(design, 100)
    settings, *others = law.arguments
    assert others == [design, 100]
    assert (settings.gains.integral, settings.poles, dict(settings.options)) == (-2.0, None, {"weight": 2})


@pytest.mark.parametrize(
    ("key", "problem"),
    [
        ("control.poles=[[-1,0],[-2,0],[-3,0]]", "control.poles: cannot be combined with control.gains"),
        ("control.weights.alpha_deg=2", "control.weights: 'own' has no such key ('lq' has it); remove it"),
    ],
)
def test_problems_in_the_table_of_own_code(key: str, problem: str) -> None:
    with using({"own": OwnLaw}), pytest.raises(ScenarioError) as caught:
        load_scenario("elevator-loss", ["control.law=own", GAINS, key])
    assert any(problem in line for line in caught.value.problems), caught.value.problems


def test_gains_at_a_given_k_are_those_of_the_law_redesigned_for_it(design: ShortPeriod) -> None:
    settings = LqSettings()
    law = settings.build(design, 100)
    assert settings.gains_at(design, 100, 1.0) == law.gains
    law.redesign(0.4)
    assert settings.gains_at(design, 100, 0.4) == law.gains


def test_the_integral_pole_is_that_of_the_design(design: ShortPeriod) -> None:
    law = LAWS.make(law="proportional-integral", integral_pole_rad_s=-0.8).build(design, 100)
    assert law.gains == design_integral(design, integral_pole=-0.8)
    assert law.gains != design_integral(design)
