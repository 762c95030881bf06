"""The contract check of estimators: the built-in ones pass, and each violation has its message."""

from __future__ import annotations

import inspect
import time
from itertools import product
from math import inf, nan
from typing import Any, ClassVar

import numpy as np
import pytest

from flightbed.avionics.onboard import OnBoard
from flightbed.config import families
from flightbed.config.kinds import ESTIMATORS, EstimatorSettings, PlainEstimator
from flightbed.config.table import Positive
from flightbed.core.errors import ScenarioError
from flightbed.core.signals import Estimate, Measurement
from flightbed.flight import assembly
from flightbed.flight.parts import Flight
from flightbed.flight.plan import Plan
from flightbed.testing import check as testing
from flightbed.testing.check import ContractError, check_estimator
from tests.flights import representative


class Sound:
    """A valid estimator without information about K; each class below violates the contract in one way."""

    def __init__(self, settings: EstimatorSettings, onboard: OnBoard) -> None:
        self.ticks = 0
        self.start()

    def start(self) -> None:
        pass

    def update(self, measurement: Measurement) -> Any:
        self.ticks += 1
        return self.say(Estimate(1.0, 0.5, 1.0, 1.0, measurement.alpha_rad, measurement.q_rad_s, nan, 0.0))

    def say(self, estimate: Estimate) -> Any:
        return estimate


class NoUpdate:
    def __init__(self, settings: EstimatorSettings, onboard: OnBoard) -> None:
        pass


class NoArguments:
    pass


class BuildsNothing(Sound):
    def start(self) -> None:
        raise ValueError("no such\nmodel")


class Raises(Sound):
    def say(self, estimate: Estimate) -> Any:
        return estimate if self.ticks < 300 else 1.0 / 0.0


class DividesByNothing(Sound):
    """Fails only without motion."""

    def say(self, estimate: Estimate) -> Any:
        return estimate._replace(nis=1.0 / abs(estimate.q_rad_s) if self.ticks > 1 else nan)


class SaysNothing(Sound):
    def say(self, estimate: Estimate) -> Any:
        return None


class Arrays(Sound):
    def say(self, estimate: Estimate) -> Any:
        return estimate._replace(effectiveness_raw=np.array([1.0]))


class NotFinite(Sound):
    def say(self, estimate: Estimate) -> Any:
        return estimate._replace(effectiveness_std=inf, effectiveness=nan)


class NegativeStd(Sound):
    def say(self, estimate: Estimate) -> Any:
        return estimate._replace(effectiveness_std=-0.1)


class NegativeNis(Sound):
    def say(self, estimate: Estimate) -> Any:
        return estimate._replace(nis=-1.0)


class BeyondItsBounds(Sound):
    def say(self, estimate: Estimate) -> Any:
        return estimate._replace(effectiveness=1.5, effectiveness_raw=1.5)


class SmoothsBeyond(Sound):
    def say(self, estimate: Estimate) -> Any:
        return estimate._replace(effectiveness_smoothed=-3.0)


class ChangesOnBoard:
    def __init__(self, settings: EstimatorSettings, onboard: OnBoard) -> None:
        self.sound, self.onboard = Sound(settings, onboard), onboard

    def update(self, measurement: Measurement) -> Estimate:
        self.onboard.design.A[0, 0] += 1e-6
        return self.sound.update(measurement)


class ForgetsAlarms(Sound):
    def say(self, estimate: Estimate) -> Any:
        return estimate._replace(alarms=float(self.ticks == 100))


class Dice(Sound):
    def say(self, estimate: Estimate) -> Any:
        return estimate._replace(effectiveness_raw=float(np.random.normal()))  # noqa: NPY002


class SharedState(Sound):
    """State in the class, reset by every instance: only two alternating instances show it."""

    level: ClassVar[list[float]] = [0.0]

    def start(self) -> None:
        self.level[0] = 0.0

    def say(self, estimate: Estimate) -> Any:
        self.level[0] += estimate.q_rad_s
        return estimate._replace(effectiveness_raw=self.level[0])


class SharedCount(Sound):
    """State in the class, never reset."""

    level: ClassVar[list[float]] = [0.0]

    def say(self, estimate: Estimate) -> Any:
        self.level[0] += 1.0
        return estimate._replace(effectiveness_raw=self.level[0])


class NeverForgets(Sound):
    def start(self) -> None:
        self.all: list[float] = []

    def say(self, estimate: Estimate) -> Any:
        self.all.append(estimate.q_rad_s * 2.0)
        return estimate


class Slow(Sound):
    def say(self, estimate: Estimate) -> Any:
        time.sleep(0.011)
        return estimate


@pytest.fixture
def brief(monkeypatch: pytest.MonkeyPatch) -> None:
    """A short flight of the check of memory, for tests of the other checks."""
    monkeypatch.setattr(testing, "_LONG", 200)
    monkeypatch.setattr(testing, "_INTERVAL", 100)


@pytest.fixture
def shorter(monkeypatch: pytest.MonkeyPatch) -> None:
    """Half the flight of the check of memory: 2000 ticks, and four intervals of 500."""
    monkeypatch.setattr(testing, "_LONG", 2000)
    monkeypatch.setattr(testing, "_INTERVAL", 500)


KINDS = list(product(families.names("estimators"), ("scheduled", "short-period")))
FAST = [(kind, model) for kind, model in KINDS if model == "short-period"]


@pytest.mark.usefixtures("shorter")
@pytest.mark.parametrize(("kind", "model"), representative(KINDS, FAST))
def test_built_in_estimators_keep_the_contract(kind: str, model: str) -> None:
    _keeps_the_contract(kind, model)


@pytest.mark.parametrize(("kind", "model"), representative(KINDS, [("loop-gain", "scheduled")]))
def test_built_in_estimators_keep_the_contract_in_the_whole_check(kind: str, model: str) -> None:
    _keeps_the_contract(kind, model)


def _keeps_the_contract(kind: str, model: str) -> None:
    checked = check_estimator(ESTIMATORS.of(kind), settings={"model": model})
    assert 0.0 < checked.microseconds_per_update < 1e4
    if model == "short-period":  # plant and model are equal
        assert 0.0 < checked.error_healthy < 0.1
        assert 0.0 < checked.error_at_half < 0.05
        assert abs(checked.final_at_half - 0.5) < 0.1
    tests = kind == "two-stage" or (kind == "loop-gain" and model == "scheduled")
    assert (checked.detected_after_s is not None) == tests


def test_a_valid_estimator_passes_and_is_measured() -> None:
    checked = check_estimator(Sound, settings={"bounds": [0.0, 1.0], "options": {"gain": 2.0}})
    assert (checked.error_healthy, checked.error_at_half, checked.final_at_half) == (0.0, 0.5, 1.0)
    assert checked.detected_after_s is None


@pytest.mark.usefixtures("brief")
@pytest.mark.parametrize(
    ("broken", "lines"),
    [
        (NoUpdate, ["update: a NoUpdate has no such method; give it a method update(measurement)"]),
        (NoArguments, ["building: TypeError: NoArguments() takes no arguments; accept the arguments (settings, onboard)"]),
        (BuildsNothing, ["building: test_check.py:LINE ValueError: no such model; accept the arguments (settings, onboard)"]),
        (Raises, ["update: raises ZeroDivisionError: float division by zero at test_check.py:LINE in flight 'healthy'; handle these readings"]),
        (DividesByNothing, ["update: raises ZeroDivisionError: float division by zero at test_check.py:LINE in flight 'nothing moves'; handle these readings"]),
        (SaysNothing, ["estimate: update returns a NoneType at tick 0 of 'healthy'; return a flightbed.Estimate"]),
        (Arrays, ["effectiveness_raw: is a ndarray at tick 0 of 'healthy'; convert it with float(x)"]),
        (NotFinite, ["effectiveness: is nan at tick 0 of 'healthy'; return a finite number, with a large std if it is uncertain", "effectiveness_std: is inf at tick 0 of 'healthy'; return a finite number, with a large std if it is uncertain"]),
        (NegativeStd, ["effectiveness_std: is -0.1 at tick 0 of 'healthy'; return a value of at least 0"]),
        (NegativeNis, ["nis: is -1 at tick 0 of 'healthy'; return a value of at least 0"]),
        (BeyondItsBounds, ["effectiveness: is 1.5 at tick 0 of 'healthy', outside settings.bounds [0, 1]; clip it; effectiveness_raw is the value before clipping"]),
        (SmoothsBeyond, ["effectiveness_smoothed: is -3 at tick 0 of 'healthy', outside [0, 1]; the law divides by it: smooth the value within the bounds"]),
        (ChangesOnBoard, ["onboard: modified in flight (design.A); modify a copy"]),
        (ForgetsAlarms, ["alarms: decreases from 1 to 0 at tick 100 of 'healthy'; count all alarms since the start"]),
        (Dice, ["repeatable: a second estimator gives other estimates for the same readings, from tick 0 on; depend on the arguments only; draw random numbers from an own np.random.default_rng(0)"]),
        (SharedCount, ["repeatable: a second estimator gives other estimates for the same readings, from tick 0 on; depend on the arguments only; draw random numbers from an own np.random.default_rng(0)"]),
        (SharedState, ["own state: two estimators in alternation affect each other, from tick 1 on; keep all state in self, not in the class, the module or a default argument"]),
    ],
)  # fmt: skip
def test_each_violation_has_one_line(broken: Any, lines: list[str]) -> None:
    with pytest.raises(ContractError) as caught:
        check_estimator(broken)
    source, first = inspect.getsourcelines(broken)
    (number,) = [first + i for i, line in enumerate(source) if " / " in line or "raise" in line] or [0]
    assert sorted(caught.value.violations) == [line.replace("LINE", str(number)) for line in lines]
    assert str(caught.value).splitlines() == list(caught.value.violations)
    assert isinstance(caught.value, AssertionError)


def test_growing_memory_is_reported_in_bytes_per_tick() -> None:
    with pytest.raises(ContractError, match=r"^memory: grows by \d\d bytes at every tick; store the last samples only"):
        check_estimator(NeverForgets)


def test_an_update_slower_than_the_tick_is_reported_first() -> None:
    with pytest.raises(ContractError, match=r"^time: an update takes 1\d\d\d\d us, the tick has 10000 us"):
        check_estimator(Slow)


def test_several_violations_are_reported_together() -> None:
    class Several(Sound):
        def say(self, estimate: Estimate) -> Any:
            return estimate._replace(effectiveness_std=-1.0, nis=-1.0, effectiveness=2.0)

    with pytest.raises(ContractError) as caught:
        check_estimator(Several)
    assert [line.partition(":")[0] for line in caught.value.violations] == ["effectiveness", "effectiveness_std", "nis"]


@pytest.mark.usefixtures("brief")
def test_a_violation_on_the_nonlinear_aircraft_only(monkeypatch: pytest.MonkeyPatch) -> None:
    outdoors: list[bool] = []

    def assemble(planned: Plan) -> Flight:
        outdoors.append(True)
        return assembly.assemble(planned)

    class Indoors(Sound):
        def say(self, estimate: Estimate) -> Any:
            return 1.0 / 0.0 if outdoors and self.ticks == 300 else estimate

    monkeypatch.setattr(testing, "assemble", assemble)
    check_estimator(Indoors, jsbsim=False)
    with pytest.raises(
        ContractError, match="ZeroDivisionError: float division by zero at .* 'three seconds of the nonlinear"
    ):
        check_estimator(Indoors)


@pytest.mark.usefixtures("brief")
def test_settings_are_those_of_a_scenario() -> None:
    given: list[PlainEstimator] = []

    def make(settings: PlainEstimator, onboard: OnBoard) -> Sound:
        given.append(settings)
        assert (onboard.schedule is None) == (settings.model == "short-period")
        return Sound(settings, onboard)

    check_estimator(make, settings=PlainEstimator(name="x", model="short-period", smoothing=0.5), jsbsim=False)
    assert (given[0].smoothing, given[0].model) == (0.5, "short-period")
    check_estimator(make, settings={"options": {"taps": [1, 2.5]}}, jsbsim=False)
    assert given[-1].options["taps"] == (1, 2.5)
    with pytest.raises(ScenarioError, match=r"unknown key estimators\.0\.smothing; did you mean smoothing\?"):
        check_estimator(make, settings={"smothing": 0.5})


class Typed(EstimatorSettings):
    """Settings class with one key; ``fault_from`` is the first tick at which K-hat leaves the bounds."""

    fault_from: Positive = 1e6

    def build(self, onboard: OnBoard) -> Sound:
        settings = self

        class Built(Sound):
            def say(self, estimate: Estimate) -> Any:
                return estimate._replace(effectiveness=1.0 if self.ticks < settings.fault_from else 1.5)

        return Built(self, onboard)


class BuildsWithTwoArguments(Typed):
    def build(self, onboard: OnBoard, hz: int) -> Sound:  # type: ignore[override]
        return Sound(self, onboard)


@pytest.mark.usefixtures("brief")
def test_a_settings_class_is_checked_with_its_own_keys() -> None:
    assert check_estimator(Typed, jsbsim=False).final_at_half == 1.0
    with pytest.raises(ContractError, match=r"^effectiveness: is 1.5 at tick 6 of 'healthy', outside settings.bounds"):
        check_estimator(Typed, settings={"fault_from": 7.0}, jsbsim=False)
    with pytest.raises(ScenarioError, match=r"estimators\.0\.fault_from: must be above 0"):
        check_estimator(Typed, settings={"fault_from": 0.0})
    with pytest.raises(ContractError, match=r"^building: .*missing 1 required .*'hz'; accept build\(onboard\)$"):
        check_estimator(BuildsWithTwoArguments)
