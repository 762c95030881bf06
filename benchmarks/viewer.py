"""Cost of the viewer: size and time of recordings, time until a viewer has drawn one, and live flights.

    python benchmarks/viewer.py [--rounds N]

The viewer has no window; it needs a Vulkan driver. Rounds with and without a viewer take turns. Latency is the time from the due time of a
tick until the viewer's store has it; the store is polled, and the polling is included.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from collections import deque
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np

from flightbed import WallClock, load_scenario, run
from flightbed.analysis.result import Result
from flightbed.core.timing import differences, interleaved, seconds, spread
from flightbed.telemetry import viewer
from flightbed.telemetry.flight_info import result_info
from flightbed.telemetry.live import HOST, Live
from flightbed.telemetry.recording import write_recording

_LONG = ["duration_s=600", "command.count=1000", "failures.0.at_s=300", "failures.0.to=0.9"]
_ASK = """
import sys, time
from rerun.experimental import ViewerClient
client = ViewerClient.connect(sys.argv[1])
while True:
    state = client.get_state()
    ends = [t.end for r in state.recordings for t in r.timelines if t.name == "time"]
    print(time.perf_counter_ns(), max(ends, default=-1), flush=True)
"""


class _Clock:
    """The wall clock, and the time of its first reading: the due time of tick 0."""

    spin_ns = WallClock().spin_ns

    def __init__(self) -> None:
        self.began_ns = 0

    def now_ns(self) -> int:
        now = time.perf_counter_ns()
        self.began_ns = self.began_ns or now
        return now

    def sleep(self, seconds: float) -> None:
        time.sleep(seconds)


def recordings() -> None:
    """Print size, writing and opening time of a short and a long flight."""
    with tempfile.TemporaryDirectory() as folder, viewer.headless() as client:
        for name, overrides in (("16.5 s", []), ("10 min", _LONG)):
            result, path = run(load_scenario("elevator-loss", overrides)), Path(folder) / f"{len(overrides)}.rrd"
            _record(result, path)  # what the first one imports is not its cost
            times = [seconds(partial(_record, result, path)) for _ in range(5)]
            began = time.perf_counter()
            client.open(str(path))
            opened = time.perf_counter() - began
            client.take_screenshot(max_size=100)
            drawn = time.perf_counter() - began
            print(
                f"{name}: {path.stat().st_size / 1e6:.2f} MB, written in {spread(times, '.3f')} s, {len(times)} times, "
                f"opened in {opened:.2f} s, drawn after {drawn:.2f} s"
            )


def _record(result: Result, path: Path) -> None:
    write_recording(path, result.trace, result_info(result))


def handing_over() -> None:
    """Print the cost of a tick for the loop, beyond the iteration over the samples."""
    from flightbed.runs.run import fly

    samples = list(fly(load_scenario("elevator-loss")))
    live = Live()  # not started: what is handed over waits in the queue
    ways = {
        "plain": lambda: seconds(lambda: deque(iter(samples), maxlen=0)),
        "watched": lambda: seconds(lambda: deque(live.forward(iter(samples)), maxlen=0)),
    }
    times = interleaved(ways, 15)
    cost = [1e6 * t / len(samples) for t in differences(times["watched"], times["plain"])]
    print(f"cost of a tick to the loop: {spread(cost, '.2f')} us, {len(cost)} rounds")


def _busy_ms(result: Result) -> np.ndarray:
    """Return the busy time of the loop in each tick, the work for the viewer included."""
    trace = result.trace
    return 10.0 - trace["slack_ms"] - trace["release_late_ms"]


def flights(rounds: int) -> None:
    """Print late ticks, busy time and latency of paced flights with and without a viewer."""
    scenario = load_scenario("elevator-loss")
    run(scenario)  # loads what is compiled
    for number in range(rounds):
        _tell("without", run(scenario, pace=WallClock()))
        port = viewer.free_port()
        with viewer.headless(port):
            _tell("with a viewer", run(scenario, pace=WallClock(), live=Live(port=port, notify=print)))
        # A fresh viewer: of the flight before, this one has all ticks.
        with viewer.headless(port), tempfile.TemporaryFile("w+") as answered:
            command = [sys.executable, "-c", _ASK, viewer.url(HOST, port)]
            asking = subprocess.Popen(command, stdout=answered)
            clock = _Clock()
            result = run(scenario, pace=clock, live=Live(port=port, notify=print))
            time.sleep(1.0)
            asking.kill()
            asking.wait()
            answered.seek(0)
            answers = [tuple(map(int, line.split())) for line in answered]
        _tell("with a viewer that is asked all the time", result)
        print(f"  latency: {_latency(answers, clock.began_ns, result)} (round {number + 1} of {rounds})")


def _latency(answers: list[tuple[int, ...]], began_ns: int, result: Result) -> str:
    asked = [answer for answer in answers if len(answer) == 2 and answer[0] >= began_ns]
    at, end = np.array(asked).T
    due = result.trace["t_s"] * 1e9
    found = np.searchsorted(np.maximum.accumulate(end), due - 0.5)
    seen = found < len(at)
    late = (at[found[seen]] - began_ns - due[seen]) / 1e6
    gaps = [b - a for a, b in pairwise(at)]
    p50, p95 = np.percentile(late, (50, 95))
    return f"p50 {p50:.0f}, p95 {p95:.0f} ms over {seen.sum()} ticks, asked every {np.median(gaps) / 1e6:.0f} ms"


def _tell(name: str, result: Result) -> None:
    kept, busy = result.summary.realtime, _busy_ms(result)
    assert kept is not None
    worst = "" if kept.worst_overrun_ms is None else f", worst by {kept.worst_overrun_ms:.1f} ms"
    print(
        f"{name}: {kept.late_ticks} of {kept.ticks} ticks late{worst}; "
        f"busy p50 {np.median(busy):.2f}, p99 {np.percentile(busy, 99):.2f} ms"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=3)
    rounds = parser.parse_args().rounds
    recordings()
    handing_over()
    flights(rounds)


if __name__ == "__main__":
    main()
