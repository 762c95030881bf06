"""Compiled flights against loop.fly: equal rows to the last bit, for every combination of built-in parts."""

from __future__ import annotations

from dataclasses import replace
from itertools import islice
from math import nan

import numpy as np
import pytest

from flightbed.analysis.trace import Trace, collect, from_rows
from flightbed.control.proportional import Proportional
from flightbed.core import data
from flightbed.core.errors import EstimateError
from flightbed.core.signals import Estimate, Measurement, Truth
from flightbed.estimation.loop_gain.estimator import LoopGain
from flightbed.estimation.two_stage.estimator import TwoStageSurfaces
from flightbed.flight.assembly import assemble, names_of
from flightbed.flight.composed import Composed
from flightbed.flight.computer import Compiled, computer_of, rows_of
from flightbed.flight.loop import fly
from flightbed.flight.parts import Flight
from flightbed.flight.plan import plan
from flightbed.flight.record import row_packer
from flightbed.plant.sensors import Sensors
from flightbed.runs.run import run
from flightbed.scenario.reading import Scenario, load_scenario
from tests.lateral_flight import SOON, rolling

RLS = ['estimators.1={name="rls", kind="differentiated-rls"}']


def _both(scenario: Scenario) -> tuple[Trace, Trace]:
    planned = plan(scenario)
    hz = planned.scenario.rates.control_hz
    flight, again = assemble(planned), assemble(planned)
    names = names_of(planned.scenario, flight.estimators)
    has = {"lateral": flight.lateral is not None, "load_factor": flight.load_factor is not None}
    rows = rows_of(flight)
    assert rows is not None
    return (
        from_rows(rows, estimators=names, control_hz=hz, **has),
        collect(fly(again), estimators=names, control_hz=hz),
    )


def _assert_equal(one: Trace, other: Trace) -> None:
    assert list(one.columns) == list(other.columns)
    for name in one.columns:
        np.testing.assert_array_equal(one[name], other[name], err_msg=name)


@pytest.mark.parametrize("name", list(data.names("scenario")))
def test_shipped_scenarios_are_the_same_both_ways(name: str) -> None:
    _assert_equal(*_both(load_scenario(name)))


@pytest.mark.parametrize("settings", [["estimators=[]", "adaptation.enabled=false"], ["adaptation.enabled=false"]])
def test_lateral_flights_without_estimators_or_correction_are_the_same_both_ways(settings: list[str]) -> None:
    _assert_equal(*_both(rolling([*SOON, *settings])))


def test_all_compiled_estimators_in_one_flight_are_the_same_both_ways() -> None:
    kinds = ("loop-gain", "two-stage", "input-kalman", "retrospective-cost", "differentiated-rls")
    table = {
        "schema": 1, "name": "mine", "duration_s": 4.0, "estimators": [{"name": kind, "kind": kind} for kind in kinds],
        "failures": [{"at_s": 1.5, "to": 0.5}],
    }  # fmt: skip
    _assert_equal(*_both(load_scenario(table)))


@pytest.mark.parametrize(
    "settings",
    [
        ["control.law=proportional-integral", "failures.0.to=0.1"],  # integral, held at the stops
        ["adaptation.estimator=expanding", "adaptation.caution=2.0"],
        ["adaptation.oracle=true", "adaptation.feedback=position"],
        ["adaptation.limit_command=true", "failures.0.to=0.12", "command.amplitude_deg_s=12"],
        ["control.state_from=scheduled", "rates.delay_ticks=2"],
        ["adaptation.enabled=false", "failures.0.to=0.05"],  # the aircraft departs
        [*RLS, "adaptation.estimator=rls", "estimators.0.input_at=start", "estimators.0.model=short-period"],
        [*RLS, "estimators.1.model=short-period", "sensors.mach_error=0.03", "sensors.mach_std=0.002"],
        ["estimators.0.alarm_threshold=30", "estimators.0.follow_disturbances=true", "estimators.0.hold_std=0.05",
         "atmosphere.turbulence=moderate", "rates.plant_hz=100"],
        ["failures.0.kind=ramp", "failures.0.over_s=3", "estimators.1.memory=fading",
         'gusts=[{at_s=2, up_fps=20, rise_s=0.5, hold_s=1}]', "rates.plant_hz=400"],
    ],
)  # fmt: skip
def test_every_setting_of_the_parts_is_the_same_both_ways(settings: list[str]) -> None:
    compiled, plain = _both(load_scenario("elevator-loss", [*settings, "duration_s=8", "seed=3"]))
    assert 100 < len(compiled) <= 800
    _assert_equal(compiled, plain)


PITCH = ['estimators.0={name="scheduled",kind="two-stage",memory="variable"}']


@pytest.mark.parametrize(
    ("scenario", "settings"),
    [
        ("elevator-loss", PITCH),
        ("elevator-loss", [*PITCH, "estimators.0.model=short-period", "estimators.0.memory=expanding"]),
        ("elevator-loss", [*PITCH, "estimators.0.memory=fading", "estimators.0.follow_disturbances=false"]),
        ("aileron-loss", ["rates.delay_ticks=2", "atmosphere.turbulence=moderate"]),
        ("rudder-loss", ["adaptation.oracle=true", "adaptation.feedback=position"]),
        ("aileron-loss", ["adaptation.enabled=false"]),
        ("elevator-and-aileron", ["adaptation.caution=1", "sensors.beta_std_deg=0.1"]),
        ("elevator-redesign", ["seed=2", "atmosphere.turbulence=light"]),
        ("elevator-redesign", ["rates.delay_ticks=1"]),
        ("pull-up-loss", ["control.identification.form=plain", "control.identification.patience=3"]),
        ("pull-up-loss-scheduled", ["control.autothrottle.enabled=true", "rates.delay_ticks=2"]),
        ("speed-range", ["seed=4"]),
        ("elevator-stuck", ["rates.delay_ticks=3", "estimators.1.model=short-period", "estimators.2.window=20"]),
        (
            "elevator-bias",
            ["atmosphere.turbulence=severe", "estimators.1.order=2", "estimators.1.input_forgetting=0.99"],
        ),
        (
            "elevator-bias",
            ["sensors.q_std_deg_s=0.001", "estimators.2.follow_disturbances=false", "estimators.1.horizon=3"],
        ),
        ("harmonic-gust", ["estimators.1.model=short-period", "estimators.2.model=short-period"]),
    ],
)
def test_every_setting_of_the_large_parts_is_the_same_both_ways(scenario: str, settings: list[str]) -> None:
    _assert_equal(*_both(load_scenario(scenario, settings)))


@pytest.mark.parametrize(
    ("scenario", "settings"),
    [
        ("pull-up-loss", ["control.identification.precision=single"]),
        ("elevator-bias", ["estimators.1.regularization=0", "duration_s=6"]),
        ("elevator-loss", ["estimators.1.kind=plid", "duration_s=6"]),
    ],
)
def test_other_parts_are_composed(scenario: str, settings: list[str]) -> None:
    flight = assemble(plan(load_scenario(scenario, settings)))
    assert rows_of(flight) is None
    assert type(computer_of(flight)) is Composed


def test_mission_flies_the_compiled_code_with_the_same_result(tmp_path: object) -> None:
    scenario = load_scenario("elevator-loss", ["duration_s=6"])
    flown = run(scenario).trace
    names = [e.name for e in scenario.estimators]
    plain = collect(fly(assemble(plan(scenario))), estimators=names, control_hz=100)
    for name in plain.columns:
        np.testing.assert_array_equal(flown[name], plain[name], err_msg=name)


def _flight(*settings: str) -> Flight:
    return assemble(plan(load_scenario("elevator-loss", ["duration_s=5", *settings])))


class _OwnLaw(Proportional):
    def demand(self, measurement: Measurement, *, q_ref_rad_s: float, elevator_rad: float, hold: bool) -> float:
        return 0.5 * super().demand(measurement, q_ref_rad_s=q_ref_rad_s, elevator_rad=elevator_rad, hold=hold)


class _OwnEstimator(LoopGain):
    def update(self, measurement: Measurement) -> Estimate:
        return super().update(measurement)._replace(effectiveness_smoothed=1.0)


class _OwnSensors(Sensors):
    def read(self, tick: int, truth: Truth) -> Measurement:
        return super().read(tick, truth)._replace(q_rad_s=0.0)


def test_subclasses_of_built_in_parts_are_not_compiled() -> None:
    flight = _flight()
    law, estimator, sensors = flight.law, flight.estimators[0], flight.sensors
    assert isinstance(law, Proportional)
    own_law = _OwnLaw(law.gains, alpha_trim_rad=law.alpha_trim_rad, elevator_trim_rad=law.elevator_trim_rad)
    own_estimator = _OwnEstimator.__new__(_OwnEstimator)
    own_estimator.__dict__.update(vars(estimator))
    own_sensors = _OwnSensors.__new__(_OwnSensors)
    own_sensors.__dict__.update(vars(sensors))
    assert rows_of(replace(flight, law=own_law)) is None
    assert rows_of(replace(flight, estimators=[own_estimator, flight.estimators[1]])) is None
    assert rows_of(replace(flight, sensors=own_sensors)) is None
    assert rows_of(flight) is not None


@pytest.mark.parametrize("settings", [[], ["rates.delay_ticks=2"]])
def test_flights_with_lateral_axes_are_the_same_both_ways(settings: list[str]) -> None:
    _assert_equal(*_both(rolling([*SOON, *settings])))


def test_a_smoothed_k_of_an_aileron_that_is_nan_gives_the_same_error_both_ways() -> None:
    def broken() -> Flight:
        flight = assemble(plan(rolling(SOON)))
        estimator = flight.estimators[0]
        assert isinstance(estimator, TwoStageSurfaces)
        estimator._filter._state.gamma[1] = nan  # aileron
        return flight

    messages = []
    for way in (rows_of, lambda flight: list(fly(flight))):
        with pytest.raises(EstimateError) as raised:
            way(broken())
        messages.append(str(raised.value))
    assert messages[0] == messages[1]
    assert messages[0].startswith("estimators")


def test_a_sample_of_the_compiled_computer_is_that_of_the_composed_one() -> None:
    for scenario in (load_scenario("elevator-loss", ["duration_s=6"]), rolling(SOON), load_scenario("throttle-and-cg")):
        flights = [assemble(plan(scenario)) for _ in range(2)]
        computer = computer_of(flights[0])
        assert isinstance(computer, Compiled)
        has = {"lateral": flights[0].lateral is not None, "load_factor": flights[0].load_factor is not None}
        pack = row_packer(flights[0].estimates, **has)
        for ours, theirs in islice(zip(fly(flights[0], computer), fly(flights[1]), strict=True), 50):
            assert type(ours) is type(theirs)
            assert type(ours.tick) is int
            assert pack(ours) == pack(theirs)


def test_a_smoothed_k_that_is_nan_gives_the_same_error_both_ways() -> None:
    def broken() -> Flight:
        flight = _flight()
        estimator = flight.estimators[0]
        assert isinstance(estimator, LoopGain)
        estimator._settings[18] = nan  # smoothing factor
        return flight

    messages = []
    for way in (rows_of, lambda flight: list(fly(flight))):
        with pytest.raises(EstimateError) as raised:
            way(broken())
        messages.append(str(raised.value))
    assert messages[0] == messages[1]
    assert "estimators.0: smoothed K is nan at t = " in messages[0]
