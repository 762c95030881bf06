"""Real-time pacing of a flight's samples, with the timing of every tick and a count of late ticks.

A generator yields the samples of a flight, and requesting sample k does all work of tick k: the plant advances over the control period
that ends at tick k, with the command of tick k-1; sensors, estimators and law run and give the command of tick k. Requesting the sample
therefore releases the tick, and no work of the flight lies between two ticks. Downstream work on the sample, recording or sending, belongs
to its tick as well. The command of the last tick has no effect: no control period follows.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import count
from typing import NamedTuple, Protocol, TypeVar

from flightbed.core.files import frozen_heap

T = TypeVar("T")
_NS = 1_000_000_000  # per second


class Clock(Protocol):
    """A monotonic clock and its sleep function."""

    @property
    def spin_ns(self) -> int:
        """Time before the end of a wait at which polling of the clock replaces sleep, ns: the expected overshoot of a sleep."""

    def now_ns(self) -> int:
        """Return the time since a fixed origin, ns."""

    def sleep(self, seconds: float) -> None:
        """Wait for at least this many seconds."""


@dataclass(frozen=True)
class WallClock:
    """The computer's monotonic clock.

    Attributes:
        spin_ns: 0.2 ms, measured by ``benchmarks/realtime.py``: on an idle machine a sleep ends 0.12 ms late, 0.2 ms in one of a hundred;
            on a busy machine longer polling lowers the priority of the process, and ticks wait for a core.

    """

    spin_ns: int = 200_000

    def now_ns(self) -> int:
        """Return the time since a fixed origin, ns."""
        return time.perf_counter_ns()

    def sleep(self, seconds: float) -> None:
        """Wait for at least this many seconds; a signal handler runs at once, and an exception from it ends the wait."""
        time.sleep(seconds)


class Timing(NamedTuple):
    """Timing of one tick against the schedule; tick k is due k control periods after the start.

    Attributes:
        release_late_ns: delay of the start of the tick after its due time.
        compute_ns: time from the start to the sample.
        slack_ns: time from the end of the work, downstream included, to the due time of the next tick; negative for a late tick.

    """

    release_late_ns: int
    compute_ns: int
    slack_ns: int


def paced(samples: Iterable[T], *, control_hz: int, clock: Clock, record: Callable[[Timing], object]) -> Iterator[T]:
    """Yield the samples unchanged; request each one no earlier than its tick is due.

    Tick 0 is due at the first request, tick k exactly k/control_hz later, so errors do not accumulate. After an overlong tick the next
    ticks follow without waiting until they are back on schedule. The end of the samples is requested at the due time after the last tick,
    so that a flight takes its whole duration.

    Garbage collections during the flight skip all objects that existed before: scanning the imported libraries takes 0.1 s.

    Args:
        samples: samples of a flight, computed on request.
        control_hz: ticks per second.
        clock: clock that defines the schedule.
        record: called with the timing of every tick, when the consumer requests the next sample or closes the generator.

    """
    source = iter(samples)
    with frozen_heap():
        start = clock.now_ns()
        for tick in count():
            due, deadline = (start + k * _NS // control_hz for k in (tick, tick + 1))
            began = _wait_until(due, clock)
            try:
                sample = next(source)
            except StopIteration:
                return
            computed = clock.now_ns()
            try:
                yield sample
            finally:
                record(Timing(began - due, computed - began, deadline - clock.now_ns()))


def _wait_until(due_ns: int, clock: Clock) -> int:
    """Sleep for most of the wait and poll the clock for the rest; return the time at its end, ns."""
    now = clock.now_ns()
    if (sleep_ns := due_ns - now - clock.spin_ns) > 0:
        clock.sleep(sleep_ns / _NS)
        now = clock.now_ns()
    while now < due_ns:
        now = clock.now_ns()
    return now
