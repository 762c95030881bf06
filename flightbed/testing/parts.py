"""Contract checks for your own control law, failure and command: one call each, from pytest or a script, before any flight.

::

    from flightbed.testing import check_command, check_failure, check_law

    def test_my_law_keeps_the_contract():
        check_law(MyLaw, settings={"options": {"weight_s2": 4.0}})

The checks do not judge how well a law flies.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from math import isfinite
from typing import Any

import numpy as np

from flightbed.avionics.short_period import ShortPeriod
from flightbed.config.kinds import FAILURES, LAWS, CommandSettings, FailureSettings, LawSettings
from flightbed.config.own_code import using
from flightbed.config.tracebacks import error_line
from flightbed.core.errors import ExtensionError
from flightbed.core.signals import Health, Measurement
from flightbed.core.units import DEG
from flightbed.flight import loop
from flightbed.flight.assembly import assemble
from flightbed.flight.plan import plan
from flightbed.scenario.reading import load_scenario
from flightbed.scenario.tables import Scenario
from flightbed.testing.check import ContractError, place_of

_NAME = "part-under-test"
_HELD = 1000  # ticks for which a law is held
_DRIFT_RAD = 1e-6  # change of a demand in the last tenth of them that counts as integration


@dataclass(frozen=True)
class CheckedLaw:
    """Measurements of a law that keeps its contract.

    Attributes:
        tracking_rms_deg_s: RMS of q - q_ref over six seconds of the healthy F-16 at Mach 0.8 and 20,000 ft, doublets of 5 deg/s.
        departed: whether the aircraft departed in that time.

    """

    tracking_rms_deg_s: float
    departed: bool


class _Found:
    """The violations of a contract: the first of each check."""

    def __init__(self) -> None:
        self.lines: dict[str, str] = {}

    def add(self, check: str, finding: str, cure: str) -> None:
        """Keep a violation, unless the check has one."""
        self.lines.setdefault(check, f"{check}: {finding}; {cure}")

    @contextmanager
    def running(self, check: str, cure: str) -> Iterator[None]:
        """Keep an exception of the code under test as a violation."""
        try:
            yield
        except Exception as error:
            cause = error.__cause__ if isinstance(error, ExtensionError) and error.__cause__ else error
            self.add(check, f"raises {place_of(cause)}{error_line(cause)}", cure)

    def report(self) -> None:
        """Raise ContractError if there is a violation."""
        if self.lines:
            raise ContractError(list(self.lines.values()))


def _scenario(table: str, value: Any, **more: Any) -> Scenario:
    return load_scenario({"schema": 1, "name": "contract", "duration_s": 6.0, table: value, **more})


def check_command(
    factory: Callable[..., Any] | type[CommandSettings], *, settings: Mapping[str, Any] | None = None
) -> None:
    """Check a command against all requirements of the loop; all violations are reported at once.

    - the factory succeeds and returns a function of an array of times, s;
    - its values are finite floats, one per time, whether the times are those of a whole flight, a part of it, or one alone: the value at a
      time does not depend on the other times;
    - it does not modify the array of times;
    - two commands of the same settings have the same values to the last bit.

    Args:
        factory: your function or class, called with ``(settings)``; or your settings class, whose ``build(amplitude)`` makes the command.
        settings: the table ``[command]`` as a mapping, such as ``{"amplitude_deg_s": 2.0, "options": {"hz": 1.0}}``; ``kind`` does not
            matter.

    Raises:
        ContractError: an AssertionError, with one line per violation: check, finding and cure.
        ScenarioError: ``settings`` are invalid in a scenario.

    """
    found = _Found()
    with using({_NAME: factory}):
        scenario = _scenario("command", {**(settings or {}), "kind": _NAME})
        t_s = np.arange(scenario.ticks) / scenario.rates.control_hz
        given = t_s.copy()
        with found.running("building", "accept the argument (settings) and return a function of times"):
            first, second = scenario.command.rate(), scenario.command.rate()
        if not found.lines:
            with found.running("values", "accept any array of times"):
                whole = first(given)
                _values(found, whole, t_s)
                if not np.array_equal(given, t_s):
                    found.add("times", "modified", "modify a copy")
                if not found.lines:
                    part = slice(137, 411)
                    parts = {
                        "a part": (first(t_s[part]), whole[part]),
                        "a single time": (first(t_s[200:201]), whole[200:201]),
                    }
                    for name, (alone, beside) in parts.items():
                        if not np.array_equal(alone, beside):
                            found.add(
                                "values", f"{name} of the times gives other values", "compute each value from its time"
                            )
                    if not np.array_equal(second(t_s), whole):
                        found.add(
                            "repeatable", "a second command has other values", "draw random numbers with a fixed seed"
                        )
    found.report()


def _values(found: _Found, values: Any, t_s: Any) -> None:
    if not isinstance(values, np.ndarray) or values.shape != t_s.shape:
        got = (
            f"a {type(values).__name__}" if not isinstance(values, np.ndarray) else f"an array of shape {values.shape}"
        )
        found.add("values", f"returns {got} for {len(t_s)} times", "return an array with one value per time")
    elif values.dtype != np.float64:
        found.add("values", f"returns {values.dtype}", "return float64")
    elif not np.all(np.isfinite(values)):
        tick = int(np.flatnonzero(~np.isfinite(values))[0])
        found.add("values", f"{values[tick]} at t = {t_s[tick]:g} s", "return finite values")


def check_failure(
    factory: Callable[..., Any] | type[FailureSettings],
    *,
    settings: Mapping[str, Any] | None = None,
    jsbsim: bool = True,
) -> None:
    """Check a failure against all requirements of the loop; all violations are reported at once.

    - the factory succeeds and returns a function of the tick;
    - its value is a ``Health`` of finite numbers with shares from 0 to 1;
    - before ``at_s`` it is the health of the failures before it, unchanged, and from then on it differs at some tick of the flight;
    - the value at a tick does not depend on the ticks asked before;
    - three seconds of the nonlinear aircraft with it raise nothing.

    Args:
        factory: your function or class, called with ``(settings, before, control_hz)``; or your settings class, whose
            ``build(before, control_hz)`` makes the function.
        settings: the table ``[[failures]]`` as a mapping, such as ``{"to": 0.3}``; ``kind`` does not matter, and ``at_s`` is 1 if missing.
        jsbsim: whether to fly the nonlinear aircraft.

    Raises:
        ContractError: an AssertionError, with one line per violation: check, finding and cure.
        ScenarioError: ``settings`` are invalid in a scenario.

    """
    found, was = _Found(), Health(effectiveness=0.9, elevator_force=0.8, cg_shift_cbar=0.01, aileron=0.7, rudder=0.6)
    with using({_NAME: factory}):
        table = {"at_s": 1.0, **(settings or {}), "kind": _NAME}
        scenario = _scenario("failures", [table], lateral={"enabled": True})
        hz = scenario.rates.control_hz
        start = int(np.ceil(table["at_s"] * hz - 1e-6))
        ticks = range(scenario.ticks)
        with found.running(
            "building", "accept the arguments (settings, before, control_hz) and return a function of the tick"
        ):
            health = FAILURES.build(scenario.failures[0], lambda _tick: was, hz)
        if not found.lines:
            with found.running("health", "accept every tick of a flight"):
                values = [health(tick) for tick in ticks]
                _healths(found, values)
                early = next((tick for tick in ticks[:start] if values[tick] != was), None)
                if early is not None:
                    found.add("onset", f"acts at tick {early}, at_s is tick {start}", "return before(tick) until then")
                elif all(value == was for value in values[start:]):
                    found.add("onset", "never acts", "change a field of before(tick) from at_s on")
                again = next((tick for tick in reversed(ticks) if health(tick) != values[tick]), None)
                if again is not None:
                    found.add(
                        "repeatable",
                        f"another health at tick {again} when asked again",
                        "compute it from the tick alone",
                    )
        if jsbsim and not found.lines:
            with found.running("flight", "return a health that the aircraft has"):
                flown = _scenario("failures", [table], duration_s=max(3.0, (start + 100) / hz))
                for _ in loop.fly(assemble(plan(flown))):
                    pass
    found.report()


def _healths(found: _Found, values: list[Any]) -> None:
    for tick, value in enumerate(values):
        if not isinstance(value, Health):
            found.add("health", f"a {type(value).__name__} at tick {tick}", "return before(tick)._replace(...)")
            return
        for name in ("effectiveness", "elevator_force", "aileron", "rudder"):
            share = getattr(value, name)
            if not (isinstance(share, int | float) and isfinite(share) and 0.0 <= share <= 1.0):
                found.add("health", f"{name} is {share!r} at tick {tick}", "return a share from 0 to 1")
        if not isfinite(value.cg_shift_cbar):
            found.add("health", f"cg_shift_cbar is {value.cg_shift_cbar!r} at tick {tick}", "return a finite shift")


def check_law(
    factory: Callable[..., Any] | type[LawSettings], *, settings: Mapping[str, Any] | None = None
) -> CheckedLaw:
    """Check a pitch-rate law against all requirements of the loop; all violations are reported at once.

    - the factory succeeds, and the law has ``demand(measurement, *, q_ref_rad_s, elevator_rad, hold)``;
    - ``demand`` raises nothing and returns a finite float for the readings of six seconds of the healthy F-16;
    - the design model is unchanged afterwards;
    - two laws with the same readings give the same demands to the last bit: they share no state;
    - while ``hold`` is true the demand comes to rest: the law stops integrating.

    Args:
        factory: your class or function, called with ``(settings, design, control_hz)``; or your settings class, whose
            ``build(design, control_hz)`` makes the law. Laws commanded in g are not checked.
        settings: the table ``[control]`` as a mapping, such as ``{"options": {"weight_s2": 4.0}}``; ``law`` does not matter.

    Returns:
        The measurements.

    Raises:
        ContractError: an AssertionError, with one line per violation: check, finding and cure.
        ScenarioError: ``settings`` are invalid in a scenario.

    """
    found = _Found()
    with using({_NAME: factory}):
        scenario = _scenario("control", {**(settings or {}), "law": _NAME})
        healthy = plan(_scenario("control", {"law": LAWS.default}))
        design, hz = healthy.design, scenario.rates.control_hz
        before = _bytes(design)

        def new() -> Any:
            return LAWS.build(scenario.control, design, hz)

        with found.running(
            "building", "accept the arguments (settings, design, control_hz) and return an object with demand"
        ):
            law = new()
        found.report()
        readings = [sample.measurement for sample in loop.fly(assemble(healthy))]
        references = [0.05 * np.sin(0.02 * k) for k in range(len(readings))]
        with found.running("demand", "accept measurement, q_ref_rad_s, elevator_rad and hold"):
            demands = _demands(found, law, readings, references)
            if not found.lines and _demands(found, new(), readings, references) != demands:
                found.add("repeatable", "a second law has other demands", "keep all state in the object")
            if not found.lines:
                _held(found, new(), readings[0])
        if _bytes(design) != before:
            found.add("design", "modified", "modify a copy")
        found.report()
        flown = None
        with found.running("flight", "accept the readings of a flight"):
            planned = plan(scenario)
            flown = list(loop.fly(assemble(planned)))
        found.report()
        assert flown is not None
        errors = [sample.truth.q_rad_s - sample.q_ref_rad_s for sample in flown]
        return CheckedLaw(float(np.sqrt(np.mean(np.square(errors)))) / DEG, len(flown) < scenario.ticks)


def _bytes(design: ShortPeriod) -> bytes:
    return design.A.tobytes() + design.b.tobytes()


def _demands(found: _Found, law: Any, readings: list[Measurement], references: list[float]) -> list[float]:
    demands: list[float] = []
    for tick, (measurement, reference) in enumerate(zip(readings, references, strict=True)):
        demand = law.demand(measurement, q_ref_rad_s=reference, elevator_rad=measurement.elevator_rad, hold=False)
        if not isinstance(demand, int | float) or not isfinite(demand):
            got = float(demand) if isinstance(demand, int | float) else demand
            found.add("demand", f"returns {got!r} at tick {tick}", "return a finite float, rad")
            return demands
        demands.append(float(demand))
    return demands


def _held(found: _Found, law: Any, measurement: Measurement) -> None:
    """Find a law that goes on integrating a constant error while it is held."""
    held = [
        float(law.demand(measurement, q_ref_rad_s=0.1, elevator_rad=measurement.elevator_rad, hold=True))
        for _ in range(_HELD)
    ]
    drift = abs(held[-1] - held[-_HELD // 10])
    if drift > _DRIFT_RAD:
        found.add(
            "hold",
            f"the demand still moves, {drift:.2g} rad in {_HELD // 10} ticks",
            "do not integrate while hold is true",
        )
