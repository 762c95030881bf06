"""Flights that Python code steps: equal to flown ones, and what a given command replaces."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from math import inf, nan
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import flightbed
from flightbed import Sample, Stepper
from flightbed.analysis.trace import Trace, collect
from flightbed.control.proportional_integral import ProportionalIntegral
from flightbed.core.errors import ExtensionError, UnknownNameError
from flightbed.core.units import DEG
from flightbed.flight.assembly import assemble, names_of
from flightbed.flight.composed import Composed
from flightbed.flight.computer import computer_of
from flightbed.flight.loop import Computer, Loop, fly
from flightbed.flight.parts import Flight
from flightbed.flight.plan import plan
from flightbed.scenario.reading import load_scenario

QUIET = ["failures=[]", "command.kind=none", "duration_s=3"]
KINDS: dict[str, tuple[str, list[str]]] = {
    "linear": ("thesis-loss", ["duration_s=6"]),
    "F-16": ("elevator-loss", ["duration_s=6"]),
    "delay": ("elevator-loss", ["duration_s=6", "rates.delay_ticks=3"]),
    "integral": ("elevator-loss", ["duration_s=6", "control.law=proportional-integral", "failures.0.to=0.1"]),
    "departure": ("elevator-loss", ["duration_s=9", "adaptation.enabled=false", "failures.0.to=0.05"]),
    "lateral": ("aileron-loss", ["duration_s=6"]),
    "lateral with delay": ("aileron-loss", ["duration_s=6", "rates.delay_ticks=2"]),
    "load factor": ("pull-up-loss-scheduled", []),
    "throttle": ("throttle-and-cg", []),
    "redesign": ("elevator-redesign", ["duration_s=8"]),
    "two-stage": ("elevator-loss", ["duration_s=6", 'estimators.0.kind="two-stage"', "estimators.0.memory=expanding"]),
    "reconstruction": ("elevator-bias", ["duration_s=6"]),
    "gust": ("harmonic-gust", ["duration_s=3"]),
}


def _trace(samples: Sequence[Sample], flight: Flight, scenario: flightbed.Scenario) -> Trace:
    names = names_of(scenario, flight.estimators)
    return collect(samples, estimators=names, control_hz=scenario.rates.control_hz)


def assert_equal(one: Trace, other: Trace) -> None:
    """Compare all columns to the last bit."""
    assert list(one.columns) == list(other.columns)
    for name in one.columns:
        np.testing.assert_array_equal(one[name], other[name], err_msg=name)


def _stepped(stepper: Stepper, command: Callable[[Sample], float | None] = lambda _: None) -> list[Sample]:
    samples = []
    while stepper.ended is None:
        samples.append(stepper.sense())
        assert stepper.sense() is samples[-1]
        stepper.advance(command(samples[-1]))
    return samples


@pytest.mark.parametrize("kind", KINDS)
def test_a_stepped_flight_equals_a_flown_one(kind: str) -> None:
    scenario = load_scenario(*KINDS[kind])
    flight = assemble(plan(scenario))
    flown = _trace(list(fly(flight)), flight, scenario)  # by the composed computer
    stepper = Stepper(scenario)
    assert_equal(_trace(_stepped(stepper), flight, scenario), flown)
    assert stepper.ended == ("time" if len(flown) == scenario.ticks else "departed")
    assert (len(flown) < scenario.ticks) == (kind == "departure")


@pytest.mark.parametrize("kind", ["linear", "F-16", "delay", "lateral", "reconstruction"])
def test_the_command_of_the_law_given_as_a_number_flies_the_same_flight(kind: str) -> None:
    """A given command acts in the tick in which the law's command acts."""
    scenario = load_scenario(*KINDS[kind])
    flight = assemble(plan(scenario))
    given = _stepped(Stepper(scenario), lambda sample: sample.elevator_cmd_rad)
    assert_equal(_trace(given, flight, scenario), _trace(list(fly(flight)), flight, scenario))


@pytest.mark.parametrize("delay", [0, 4])
@pytest.mark.parametrize("name", ["nominal", "thesis-loss"])
def test_a_command_acts_in_its_own_tick(name: str, delay: int) -> None:
    """The elevator moves in the period of its tick, and q in the sample at the end of this period."""
    settings = [*QUIET, f"rates.delay_ticks={delay}", "duration_s=0.5"]
    plain = _stepped(Stepper(name, settings))
    moved = _stepped(
        Stepper(name, settings), lambda sample: sample.elevator_cmd_rad + 1.0 * DEG if sample.tick == 20 else None
    )
    pairs = list(zip(moved, plain, strict=True))
    differing = [a.tick for a, b in pairs if a.truth.q_rad_s != b.truth.q_rad_s]
    assert differing[0] == 21 + delay
    assert next(a.tick for a, b in pairs if a.truth.elevator_mean_rad != b.truth.elevator_mean_rad) == 21 + delay
    assert moved[21 + delay].truth.q_rad_s < plain[21 + delay].truth.q_rad_s  # elevator down, nose down


def test_the_actuator_stops_a_given_command() -> None:
    at_stop, beyond = (
        _stepped(Stepper("nominal", ["duration_s=0.5", *QUIET[:2]]), lambda _, rad=rad: rad * DEG)  # type: ignore[misc]
        for rad in (25.0, 400.0)
    )
    assert [sample.truth for sample in at_stop] == [sample.truth for sample in beyond]
    assert max(sample.truth.elevator_rad for sample in beyond) <= 25.0 * DEG + 1e-12


def test_the_listening_estimators_get_the_given_command() -> None:
    """The measured deflection follows the given command; beside the law's command it looks like an actuator that does not."""
    scenario = load_scenario("elevator-bias", ["failures=[]", "duration_s=6", "adaptation.enabled=false"])

    def wave(tick: int) -> float:
        return (-0.1 if tick // 40 % 2 else -3.1) * DEG

    stepper = Stepper(scenario)
    given = _stepped(stepper, lambda sample: wave(sample.tick))
    flight = assemble(plan(scenario))
    computer = Composed(flight)
    hears = list(computer.listeners)
    assert len(hears) == 2
    computer.listeners = [lambda _, hear=hear: hear(demands[-1]) for hear in hears]  # type: ignore[misc]
    loop, demands, mistaken = Loop(flight, computer), [], []
    while loop.ended is None:
        loop.sense()
        mistaken.append(loop.sample())
        demands.append(mistaken[-1].elevator_cmd_rad)
        loop.advance(wave(loop.tick))
    actuator = 2.0  # verdict: the measured deflection does not follow the command
    assert all(estimate.verdict != actuator for sample in given for estimate in sample.estimates[1:])
    assert all(mistaken[-1].estimates[i].verdict == actuator for i in (1, 2))


def _commanded(flight: Flight, computer: Computer, command: Callable[[int], float | None]) -> list[Sample]:
    loop, samples = Loop(flight, computer), []
    while loop.ended is None:
        loop.sense()
        samples.append(loop.sample())
        loop.advance(command(loop.tick))
    return samples


@pytest.mark.parametrize("kind", ["linear", "integral", "delay"])
def test_given_commands_are_the_same_for_both_computers(kind: str) -> None:
    scenario = load_scenario(*KINDS[kind])

    def command(tick: int) -> float | None:
        return 0.02 * float(np.sin(0.1 * tick)) - 0.03 if 100 <= tick < 250 else None

    flights = [assemble(plan(scenario)) for _ in range(2)]
    one, other = (
        _trace(_commanded(flight, computer, command), flight, scenario)
        for flight, computer in zip(flights, (Composed(flights[0]), computer_of(flights[1])), strict=True)
    )
    assert not isinstance(computer_of(flights[1]), Composed)
    assert_equal(one, other)


def test_a_given_command_holds_the_integral() -> None:
    scenario = load_scenario("nominal", ["control.law=proportional-integral", "duration_s=4"])
    flight = assemble(plan(scenario))
    law = flight.law
    assert isinstance(law, ProportionalIntegral)
    loop, integrals = Loop(flight, Composed(flight)), []
    while loop.ended is None:
        loop.advance(-0.03 if 100 <= loop.tick < 200 else None)
        integrals.append(law._integral)
    assert len(set(integrals[100:200])) == 1  # the first of these ticks was decided before its command was given
    assert integrals[200] == integrals[199]
    assert len(set(integrals[:100])) > 90
    assert len(set(integrals[200:300])) > 90


def test_a_flight_ends_by_time_departure_or_ground() -> None:
    stepper = Stepper("nominal", ["duration_s=0.5", *QUIET[:2]])
    ticks = []
    while True:  # ``ended`` is set with the last sample
        ticks.append(stepper.sense().tick)
        if stepper.ended is not None:
            break
        stepper.advance()
    assert ticks == list(range(50))
    assert stepper.ended == "time"

    pulled = Stepper("nominal", QUIET)
    while pulled.ended is None:  # without ``sense``
        pulled.advance(-25.0 * DEG)
    assert pulled.ended == "departed"
    last = pulled.sense()
    assert abs(last.truth.alpha_rad - plan(pulled.scenario).trim.alpha_rad) > 25.0 * DEG

    pushed = Stepper("nominal", ["condition.altitude_ft=600", "duration_s=20", *QUIET[:2]])
    while pushed.ended is None:
        pushed.advance(pushed.sense().elevator_cmd_rad + 1.0 * DEG)
    assert pushed.ended == "ground"
    assert pushed.sense().truth.altitude_m < 0.0


def test_advance_after_the_end_is_an_error() -> None:
    stepper = Stepper("nominal", ["duration_s=0.1", *QUIET[:2]])
    samples = _stepped(stepper)
    for _ in range(2):
        with pytest.raises(RuntimeError, match=r"^advance: the flight ended at tick 9 \(time\); start a new one$"):
            stepper.advance()
    assert stepper.sense() is samples[-1]


@pytest.mark.parametrize("wrong", [nan, inf, -inf, "0.1", True, [0.1], np.array([0.1]), 1j])
def test_a_command_that_is_no_finite_number_is_an_error(wrong: Any) -> None:
    stepper = Stepper("nominal", QUIET)
    with pytest.raises(ValueError, match=r"^command_rad: must be a finite number, rad, or None \(got "):
        stepper.advance(wrong)
    assert stepper.sense().tick == 0
    stepper.advance(np.float32(-0.03))  # type: ignore[arg-type]
    assert stepper.sense().tick == 1


def test_names_paths_mappings_and_overrides() -> None:
    by_texts = Stepper("nominal", ["seed=3", "duration_s=2"])
    by_mapping = Stepper("nominal", {"seed": 3, "duration_s": 2})
    by_scenario = Stepper(load_scenario("nominal", ["seed=3", "duration_s=2"]))
    assert by_texts.sense().measurement == by_mapping.sense().measurement == by_scenario.sense().measurement
    assert by_texts.sense().measurement != Stepper("nominal").sense().measurement
    assert by_mapping.scenario.seed == 3
    with pytest.raises(ValueError, match=r"^overrides: apply to a name or a file, not to a Scenario \(got seed=3\)$"):
        Stepper(by_texts.scenario, ["seed=3"])
    with pytest.raises(UnknownNameError):
        Stepper("nominall")


def test_the_example_of_the_documents_flies(capsys: pytest.CaptureFixture[str]) -> None:
    page = (Path(__file__).resolve().parents[2] / "docs" / "control.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"```python\n(.*?)```", page[page.index("## A flight in steps") :], flags=re.DOTALL)
    exec(compile(code, "control.md", "exec"), {})
    assert capsys.readouterr().out == "time\n"


class Late:
    """Fails at tick 5."""

    def __init__(self, *_: object) -> None:
        self.tick = 0

    def update(self, measurement: flightbed.Measurement) -> flightbed.Estimate:
        self.tick += 1
        if self.tick == 6:
            raise OSError("no more")
        return flightbed.Estimate(1.0, 1.0, 1.0, 1.0, measurement.alpha_rad, measurement.q_rad_s, 0.0)


def test_errors_of_own_code_have_file_line_and_time() -> None:
    with flightbed.using({"late": Late}):
        stepper = Stepper("nominal", ["estimators=[{name='scheduled',kind='late'}]", "adaptation.enabled=false"])
        for _ in range(5):
            stepper.advance()
        with pytest.raises(ExtensionError, match=r"^own code late: fails at t = 0.05 s, tick 5: .*: OSError: no more$"):
            stepper.sense()
        with pytest.raises(RuntimeError, match=r"^sense: the flight failed at tick 5; start a new one$"):
            stepper._loop.sense()
