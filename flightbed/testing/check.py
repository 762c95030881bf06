"""Contract check for your own estimator: one call, from pytest or a script, before any flight.

::

    from flightbed.testing import check_estimator

    def test_my_filter_keeps_the_contract():
        check_estimator(MyFilter)

The check does not judge the accuracy of the estimator; the result gives its errors of K on the exact linear plant.
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
from typing import Any, TypeGuard, cast

import numpy as np

from flightbed.avionics.onboard import OnBoard
from flightbed.config import families
from flightbed.config.kinds import EstimatorSettings, PlainEstimator
from flightbed.config.own_code import using
from flightbed.config.tracebacks import error_line
from flightbed.core.errors import ExtensionError
from flightbed.core.signals import NOTHING_RECONSTRUCTED, Estimate, Measurement
from flightbed.estimation.base import Estimator
from flightbed.flight import loop
from flightbed.flight.assembly import assemble, sensor_noise
from flightbed.flight.plan import Plan, plan
from flightbed.scenario.reading import load_scenario
from flightbed.testing.readings import FAILS_AT, out_of_range_readings, readings_of_flights

Factory = Callable[[PlainEstimator, OnBoard], Estimator] | type[EstimatorSettings]

_NAME = "estimator-under-test"
_LONG = 4000  # ticks before the first measurement of memory
_INTERVAL = 1000  # ticks between two measurements, in which memory must not grow
# Number of intervals. Compiled code allocates 20 kB in its first calls, once; memory kept per tick grows in every interval.
_INTERVALS = 4
_BYTES_PER_TICK = 4.0  # half of the smallest number that can be stored per tick; the interpreter's noise is below 1


@dataclass(frozen=True)
class Checked:
    """Measurements of an estimator that keeps its contract.

    Attributes:
        microseconds_per_update: median over a flight, on this computer.
        error_healthy: median |K-hat - 1| on the exact linear plant without failures, K-hat before the bounds, doublets of 5 deg/s.
        error_at_half: median |K-hat - 0.5| in the last second of a 6 s flight of the same plant whose K drops to 0.5 at 1.5 s.
        final_at_half: last K-hat of that flight.
        detected_after_s: time from the drop to the first alarm; None without an alarm.

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
    """An estimator violates its contract; ``str()`` has one line per violation.

    Attributes:
        violations: the lines, each "check: finding; cure".

    """

    def __init__(self, violations: Sequence[str]) -> None:
        self.violations = tuple(violations)
        super().__init__("\n".join(self.violations))


def check_estimator(
    factory: Factory, *, settings: EstimatorSettings | Mapping[str, Any] | None = None, jsbsim: bool = True
) -> Checked:
    """Check an estimator against all requirements of the loop; all violations are reported at once.

    The estimator is built as in a flight, for the F-16 at Mach 0.8 and 20,000 ft at 100 Hz, with the schedule on board if ``settings``
    have ``model = "scheduled"``, the default. It then gets the readings of six-second flights of the exact linear plant (healthy; K drops
    to 0.5; no motion and no noise; twenty times the noise), readings far outside any flight, a long flight, and three seconds of the
    nonlinear aircraft. The requirements are:

    - the factory succeeds, and the estimator has ``update(measurement)``;
    - ``update`` raises nothing and returns an ``Estimate`` of finite floats. ``effectiveness_raw``, the value before the bounds, may be
      any finite number; ``nis`` and the innovations may be nan at ticks that have none, such as the first tick of a filter;
    - ``effectiveness`` lies within ``settings.bounds``, ``effectiveness_smoothed`` between the bounds extended to 1,
      ``nis`` and all standard deviations are not negative, ``alarms`` never decrease;
    - ``onboard`` is unchanged afterwards;
    - two estimators with the same readings give the same estimates to the last bit, alone or alternating with an estimator of another
      flight: they share no state, and each draws its random numbers from its own generator with a fixed seed;
    - memory does not grow in flight, after the first 40 s and ``constant_over`` ticks of a settings class;
    - the fastest of 40 updates takes less than one tick (the result gives the median).

    Two properties hold by construction: an estimate cannot depend on later readings, and readings cannot be modified, because ``update``
    gets them one by one, as tuples.

    Args:
        factory: makes an estimator from ``(settings, onboard)``: your class, or a function, as a scenario names it; or your settings class,
            whose ``build(onboard)`` makes it.
        settings: the table ``[[estimators]]`` as a mapping, such as ``{"model": "short-period", "options": {"gain": 2.0}}``, or as
            PlainEstimator or an object of your settings class; ``name`` and ``kind`` do not matter.
        jsbsim: whether to fly the nonlinear aircraft too.

    Returns:
        The measurements.

    Raises:
        ContractError: an AssertionError, with one line per violation: check, finding and cure.
        ScenarioError: ``settings`` are invalid in a scenario.

    """
    raw = settings.model_dump() if isinstance(settings, EstimatorSettings) else dict(settings or {})
    kind = _kind(factory)
    table = {**raw, "name": _NAME, "kind": kind}
    with using({_NAME: factory} if kind == _NAME else {}):
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
            with found.in_flight("three seconds of the nonlinear aircraft"):
                for sample in loop.fly(assemble(planned)):
                    found.check(sample.estimates[0], sample.tick)
    if found.lines or checked is None:
        raise ContractError(list(found.lines.values()))
    return checked


def _check(factory: Factory, planned: Plan, found: _Findings) -> Checked | None:
    scenario = planned.scenario
    settings, hz = scenario.estimators[0], scenario.rates.control_hz
    onboard = OnBoard(planned.design, sensor_noise(scenario), hz, planned.schedule)

    make = (lambda s, o: s.build(o)) if _is_settings(factory) else cast("Callable[[Any, OnBoard], Any]", factory)

    def new() -> Estimator:
        made: Estimator = make(settings, onboard)
        return made

    try:
        if not callable(getattr(new(), "update", None)):
            found.add("update", f"a {type(new()).__name__} has no such method", "give it a method update(measurement)")
            return None
    except Exception as error:
        cure = "accept build(onboard)" if _is_settings(factory) else "accept the arguments (settings, onboard)"
        found.add("building", f"{_place(error)}{error_line(error)}", cure)
        return None
    before, flights = _fingerprint(onboard), readings_of_flights(onboard)
    with found.in_flight("K drops to 0.5"):  # first: the other checks take too long with a slow estimator
        fastest = min(_times(new, flights["K drops to 0.5"][:40]))
        if fastest > 1e6 / hz:
            found.add(
                "time", f"an update takes {fastest:.0f} us, the tick has {1e6 / hz:.0f} us", "compute less per update"
            )
            return None
    estimates = {name: found.fly(new, readings, name) for name, readings in flights.items()}
    if (changed := _fingerprint(onboard)) != before:
        names = ", ".join(name for name in before if before[name] != changed[name])
        found.add("onboard", f"modified in flight ({names})", "modify a copy")
    for name, readings in out_of_range_readings(flights["healthy"][0]).items():
        found.fly(new, readings, name)
    if found.lines:  # the next checks would only repeat these findings
        return None
    half = estimates["K drops to 0.5"]
    _repeatable(new, flights, estimates, found)
    _growth(new, flights["healthy"], settings.constant_over or 0, found)
    times = _times(new, flights["K drops to 0.5"])
    k_half = np.array([e.effectiveness for e in half])
    alarmed = next((tick for tick, e in enumerate(half) if tick >= FAILS_AT and e.alarms > half[tick - 1].alarms), None)
    return Checked(
        microseconds_per_update=float(np.median(times)),
        error_healthy=float(np.median([abs(e.effectiveness_raw - 1.0) for e in estimates["healthy"]])),
        error_at_half=float(np.median(np.abs(k_half[-hz:] - 0.5))),
        final_at_half=float(k_half[-1]),
        detected_after_s=None if alarmed is None else (alarmed - FAILS_AT) / hz,
    )


def _is_settings(factory: Factory) -> TypeGuard[type[EstimatorSettings]]:
    return isinstance(factory, type) and issubclass(factory, EstimatorSettings)


def _kind(factory: Factory) -> str:
    """Return the kind of a registered settings class; another factory gets the name of this check."""
    kind = factory.model_fields["kind"].default if _is_settings(factory) else _NAME
    registered = families.is_taken("estimators", kind) and families.factory("estimators", kind) is factory
    return str(kind) if registered else _NAME


def _fingerprint(onboard: OnBoard) -> dict[str, bytes]:
    """Return the on-board arrays that an estimator could modify, as bytes."""
    arrays = {"design.A": onboard.design.A, "design.b": onboard.design.b}
    if onboard.schedule is not None:
        arrays["schedule"] = onboard.schedule.packed()
    return {name: values.tobytes() for name, values in arrays.items()}


class _Findings:
    """Findings of a check: the first of each kind, with flight and tick."""

    def __init__(self, bounds: tuple[float, float]) -> None:
        self.lines: dict[str, str] = {}
        self._bounds, self._flight, self._alarms = bounds, "", 0.0

    def add(self, check: str, value: str, cure: str) -> None:
        self.lines.setdefault(check, f"{check}: {value}; {cure}")

    def in_flight(self, flight: str) -> _Findings:
        self._flight, self._alarms = flight, 0.0
        return self

    def __enter__(self) -> None:
        pass

    def __exit__(self, _kind: object, error: BaseException | None, _trace: object) -> bool:
        """Record an exception of the estimator as a finding."""
        if not isinstance(error, Exception):
            return False
        cause = (
            error.__cause__ if isinstance(error, ExtensionError) and isinstance(error.__cause__, Exception) else error
        )
        self.add(
            "update",
            f"raises {error_line(cause)} at {_place(cause)}in flight '{self._flight}'",
            "handle these readings",
        )
        return True

    def fly(self, new: Callable[[], Estimator], readings: Sequence[Measurement], flight: str) -> list[Estimate]:
        estimates: list[Estimate] = []
        with self.in_flight(flight):
            estimator = new()
            for tick, measurement in enumerate(readings):
                estimate = estimator.update(measurement)
                if not self.check(estimate, tick):
                    break
                estimates.append(estimate)
        return estimates

    def check(self, estimate: object, tick: int) -> bool:
        """Check one estimate; return whether it is an Estimate of valid numbers."""
        where = f"at tick {tick} of '{self._flight}'"
        if not isinstance(estimate, Estimate):
            self.add("estimate", f"update returns a {type(estimate).__name__} {where}", "return a flightbed.Estimate")
            return False
        valid = True
        for name, value in zip(Estimate._fields, estimate, strict=True):
            if not isinstance(value, float) and not (name == "alarms" and type(value) is int):
                self.add(name, f"is a {type(value).__name__} {where}", "convert it with float(x)")
                valid = False
            elif not isfinite(value) and not (name in _MAY_BE_NAN and value != value):
                self.add(name, f"is {value} {where}", "return a finite number, with a large std if it is uncertain")
                valid = False
        if not valid:
            return False
        low, high = self._bounds
        if not low <= estimate.effectiveness <= high:
            self.add(
                "effectiveness",
                f"is {estimate.effectiveness:g} {where}, outside settings.bounds [{low:g}, {high:g}]",
                "clip it; effectiveness_raw is the value before clipping",
            )
        for name in _NOT_NEGATIVE:
            if (value := getattr(estimate, name)) < 0.0:
                self.add(name, f"is {value:g} {where}", "return a value of at least 0")
        if not min(low, 1.0) - 1e-9 <= estimate.effectiveness_smoothed <= max(high, 1.0) + 1e-9:
            self.add(
                "effectiveness_smoothed",
                f"is {estimate.effectiveness_smoothed:g} {where}, outside [{min(low, 1.0):g}, {max(high, 1.0):g}]",
                "the law divides by it: smooth the value within the bounds",
            )
        if estimate.alarms < self._alarms:
            self.add(
                "alarms",
                f"decreases from {self._alarms:g} to {estimate.alarms:g} {where}",
                "count all alarms since the start",
            )
        self._alarms = estimate.alarms
        return True


def _repeatable(
    new: Callable[[], Estimator],
    flights: Mapping[str, Sequence[Measurement]],
    estimates: Mapping[str, Sequence[Estimate]],
    found: _Findings,
) -> None:
    one, other = "K drops to 0.5", "very noisy"
    with found.in_flight(one):
        again = new()
        if (tick := _first_difference(estimates[one], [again.update(m) for m in flights[one]])) is not None:
            found.add(
                "repeatable",
                f"a second estimator gives other estimates for the same readings, from tick {tick} on",
                "depend on the arguments only; draw random numbers from an own np.random.default_rng(0)",
            )
            return
        first, second = new(), new()
        alternating = [(first.update(a), second.update(b)) for a, b in zip(flights[one], flights[other], strict=True)]
        for name, which in ((one, 0), (other, 1)):
            if (tick := _first_difference(estimates[name], [pair[which] for pair in alternating])) is not None:
                found.add(
                    "own state",
                    f"two estimators in alternation affect each other, from tick {tick} on",
                    "keep all state in self, not in the class, the module or a default argument",
                )


def _first_difference(these: Sequence[Estimate], those: Sequence[Estimate]) -> int | None:
    """Return the first tick at which two sequences differ in any bit; None if they are equal."""
    same = np.array(these).view(np.uint64) == np.array(those).view(np.uint64)
    return None if same.all() else int(np.argmin(same.all(axis=1)))


def _growth(new: Callable[[], Estimator], readings: Sequence[Measurement], window: int, found: _Findings) -> None:
    """Check that memory does not grow over a long flight: memory kept per tick grows in every interval."""
    estimator, repeated = new(), _repeated(readings)
    with found.in_flight("a long flight"):
        for _ in range(_LONG + window):
            estimator.update(next(repeated))
        was_tracing = tracemalloc.is_tracing()
        if not was_tracing:
            tracemalloc.start()
        try:
            sizes = [_memory_in_use()]
            for _ in range(_INTERVALS):
                for _ in range(_INTERVAL):
                    estimator.update(next(repeated))
                sizes.append(_memory_in_use())
        finally:
            if not was_tracing:
                tracemalloc.stop()
        slowest = min(after - before for before, after in pairwise(sizes)) / _INTERVAL
        if slowest > _BYTES_PER_TICK:
            found.add(
                "memory",
                f"grows by {slowest:.0f} bytes at every tick",
                "store the last samples only, for example in deque(maxlen=30)",
            )


def _memory_in_use() -> int:
    gc.collect()
    return tracemalloc.get_traced_memory()[0]


def _repeated(readings: Sequence[Measurement]) -> Iterator[Measurement]:
    while True:
        yield from readings


def _times(new: Callable[[], Estimator], readings: Sequence[Measurement]) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return the time of each update, us, (ticks,)."""
    estimator, times = new(), []
    for measurement in readings:
        began = time.perf_counter_ns()
        estimator.update(measurement)
        times.append((time.perf_counter_ns() - began) * 1e-3)
    return np.array(times)


def _place(error: BaseException) -> str:
    """Return "file:line " of the innermost frame outside flightbed; nothing if there is none."""
    here = str(Path(__file__).resolve().parents[1])
    frames = [(f.f_code.co_filename, line) for f, line in traceback.walk_tb(error.__traceback__)]
    outside = [(file, line) for file, line in frames if not file.startswith(here)]
    return f"{Path(outside[-1][0]).name}:{outside[-1][1]} " if outside else ""
