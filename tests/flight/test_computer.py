"""Compiled flights against loop.fly: equal rows to the last bit, for every combination of built-in parts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import nan

import numpy as np
import pytest

from flightbed.analysis.trace import Trace, collect, from_rows
from flightbed.config.kinds import ESTIMATORS
from flightbed.control.proportional import Proportional
from flightbed.core import data
from flightbed.core.errors import EstimateError
from flightbed.core.signals import Estimate, Measurement, Truth
from flightbed.estimation.loop_gain.estimator import LoopGain
from flightbed.flight.assembly import assemble
from flightbed.flight.computer import rows_of
from flightbed.flight.loop import fly
from flightbed.flight.parts import Flight
from flightbed.flight.plan import plan
from flightbed.plant.sensors import Sensors
from flightbed.runs.run import run
from flightbed.scenario.reading import load_scenario
from tests.lateral_flight import NAMES, SOON, rolling

RLS = ['estimators.1={name="rls", kind="differentiated-rls"}']


def _both(scenario: str, settings: Sequence[str] = ()) -> tuple[Trace, Trace]:
    planned = plan(load_scenario(scenario, settings))
    names, hz = [e.name for e in planned.scenario.estimators], planned.scenario.rates.control_hz
    rows = rows_of(assemble(planned))
    assert rows is not None
    return (
        from_rows(rows, estimators=names, control_hz=hz),
        collect(fly(assemble(planned)), estimators=names, control_hz=hz),
    )


def _assert_equal(one: Trace, other: Trace) -> None:
    assert list(one.columns) == list(other.columns)
    for name in one.columns:
        np.testing.assert_array_equal(one[name], other[name], err_msg=name)


def _is_compilable(name: str) -> bool:
    """Return whether the compiled code supports all settings of a scenario."""
    scenario = load_scenario(name)
    return not (
        scenario.lateral.enabled
        or scenario.control.law not in ("proportional", "proportional-integral")
        or any(estimator.kind not in ("loop-gain", "differentiated-rls") for estimator in scenario.estimators)
    )


@pytest.mark.parametrize("name", [n for n in data.names("scenario") if _is_compilable(n)])
def test_shipped_scenarios_are_the_same_both_ways(name: str) -> None:
    scenario = load_scenario(name)
    left = any(e.kind in ESTIMATORS.have(("unknown",)) for e in scenario.estimators)
    if left or scenario.lateral.enabled or scenario.control.law == "lq":
        assert rows_of(assemble(plan(scenario))) is None
    else:
        _assert_equal(*_both(name))


@pytest.mark.parametrize("name", [n for n in data.names("scenario") if not _is_compilable(n)])
def test_other_scenarios_are_not_compiled(name: str) -> None:
    assert rows_of(assemble(plan(load_scenario(name)))) is None


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
    compiled, plain = _both("elevator-loss", [*settings, "duration_s=8", "seed=3"])
    assert 100 < len(compiled) <= 800
    _assert_equal(compiled, plain)


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


def test_flights_with_lateral_axes_or_a_two_stage_filter_are_not_compiled() -> None:
    for name, settings in (("all axes", []), ("no estimator", ["estimators=[]", "adaptation.enabled=false"])):
        flight = assemble(plan(rolling([*SOON, *settings])))
        assert flight.lateral is not None, name
        assert rows_of(flight) is None, name
    two_stage = ["lateral.enabled=false", "failures=[]", "duration_s=3"]
    assert rows_of(assemble(plan(rolling(two_stage)))) is None
    recorded = run(rolling(SOON)).trace
    flown = collect(fly(assemble(plan(rolling(SOON)))), estimators=NAMES, control_hz=100)
    for name in flown.columns:
        np.testing.assert_array_equal(recorded[name], flown[name], err_msg=name)


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
