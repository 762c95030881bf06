"""Real-time performance of a paced flight: late ticks, jitter, computing time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from flightbed.analysis.trace import Trace
from flightbed.flight.pacing import Timing


def with_timings(trace: Trace, timings: Sequence[int]) -> Trace:
    """Return the trace with columns ``release_late_ms``, ``compute_ms`` and ``slack_ms``.

    Args:
        trace: the flight.
        timings: the fields of the Timings of all ticks, one after the other, ns.

    """
    for name, values in zip(Timing._fields, np.array(timings, dtype=np.float64).reshape(-1, 3).T, strict=True):
        trace = trace.with_column(name.replace("_ns", "_ms"), values / 1e6)
    return trace


@dataclass(frozen=True)
class Spread:
    """Percentiles over the ticks of a flight, ms."""

    p50: float
    p95: float
    p99: float
    max: float


@dataclass(frozen=True)
class Punctuality:
    """Real-time performance of a flight.

    Attributes:
        ticks: number of ticks.
        late_ticks: number of ticks whose work was not done when the next one was due.
        late_share: late ticks over all ticks.
        worst_overrun_ms: largest delay of the end of a late tick after its deadline; None if no tick is late.
        jitter_ms: percentiles of the delay of the start of a tick.
        compute_ms: percentiles of the time from the start of a tick to its sample.
        achieved_hz: ticks per second from the first to the last start; None for a single tick.

    """

    ticks: int
    late_ticks: int
    late_share: float
    worst_overrun_ms: float | None
    jitter_ms: Spread
    compute_ms: Spread
    achieved_hz: float | None


def punctuality(trace: Trace, *, control_hz: int) -> Punctuality | None:
    """Return the real-time performance of a flight; None for a flight without timings."""
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
    """Consecutive late ticks: flight time of the first, s; number of ticks; largest delay of an end after its deadline, ms."""

    t_s: float
    ticks: int
    worst_overrun_ms: float


def late_spells(trace: Trace) -> list[Spell]:
    """Return the spells of late ticks in order of time; an empty list for a flight without timings."""
    if "slack_ms" not in trace.columns:
        return []
    late = np.flatnonzero(trace["slack_ms"] < 0.0)
    runs = np.split(late, np.flatnonzero(np.diff(late) > 1) + 1) if late.size else []
    return [Spell(float(trace["t_s"][run[0]]), len(run), float(-np.min(trace["slack_ms"][run]))) for run in runs]
