"""Samples at the pace of the wall clock, and how well the pace was kept: every tick is timed, and a late one is counted.

A flight's samples come from a generator, and asking it for sample k does all of tick k's work: the plant flies the control period that ends
at tick k, with the command of tick k-1, and is sensed; estimators and law answer, and the command of tick k goes out. So tick k is released
by asking for its sample, and no work of the flight lies between two ticks. What is done with the sample downstream, recording or sending,
belongs to the tick as well. Of the last tick's command nothing is seen any more; the period that it flies has no tick of its own.
"""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import count
from typing import NamedTuple, Protocol, TypeVar

import numpy as np
import numpy.typing as npt

from flightbed.trace import Trace

T = TypeVar("T")
_NS = 1_000_000_000  # per second


class Clock(Protocol):
    """A clock that never goes back, and the sleep that belongs to it."""

    @property
    def spin_ns(self) -> int:
        """How long before its end a wait stops sleeping and watches the clock instead, ns: what the sleep may overshoot."""

    def now_ns(self) -> int:
        """Return the time since some fixed moment, ns."""

    def sleep(self, seconds: float) -> None:
        """Let at least so many seconds go by."""


@dataclass(frozen=True)
class WallClock:
    """The computer's monotonic clock.

    Attributes:
        spin_ns: 0.2 ms, by ``benchmarks/realtime.py``: on an idle machine a sleep ends 0.12 ms late, 0.2 ms in one of a hundred; on a busy
            one every further bit of spinning costs the scheduler's favour, and with it ticks that wait for a core.

    """

    spin_ns: int = 200_000

    def now_ns(self) -> int:
        """Return the time since some fixed moment, ns."""
        return time.perf_counter_ns()

    def sleep(self, seconds: float) -> None:
        """Let at least so many seconds go by; a signal's handler runs at once, and what it raises ends the sleep."""
        time.sleep(seconds)


class Timing(NamedTuple):
    """How one tick kept to the schedule, on which tick k is due k control periods after the start.

    Attributes:
        release_late_ns: from when it was due to when it began.
        compute_ns: from when it began to when its sample was there.
        slack_ns: from when its work was done, downstream included, to when the next tick was due; negative: this tick is late.

    """

    release_late_ns: int
    compute_ns: int
    slack_ns: int


def paced(samples: Iterable[T], *, control_hz: int, clock: Clock, record: Callable[[Timing], object]) -> Iterator[T]:
    """Yield the samples unchanged, each asked for no sooner than its tick is due.

    Tick 0 is due when the first sample is asked for, tick k exactly k/control_hz later: nothing adds up. After a tick that took too long
    the ones behind it follow at once, until the schedule is caught up with. The end of the samples is looked for when the tick after the
    last one is due, so that a flight takes its whole duration.

    Garbage collections while the samples flow pass over all that was there before: looking through the imported libraries takes 0.1 s.

    Args:
        samples: of a flight, computed when asked for.
        control_hz: ticks per second.
        clock: the time that is kept to.
        record: is given the timing of every tick, once what is downstream asks for the next sample, or will have no more.

    """
    source = iter(samples)
    with heap_set_aside():
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
    """Sleep through most of the wait and spin through the rest; returns the time then, ns."""
    now = clock.now_ns()
    if (sleep_ns := due_ns - now - clock.spin_ns) > 0:
        clock.sleep(sleep_ns / _NS)
        now = clock.now_ns()
    while now < due_ns:
        now = clock.now_ns()
    return now


@contextmanager
def heap_set_aside() -> Iterator[None]:
    """Let garbage collections pass over all that is there by now: looking through the imported libraries takes long."""
    if gc.get_freeze_count():  # somebody else's business
        yield
        return
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()


def with_timings(trace: Trace, timings: Sequence[int]) -> Trace:
    """Return the trace with columns ``release_late_ms``, ``compute_ms`` and ``slack_ms``.

    Args:
        trace: the flight.
        timings: the numbers of all its Timings, one after the other.

    """
    for name, values in zip(Timing._fields, np.array(timings, dtype=np.float64).reshape(-1, 3).T, strict=True):
        trace = trace.with_column(name.replace("_ns", "_ms"), values / 1e6)
    return trace


@dataclass(frozen=True)
class Spread:
    """Percentiles over the ticks."""

    p50: float
    p95: float
    p99: float
    max: float


@dataclass(frozen=True)
class Punctuality:
    """How well a flight kept pace.

    Attributes:
        ticks: how many there were.
        late_ticks: ticks whose work was not done when the next one was due; late_share: of all ticks.
        worst_overrun_ms: how long after that the worst of them was done; None if none is late.
        jitter_ms: how late ticks began.
        compute_ms: how long they took from there to their sample.
        achieved_hz: ticks per second from the first to the last beginning; None for a single tick.

    """

    ticks: int
    late_ticks: int
    late_share: float
    worst_overrun_ms: float | None
    jitter_ms: Spread
    compute_ms: Spread
    achieved_hz: float | None


def punctuality(trace: Trace, *, control_hz: int) -> Punctuality | None:
    """Return how well a flight kept pace; None for one that was not paced."""
    if "slack_ms" not in trace.columns:
        return None
    slack, released, ticks = trace["slack_ms"], trace["release_late_ms"], len(trace)
    late = int(np.sum(slack < 0.0))
    elapsed_s = (ticks - 1) / control_hz + (released[-1] - released[0]) / 1e3
    return Punctuality(
        ticks=ticks,
        late_ticks=late,
        late_share=late / ticks,
        worst_overrun_ms=float(-np.min(slack)) if late else None,
        jitter_ms=_spread(released),
        compute_ms=_spread(trace["compute_ms"]),
        achieved_hz=float((ticks - 1) / elapsed_s) if ticks > 1 else None,
    )


def _spread(values: npt.NDArray[np.float64]) -> Spread:
    return Spread(*np.percentile(values, (50, 95, 99, 100)).tolist())


class Spell(NamedTuple):
    """Late ticks in a row: flight time of the first, s; how many; how long after its deadline the worst was done, ms."""

    t_s: float
    ticks: int
    worst_overrun_ms: float


def late_spells(trace: Trace) -> list[Spell]:
    """Return when a flight was late, in order of time; nothing for one that was not paced."""
    if "slack_ms" not in trace.columns:
        return []
    late = np.flatnonzero(trace["slack_ms"] < 0.0)
    runs = np.split(late, np.flatnonzero(np.diff(late) > 1) + 1) if late.size else []
    return [Spell(float(trace["t_s"][run[0]]), len(run), float(-np.min(trace["slack_ms"][run]))) for run in runs]
