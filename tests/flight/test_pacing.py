"""Pacing on a simulated clock, exact to the nanosecond; on the wall clock only properties that timing noise cannot break."""

from __future__ import annotations

import gc
import json
import os
import subprocess
import sys
from array import array
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flightbed.analysis.events import events
from flightbed.analysis.punctuality import Spell, late_spells, punctuality, with_timings
from flightbed.analysis.summary_text import pace_text, run_text
from flightbed.analysis.trace import Trace, read_trace
from flightbed.config import families
from flightbed.config.kinds import ESTIMATORS
from flightbed.flight.pacing import Timing, WallClock, paced
from flightbed.runs.run import run
from flightbed.scenario.reading import load_scenario
from tests.command_line import call

MS = 1_000_000  # ns
CLOCK_COLUMNS = {"release_late_ms", "compute_ms", "slack_ms"}


@dataclass
class HandClock:
    """Simulated clock: sleep and work advance the time, each reading adds ``reading_ns``, and sleeps overshoot by a given time."""

    time_ns: int = 5_000_000_123
    spin_ns: int = 0
    reading_ns: int = 0
    overshoots_ns: list[int] = field(default_factory=list)
    sleeps_ns: list[tuple[int, int]] = field(default_factory=list)

    def now_ns(self) -> int:
        self.time_ns += self.reading_ns
        return self.time_ns

    def sleep(self, seconds: float) -> None:
        self.sleeps_ns.append((self.time_ns, round(seconds * 1e9)))
        self.time_ns += round(seconds * 1e9) + (self.overshoots_ns.pop(0) if self.overshoots_ns else 0)


def _fly(
    clock: HandClock, *, hz: int, work_ns: Sequence[int], downstream_ns: Sequence[int] = ()
) -> tuple[list[Timing], list[int]]:
    """Pace work of given lengths; return the timings and the request time of each tick."""
    timings: list[Timing] = []
    asked: list[int] = []

    def work() -> Iterator[int]:
        for tick, ns in enumerate(work_ns):
            asked.append(clock.time_ns)
            clock.time_ns += ns
            yield tick

    for tick in paced(work(), control_hz=hz, clock=clock, record=timings.append):
        assert tick == len(timings)
        clock.time_ns += downstream_ns[tick] if downstream_ns else 0
    return timings, asked


@pytest.mark.parametrize("hz", [100, 30, 7])
def test_ticks_keep_to_an_absolute_schedule(hz: int) -> None:
    """The request of tick k is at k/hz, rounded down to a nanosecond, also for a period that is not a whole number of nanoseconds."""
    clock = HandClock()
    start = clock.time_ns
    timings, asked = _fly(clock, hz=hz, work_ns=[MS] * 1000)
    assert asked == [start + k * 10**9 // hz for k in range(1000)]
    assert {t.release_late_ns for t in timings} == {0}
    assert {t.compute_ns for t in timings} == {MS}
    assert clock.time_ns == start + 1000 * 10**9 // hz  # the last period is included


def test_ticks_catch_up_after_a_slow_one_and_late_ticks_are_counted() -> None:
    work = [MS, MS, 25 * MS, MS, MS, MS]
    timings, _ = _fly(HandClock(), hz=100, work_ns=work)
    assert [t.release_late_ns // MS for t in timings] == [0, 0, 0, 15, 6, 0]
    assert [t.slack_ns // MS for t in timings] == [9, 9, -15, -6, 3, 9]
    assert [t.compute_ns for t in timings] == work


def test_a_sleep_that_ends_late_makes_the_tick_begin_late() -> None:
    timings, _ = _fly(HandClock(overshoots_ns=[0, 4 * MS, 12 * MS]), hz=100, work_ns=[MS] * 5)
    assert [t.release_late_ns // MS for t in timings] == [0, 0, 4, 12, 3]
    assert [t.slack_ns // MS for t in timings] == [9, 9, 5, -3, 6]


def test_work_downstream_belongs_to_its_tick() -> None:
    timings, _ = _fly(HandClock(), hz=100, work_ns=[MS] * 4, downstream_ns=[0, 10 * MS, 0, 11 * MS])
    assert [t.compute_ns for t in timings] == [MS] * 4
    assert [t.slack_ns // MS for t in timings] == [9, -1, 8, -2]
    assert [t.release_late_ns // MS for t in timings] == [0, 0, 1, 0]


def test_a_tick_that_ends_exactly_at_the_deadline_is_not_late() -> None:
    timings, _ = _fly(HandClock(), hz=100, work_ns=[10 * MS, 10 * MS + 1])
    assert [t.slack_ns for t in timings] == [0, -1]


def test_a_wait_sleeps_and_then_polls_the_clock() -> None:
    clock = HandClock(spin_ns=300_000, reading_ns=1000)
    start = clock.time_ns + clock.reading_ns
    timings, asked = _fly(clock, hz=100, work_ns=[MS] * 20)
    assert [began + slept for began, slept in clock.sleeps_ns] == [start + k * 10 * MS - 300_000 for k in range(1, 21)]
    assert [a - start - k * 10 * MS for k, a in enumerate(asked)] == [t.release_late_ns for t in timings]
    assert all(0 <= t.release_late_ns <= 1000 for t in timings)  # at most one reading of the clock late


periods = st.lists(st.tuples(st.integers(0, 30 * MS), st.integers(0, 30 * MS)), min_size=1, max_size=40)


@given(periods)
def test_a_tick_begins_when_due_or_when_the_previous_one_ends(ticks: list[tuple[int, int]]) -> None:
    """Lindley's recursion of a queue with arrivals every 10 ms: lateness+ = max(0, lateness + work - period)."""
    work, downstream = zip(*ticks, strict=True)
    timings, _ = _fly(HandClock(), hz=100, work_ns=work, downstream_ns=downstream)
    lateness = 0
    for timing, computing, after in zip(timings, work, downstream, strict=True):
        assert timing == (lateness, computing, 10 * MS - lateness - computing - after)
        lateness = max(0, lateness + computing + after - 10 * MS)


def test_closing_the_generator_ends_the_flight_and_times_its_last_tick() -> None:
    closed: list[bool] = []

    def samples() -> Iterator[int]:
        try:
            yield from range(10)
        finally:
            closed.append(True)

    timings: list[Timing] = []
    frozen = gc.get_freeze_count()
    flight = paced(samples(), control_hz=100, clock=HandClock(), record=timings.append)
    assert [next(flight), next(flight)] == [0, 1]
    assert gc.get_freeze_count() > frozen
    flight.close()
    del flight
    assert closed == [True]
    assert len(timings) == 2
    assert gc.get_freeze_count() == frozen


def test_exceptions_of_the_flight_propagate_and_the_heap_is_unfrozen() -> None:
    def samples() -> Iterator[int]:
        yield 0
        raise KeyboardInterrupt

    frozen, timings = gc.get_freeze_count(), array("q")
    with pytest.raises(KeyboardInterrupt):
        list(paced(samples(), control_hz=100, clock=HandClock(), record=timings.extend))
    assert gc.get_freeze_count() == frozen
    assert timings.tolist() == [0, 0, 10 * MS]


def test_a_heap_frozen_by_the_caller_stays_frozen() -> None:
    gc.freeze()
    try:
        list(paced(range(3), control_hz=100, clock=HandClock(), record=lambda _: None))
        assert gc.get_freeze_count() > 0
    finally:
        gc.unfreeze()


def _trace(timings: Sequence[Timing]) -> Trace:
    flat = [ns for timing in timings for ns in timing]
    return with_timings(Trace({"t_s": np.arange(len(timings)) / 100}, ()), flat)


def test_the_performance_of_a_flight_summarizes_its_ticks() -> None:
    late = {10: -2 * MS, 11: -1 * MS, 40: -5 * MS}
    timings = [Timing(k * 1000, MS + k * 1000, late.get(k, 8 * MS)) for k in range(101)]
    kept = punctuality(_trace(timings), control_hz=100)
    assert kept is not None
    assert (kept.ticks, kept.late_ticks, kept.late_share, kept.worst_overrun_ms) == (101, 3, 3 / 101, 5.0)
    assert asdict(kept.jitter_ms) == pytest.approx({"p50": 0.05, "p95": 0.095, "p99": 0.099, "max": 0.1})
    assert asdict(kept.compute_ms) == pytest.approx({"p50": 1.05, "p95": 1.095, "p99": 1.099, "max": 1.1})
    assert kept.achieved_hz == pytest.approx(100 / 1.0001)
    assert late_spells(_trace(timings)) == [Spell(0.1, 2, 2.0), Spell(0.4, 1, 5.0)]


def test_one_tick_has_no_rate_and_no_late_tick_has_no_overrun() -> None:
    kept = punctuality(_trace([Timing(0, MS, MS)]), control_hz=100)
    assert kept is not None
    assert (kept.ticks, kept.late_ticks, kept.worst_overrun_ms, kept.achieved_hz) == (1, 0, None, None)
    assert late_spells(_trace([Timing(0, MS, MS)])) == []


class _Busy(HandClock):
    """A clock for real flights at 100 Hz that does not count their work; the sleep before tick 50, 150, ... ends 22 ms late."""

    def sleep(self, seconds: float) -> None:
        super().sleep(seconds)
        tick = (self.time_ns - HandClock.time_ns) // (10 * MS)
        self.time_ns += 22 * MS if tick % 100 == 50 else 0


def test_pacing_changes_nothing_but_adds_its_columns(tmp_path: Path) -> None:
    scenario = load_scenario("elevator-loss", ["duration_s=6"])
    free, held = run(scenario), run(scenario, tmp_path / "held", pace=_Busy())
    assert held.folder is not None
    assert set(held.trace.columns) - set(free.trace.columns) == CLOCK_COLUMNS
    for column in free.trace.columns:
        assert free.trace[column].tobytes() == held.trace[column].tobytes(), column
    assert free.summary.realtime is None
    written = read_trace(held.folder / "trace.parquet")
    assert all(np.array_equal(written[column], held.trace[column]) for column in CLOCK_COLUMNS)
    kept = json.loads((held.folder / "metrics.json").read_text())["realtime"]
    assert held.summary.realtime is not None
    assert kept == asdict(held.summary.realtime)
    assert (kept["ticks"], kept["late_ticks"], kept["worst_overrun_ms"]) == (600, 12, 12.0)  # 12 ms late, then 2 ms


def test_the_unit_of_the_columns_is_known(tmp_path: Path) -> None:
    import pyarrow.parquet as pq

    _trace([Timing(0, MS, MS)]).write(tmp_path / "trace.parquet")
    fields = {f.name: f.metadata[b"unit"] for f in pq.read_schema(tmp_path / "trace.parquet")}
    assert {name: fields[name] for name in CLOCK_COLUMNS} == dict.fromkeys(CLOCK_COLUMNS, b"ms")


@pytest.mark.parametrize(
    ("seconds", "expected"),
    [
        (6, [(second + 0.5, "2 ticks late, by up to 12 ms") for second in range(6)]),
        (12, [(0.5, "24 ticks late in 12 spells, here the worst, by 12 ms")]),
    ],
)
def test_late_ticks_are_events_and_many_are_one(seconds: int, expected: list[tuple[float, str]]) -> None:
    result = run(load_scenario("nominal", [f"duration_s={seconds}"]), pace=_Busy())
    happened = events(result.plan.scenario, result.trace, result.summary, result.plan.actuators)
    assert [(t, text) for t, text, _ in happened if "late" in text] == expected
    kept = result.summary.realtime
    assert kept is not None
    assert pace_text(kept, seconds) == (
        f"{100 * seconds} ticks at 100 Hz: {2 * seconds} late (2.00%), worst by 12 ms; "
        "jitter p95 0, max 22 ms; compute p50 0, p99 0 ms"
    )
    assert f"- real time: {pace_text(kept, seconds)}\n" in run_text(result.plan.scenario, result.summary)


def test_on_the_wall_clock_no_tick_begins_early_and_a_flight_takes_its_time(tmp_path: Path) -> None:
    result = run(load_scenario("nominal", ["duration_s=0.5"]), pace=WallClock())
    assert result.trace["release_late_ms"].min() >= 0.0
    assert result.trace["compute_ms"].min() > 0.0
    assert result.summary.wall_time_s >= 0.5
    assert result.summary.realtime is not None
    assert (result.summary.realtime.achieved_hz or 0.0) > 0.0


def test_the_command_line_prints_the_real_time_performance(tmp_path: Path) -> None:
    short = ["run", "nominal", "--set", "duration_s=0.3", "--rerun", "off", "--realtime", "--out", "x"]
    done = call(*short, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "real time 30 ticks at 100 Hz: " in done.stdout
    kept = json.loads(call(*short, "--json", cwd=tmp_path).stdout)["realtime"]
    assert kept["ticks"] == 30
    assert "real time" not in call(*(a for a in short if a != "--realtime"), cwd=tmp_path).stdout


KINDS = [(kind, "") for kind in families.names("estimators")]
KINDS += [(kind, ',unknown="gust"') for kind in ESTIMATORS.have(("unknown",))]
COMPILING = """
import json, os, pkgutil, sys, traceback
from importlib import import_module

import flightbed
from flightbed import avionics, estimation
from flightbed.flight.assembly import assemble
from flightbed.flight.loop import fly
from flightbed.flight.plan import plan

NAMES = [m.name for p in (avionics, estimation) for m in pkgutil.walk_packages(p.__path__, p.__name__ + ".")]
MODULES = [import_module(name) for name in NAMES]


def compiled():
    made = {f"{m.__name__}.{n}": len(f.signatures) for m in MODULES for n, f in vars(m).items() if hasattr(f, "signatures")}
    assert len(made) > 20
    return made


def check(kind, more):
    table = 'estimators=[{name="scheduled",kind="' + kind + '"' + more + "}]"
    flight = assemble(plan(flightbed.load_scenario("nominal", ["duration_s=0.8", "adaptation.enabled=false", table])))
    before = compiled()
    assert len(list(fly(flight))) == 80
    assert compiled() == before, (before, compiled())


assert set(compiled().values()) == {0}
codes = []
for kind, more in json.loads(sys.argv[1]):
    child = os.fork()
    if child == 0:
        try:
            check(kind, more)
        except BaseException:
            traceback.print_exc()
            os._exit(1)
        os._exit(0)
    codes.append(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
print(json.dumps(codes))
"""


def test_nothing_is_compiled_in_flight() -> None:
    """Each estimator in a process where no other has compiled anything: a first compilation takes seconds."""
    environment = {key: value for key, value in os.environ.items() if key != "FLIGHTBED_PLAIN"}
    command = [sys.executable, "-c", COMPILING, json.dumps(KINDS)]
    done = subprocess.run(command, check=False, capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stderr
    codes = dict(zip(map("".join, KINDS), json.loads(done.stdout), strict=True))
    assert codes == dict.fromkeys(codes, 0), done.stderr
