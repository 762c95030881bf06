"""Does your estimator keep its contract? One call tells, from pytest or a script, before it flies.

::

    from flightbed.testing import check_estimator

    def test_my_filter_keeps_the_contract():
        check_estimator(MyFilter)

Whether it estimates *well* is another question: the errors of K on the exact linear plant are in what is returned, for you to judge.
"""

from __future__ import annotations

import gc
import time
import traceback
import tracemalloc
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from flightbed import loop
from flightbed.assembly import assemble, sensor_noise
from flightbed.blame import line_of
from flightbed.errors import ExtensionError
from flightbed.estimation.base import Estimator, OnBoard
from flightbed.extension import using
from flightbed.plan import Plan, plan
from flightbed.scenario import load_scenario
from flightbed.settings import EstimatorSettings
from flightbed.signals import NOTHING_RECONSTRUCTED, Estimate, Measurement
from flightbed.trial import FAILS_AT, beyond, readings_of_flights

Factory = Callable[[EstimatorSettings, OnBoard], Estimator]

_NAME = "estimator-under-test"
_LONG = 4000  # ticks before the memory is looked at
_WATCHED = 1000  # ticks over which it may not grow
_TIMES = 4  # as often it is looked at: what compiled code keeps of its first calls, 20 kB, has come by then, and a tick's shows every time
_BYTES_PER_TICK = 4.0  # half of the smallest number that could be kept at each; the interpreter's own noise is below 1


@dataclass(frozen=True)
class Checked:
    """What was measured of an estimator that keeps its contract.

    Attributes:
        microseconds_per_update: median over a flight, on this computer.
        error_healthy: median |K-hat - 1| on the exact linear plant, before the bounds; nothing fails, doublets of 5 deg/s.
        error_at_half: median |K-hat - 0.5| in the last second of a flight on it whose K drops to 0.5 at 1.5 s of 6 s.
        final_at_half: K-hat at its end.
        detected_after_s: from the drop to the first alarm; None without one.

    """

    microseconds_per_update: float
    error_healthy: float
    error_at_half: float
    final_at_half: float
    detected_after_s: float | None


_INNOVATIONS = tuple(name for name in Estimate._fields if name.startswith("innovation_"))
_RECONSTRUCTED = Estimate._fields[-len(NOTHING_RECONSTRUCTED) :]
_MAY_BE_NAN = {"nis", *_INNOVATIONS, *_RECONSTRUCTED}
_NOT_NEGATIVE = ("effectiveness_std", "nis", *(name for name in _INNOVATIONS if "_std_" in name))


class ContractError(AssertionError):
    """An estimator breaks its contract; ``str()`` has a line for each way.

    Attributes:
        violations: the lines, each "check: what was found; the cure".

    """

    def __init__(self, violations: Sequence[str]) -> None:
        self.violations = tuple(violations)
        super().__init__("\n".join(self.violations))


def check_estimator(
    factory: Factory, *, settings: EstimatorSettings | Mapping[str, Any] | None = None, jsbsim: bool = True
) -> Checked:
    """Check all that the loop relies on in an estimator; every violation is told at once.

    The estimator is built as a flight builds it, for the F-16 at Mach 0.8 and 20,000 ft at 100 Hz, with the schedule on board if
    ``settings`` say ``model = "scheduled"``, as they do by default. It is then fed flights of six seconds with the exact linear plant
    (healthy; K drops to 0.5; nothing moves and nothing is noisy; twenty times the noise), readings far beyond any flight, a long flight,
    and three seconds of the nonlinear aircraft. Checked is that

    - it can be built, and has ``update(measurement)``;
    - ``update`` raises nothing and returns an ``Estimate`` of finite floats. Before the bounds, ``effectiveness_raw`` may be any
      finite number; ``nis`` and the innovations may be nan at ticks that have none, as the first of a filter;
    - ``effectiveness`` lies within ``settings.bounds``, ``effectiveness_smoothed`` within them and 1,
      ``nis`` and all standard deviations are not negative, ``alarms`` never fall;
    - what is on board stays as it was;
    - two of them that are fed the same readings say the same to the last bit, alone or by turns with a third on another flight: no
      state is shared, and what is random is drawn from a generator of their own with a fixed seed;
    - their memory does not grow in flight, after the first 40 s and ``settings.window``;
    - the fastest of 40 updates takes less than a whole tick (what it takes is in the result).

    That an estimate does not depend on later readings, and that readings cannot be changed, needs no check: it is handed them one by
    one, as tuples.

    Args:
        factory: makes an estimator from ``(settings, onboard)``: your class, or a function, as a scenario would name it.
        settings: the table ``[[estimators]]`` as a mapping, such as ``{"model": "short-period", "options": {"gain": 2.0}}``, or as
            EstimatorSettings; ``name`` and ``kind`` do not matter.
        jsbsim: whether to fly the nonlinear aircraft too.

    Returns:
        What was measured.

    Raises:
        ContractError: an AssertionError, with a line for each violation: the check, what was found, and the cure.
        ScenarioError: ``settings`` are not what a scenario may hold.

    """
    raw = settings.model_dump() if isinstance(settings, EstimatorSettings) else dict(settings or {})
    table = {**raw, "name": _NAME, "kind": _NAME}
    with using({_NAME: factory}):
        planned = plan(
            load_scenario(
                {
                    "schema": 1,
                    "name": "contract",
                    "duration_s": 3.0,
                    "failures": [{"at_s": 1.0, "to": 0.5}],
                    "estimators": [table],
                }
            )
        )
        found = _Findings(planned.scenario.estimators[0].bounds)
        checked = _check(factory, planned, found)
        if jsbsim and checked is not None:
            with found.flying("three seconds of the nonlinear aircraft"):
                for sample in loop.fly(assemble(planned)):
                    found.look(sample.estimates[0], sample.tick)
    if found.lines or checked is None:
        raise ContractError(list(found.lines.values()))
    return checked


def _check(factory: Factory, planned: Plan, found: _Findings) -> Checked | None:
    scenario = planned.scenario
    settings, hz = scenario.estimators[0], scenario.rates.control_hz
    onboard = OnBoard(planned.design, sensor_noise(scenario), hz, planned.schedule)

    def new() -> Estimator:
        return factory(settings, onboard)

    try:
        if not callable(getattr(new(), "update", None)):
            found.add("update", f"a {type(new()).__name__} has none", "give it a method update(measurement)")
            return None
    except Exception as error:
        found.add("building", f"{_place(error)}{line_of(error)}", "it is called with (settings, onboard)")
        return None
    before, flights = _fingerprint(onboard), readings_of_flights(onboard)
    with found.flying("K drops to 0.5"):  # first, or all that follows takes for ever
        fastest = min(_times(new, flights["K drops to 0.5"][:40]))
        if fastest > 1e6 / hz:
            found.add(
                "time", f"an update takes {fastest:.0f} us, the tick has {1e6 / hz:.0f} us", "compute less per update"
            )
            return None
    said = {name: found.fly(new, readings, name) for name, readings in flights.items()}
    if (changed := _fingerprint(onboard)) != before:
        names = ", ".join(name for name in before if before[name] != changed[name])
        found.add("onboard", f"what is on board was changed in flight ({names})", "copy what you want to change")
    for name, readings in beyond(flights["healthy"][0]).items():
        found.fly(new, readings, name)
    if found.lines:  # what is broken already would only be told again
        return None
    half = said["K drops to 0.5"]
    _repeatable(new, flights, said, found)
    _growth(new, flights["healthy"], settings.window, found)
    times = _times(new, flights["K drops to 0.5"])
    k_half = np.array([e.effectiveness for e in half])
    alarmed = next((tick for tick, e in enumerate(half) if tick >= FAILS_AT and e.alarms > half[tick - 1].alarms), None)
    return Checked(
        microseconds_per_update=float(np.median(times)),
        error_healthy=float(np.median([abs(e.effectiveness_raw - 1.0) for e in said["healthy"]])),
        error_at_half=float(np.median(np.abs(k_half[-hz:] - 0.5))),
        final_at_half=float(k_half[-1]),
        detected_after_s=None if alarmed is None else (alarmed - FAILS_AT) / hz,
    )


def _fingerprint(onboard: OnBoard) -> dict[str, bytes]:
    """Return what an estimator could change in place, as bytes."""
    arrays = {"design.A": onboard.design.A, "design.b": onboard.design.b}
    if onboard.schedule is not None:
        arrays["schedule"] = onboard.schedule.packed()
    return {name: values.tobytes() for name, values in arrays.items()}


class _Findings:
    """What was found, each kind of it once, with the flight and the tick where it was found first."""

    def __init__(self, bounds: tuple[float, float]) -> None:
        self.lines: dict[str, str] = {}
        self._bounds, self._flight, self._alarms = bounds, "", 0.0

    def add(self, check: str, value: str, cure: str) -> None:
        self.lines.setdefault(check, f"{check}: {value}; {cure}")

    def flying(self, flight: str) -> _Findings:
        self._flight, self._alarms = flight, 0.0
        return self

    def __enter__(self) -> None:
        pass

    def __exit__(self, _kind: object, error: BaseException | None, _trace: object) -> bool:
        """Keep what an estimator raises as a finding."""
        if not isinstance(error, Exception):
            return False
        cause = (
            error.__cause__ if isinstance(error, ExtensionError) and isinstance(error.__cause__, Exception) else error
        )
        self.add("update", f"raises {line_of(cause)} at {_place(cause)}in flight '{self._flight}'", "let it go on")
        return True

    def fly(self, new: Callable[[], Estimator], readings: Sequence[Measurement], flight: str) -> list[Estimate]:
        estimates: list[Estimate] = []
        with self.flying(flight):
            estimator = new()
            for tick, measurement in enumerate(readings):
                estimate = estimator.update(measurement)
                if not self.look(estimate, tick):
                    break
                estimates.append(estimate)
        return estimates

    def look(self, estimate: object, tick: int) -> bool:
        """Check one estimate by itself; tells whether it is one."""
        where = f"at tick {tick} of '{self._flight}'"
        if not isinstance(estimate, Estimate):
            self.add("estimate", f"update returns a {type(estimate).__name__} {where}", "return a flightbed.Estimate")
            return False
        whole = True
        for name, value in zip(Estimate._fields, estimate, strict=True):
            if not isinstance(value, float) and not (name == "alarms" and type(value) is int):
                self.add(name, f"is a {type(value).__name__} {where}", "make it a plain number, float(x)")
                whole = False
            elif not isfinite(value) and not (name in _MAY_BE_NAN and value != value):
                self.add(name, f"is {value} {where}", "give a finite number, however large its std")
                whole = False
        if not whole:
            return False
        low, high = self._bounds
        if not low <= estimate.effectiveness <= high:
            self.add(
                "effectiveness",
                f"is {estimate.effectiveness:g} {where}, outside settings.bounds [{low:g}, {high:g}]",
                "clip it; effectiveness_raw is what it was before",
            )
        for name in _NOT_NEGATIVE:
            if (value := getattr(estimate, name)) < 0.0:
                self.add(name, f"is {value:g} {where}", "it cannot be negative")
        if not min(low, 1.0) - 1e-9 <= estimate.effectiveness_smoothed <= max(high, 1.0) + 1e-9:
            self.add(
                "effectiveness_smoothed",
                f"is {estimate.effectiveness_smoothed:g} {where}, which no smoothing of {low:g} to {high:g}, begun at 1, can give",
                "the law divides by it: smooth what lies within the bounds",
            )
        if estimate.alarms < self._alarms:
            self.add("alarms", f"fall from {self._alarms:g} to {estimate.alarms:g} {where}", "count all alarms so far")
        self._alarms = estimate.alarms
        return True


def _repeatable(
    new: Callable[[], Estimator],
    flights: Mapping[str, Sequence[Measurement]],
    said: Mapping[str, Sequence[Estimate]],
    found: _Findings,
) -> None:
    one, other = "K drops to 0.5", "very noisy"
    with found.flying(one):
        again = new()
        if (tick := _first_difference(said[one], [again.update(m) for m in flights[one]])) is not None:
            found.add(
                "repeatable",
                f"a second one says something else of the same readings, from tick {tick} on",
                "let it depend on nothing but its arguments; draw what is random from np.random.default_rng(0) of its own",
            )
            return
        first, second = new(), new()
        by_turns = [(first.update(a), second.update(b)) for a, b in zip(flights[one], flights[other], strict=True)]
        for name, which in ((one, 0), (other, 1)):
            if (tick := _first_difference(said[name], [pair[which] for pair in by_turns])) is not None:
                found.add(
                    "own state",
                    f"two that are fed by turns disturb each other, from tick {tick} on",
                    "keep all state in self, none in the class, the module or a default argument",
                )


def _first_difference(these: Sequence[Estimate], those: Sequence[Estimate]) -> int | None:
    """Return the first tick at which they differ in a bit."""
    same = np.array(these).view(np.uint64) == np.array(those).view(np.uint64)
    return None if same.all() else int(np.argmin(same.all(axis=1)))


def _growth(new: Callable[[], Estimator], readings: Sequence[Measurement], window: int, found: _Findings) -> None:
    """Fly on and on; what is kept of every tick shows in the memory of every later part of it."""
    estimator, endless = new(), _endless(readings)
    with found.flying("a long flight"):
        for _ in range(_LONG + window):
            estimator.update(next(endless))
        was_tracing = tracemalloc.is_tracing()
        if not was_tracing:
            tracemalloc.start()
        try:
            sizes = [_traced()]
            for _ in range(_TIMES):
                for _ in range(_WATCHED):
                    estimator.update(next(endless))
                sizes.append(_traced())
        finally:
            if not was_tracing:
                tracemalloc.stop()
        slowest = min(after - before for before, after in pairwise(sizes)) / _WATCHED
        if slowest > _BYTES_PER_TICK:
            found.add(
                "memory",
                f"grows by {slowest:.0f} bytes at every tick",
                "keep the last samples only, as in deque(maxlen=30)",
            )


def _traced() -> int:
    gc.collect()
    return tracemalloc.get_traced_memory()[0]


def _endless(readings: Sequence[Measurement]) -> Iterator[Measurement]:
    while True:
        yield from readings


def _times(new: Callable[[], Estimator], readings: Sequence[Measurement]) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return how long each update takes, us."""
    estimator, times = new(), []
    for measurement in readings:
        began = time.perf_counter_ns()
        estimator.update(measurement)
        times.append((time.perf_counter_ns() - began) * 1e-3)
    return np.array(times)


def _place(error: BaseException) -> str:
    """Return "file:line " of where something was raised, outside flightbed if it was."""
    here = str(Path(__file__).parent)
    frames = [(f.f_code.co_filename, line) for f, line in traceback.walk_tb(error.__traceback__)]
    outside = [(file, line) for file, line in frames if not file.startswith(here)]
    return f"{Path(outside[-1][0]).name}:{outside[-1][1]} " if outside else ""
