"""Live flights: the viewer receives them, and problems of the viewer do not change them."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flightbed.analysis.result import Result
from flightbed.analysis.trace import from_rows
from flightbed.core.errors import InputError
from flightbed.flight.pacing import WallClock
from flightbed.runs.run import run
from flightbed.scenario.reading import Scenario, load_scenario
from flightbed.telemetry import live as live_module
from flightbed.telemetry import viewer
from flightbed.telemetry.flight_info import FlightInfo
from flightbed.telemetry.live import Live, address
from tests.command_line import COMMAND, assert_one_clear_line, call, heed_interrupts
from tests.lateral_flight import NAMES, SOON, rolling
from tests.telemetry.viewers import needs_viewer

SHORT = ["duration_s=3", "failures.0.at_s=1"]


@pytest.fixture
def short() -> Scenario:
    return load_scenario("elevator-loss", SHORT)


def _whole(result: Result) -> None:
    assert result.folder is not None
    assert {"flight.rrd", "metrics.json", "scenario.toml", "trace.parquet"} <= {p.name for p in result.folder.iterdir()}
    assert len(result.trace) == 300
    done = subprocess.run([viewer.executable(), "rrd", "verify", str(result.folder / "flight.rrd")], check=False)
    assert done.returncode == 0


def _same_flight(result: Result, scenario: Scenario) -> None:
    alone = run(scenario).trace
    for name in alone.columns:
        np.testing.assert_array_equal(result.trace[name], alone[name], err_msg=name)


def _latest(client: Any) -> int:
    recordings = client.get_state().recordings
    return max((t.end for r in recordings for t in r.timelines if t.name == "time"), default=-1)


@needs_viewer
def test_the_viewer_sees_the_whole_flight(short: Scenario, tmp_path: Path) -> None:
    said: list[str] = []
    port = viewer.free_port()
    with viewer.headless(port) as client:
        result = run(short, tmp_path / "run", live=Live(port=port, notify=said.append))
        assert said == []
        until = time.monotonic() + 10.0
        while _latest(client) < 2_990_000_000 and time.monotonic() < until:
            time.sleep(0.1)
        assert _latest(client) == 2_990_000_000
        client.take_screenshot()
        views = client.get_state().views
        assert len(views) == 19
        assert [view.reports for view in views] == [[]] * len(views)
        assert [entry for entry in client.get_logs() if entry.level == "ERROR"] == []
    _whole(result)
    _same_flight(result, short)


@pytest.mark.parametrize("in_g", [False, True])
def test_rows_of_other_axes_are_handed_on_whole(monkeypatch: pytest.MonkeyPatch, in_g: bool) -> None:
    """The streaming process receives the complete flight, with aileron and rudder, or with the load factor."""
    handed: list[tuple[bytes, bytes]] = []
    live = Live()
    monkeypatch.setattr(live, "_put", lambda kind, content: handed.append((kind, content)))
    monkeypatch.setattr(live, "start", lambda info: handed.append((live_module.FLIGHT, info.to_json().encode())))
    scenario = (
        load_scenario("cg-shift", ["duration_s=3", "command.start_s=1", "failures.0.at_s=2"]) if in_g else rolling(SOON)
    )
    result = run(scenario, live=live)
    (info,) = (FlightInfo.from_json(content.decode()) for kind, content in handed if kind == live_module.FLIGHT)
    assert (info.lateral, info.in_g) == (not in_g, in_g)
    assert info.estimators == (() if in_g else NAMES)
    rows = np.frombuffer(b"".join(content for kind, content in handed if kind == live_module.ROWS))
    more = {"lateral": info.lateral, "load_factor": info.in_g}
    shown = from_rows(rows, estimators=info.estimators, control_hz=info.control_hz, **more)
    assert set(shown.columns) <= set(result.trace.columns)
    assert ("nz_ref_g" in shown.columns) == in_g
    for name in shown.columns:
        np.testing.assert_array_equal(shown[name], result.trace[name], err_msg=name)


@pytest.mark.long  # the page from a recording, and the rows that are handed on, are tested in `make test`
@needs_viewer
def test_a_live_viewer_has_the_page_of_roll_and_yaw(tmp_path: Path) -> None:
    said: list[str] = []
    port = viewer.free_port()
    with viewer.headless(port) as client:
        result = run(rolling(SOON), tmp_path / "run", live=Live(port=port, notify=said.append))
        until = time.monotonic() + 10.0
        while _latest(client) < 2_990_000_000 and time.monotonic() < until:
            time.sleep(0.1)
        viewer.show_tab(client, "Roll and yaw")
        client.take_screenshot()
        views = client.get_state().views
        assert {"/roll_rate", "/sideslip", "/effectiveness_rudder"} <= {view.origin for view in views}
        assert [view.reports for view in views] == [[]] * len(views)
        assert [entry for entry in client.get_logs() if entry.level == "ERROR"] == []
    assert said == []
    _whole(result)


class _Calling:
    """The wall clock; calls a function once, a time in s after its first reading, that is in flight."""

    spin_ns = WallClock().spin_ns

    def __init__(self, after_s: float, call: Callable[[], object]) -> None:
        self._after_ns, self._calls, self._start_ns = round(after_s * 1e9), [call], 0

    def now_ns(self) -> int:
        now = time.perf_counter_ns()
        self._start_ns = self._start_ns or now
        if self._calls and now - self._start_ns >= self._after_ns:
            self._calls.pop()()
        return now

    def sleep(self, seconds: float) -> None:
        time.sleep(seconds)


@needs_viewer
def test_a_viewer_killed_in_flight_stops_nothing_and_is_reported_once(tmp_path: Path) -> None:
    said: list[str] = []
    port = viewer.free_port()
    process = viewer.launch(port, "--headless")
    began = time.monotonic()
    scenario = load_scenario("elevator-loss", ["duration_s=4", "failures.0.at_s=1"])
    live = Live(port=port, notify=said.append)
    result = run(scenario, tmp_path / "run", pace=_Calling(0.5, process.kill), live=live)
    process.wait()
    assert said == [f"the viewer at 127.0.0.1:{port} was closed; the flight continues without it"]
    assert len(result.trace) == 400
    assert time.monotonic() - began < 4.0 + 12.0
    _same_flight(result, scenario)


def test_without_a_callback_it_warns(short: Scenario) -> None:
    with pytest.warns(UserWarning, match="does not answer; the flight continues without it") as caught:
        run(short, live=Live("127.0.0.2", viewer.free_port()))
    assert len(caught) == 1


def test_no_viewer_and_no_display_is_reported_once(
    short: Scenario, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    said: list[str] = []
    port = viewer.free_port()
    result = run(short, tmp_path / "run", live=Live(port=port, notify=said.append))
    assert len(said) == 1
    assert said[0].startswith(f"the viewer at 127.0.0.1:{port} cannot be opened without a display")
    _whole(result)
    _same_flight(result, short)


def test_a_viewer_elsewhere_that_does_not_answer_is_reported_once(short: Scenario) -> None:
    said: list[str] = []
    port = viewer.free_port()
    result = run(short, live=Live("127.0.0.2", port, said.append))  # not the address at which one would be opened
    assert said == [f"the viewer at 127.0.0.2:{port} does not answer; the flight continues without it"]
    assert len(result.trace) == 300


def test_a_viewer_that_takes_nothing_holds_nothing_up(
    short: Scenario, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A hung viewer: it accepts connections and never reads."""
    monkeypatch.setattr(live_module, "_CLOSING_S", 0.5)
    said: list[str] = []
    with socket.create_server(("127.0.0.1", 0), backlog=50) as server:
        live = Live(port=server.getsockname()[1], notify=said.append)
        result = run(short, tmp_path / "run", pace=WallClock(), live=live)
    assert said == [
        f"the viewer at 127.0.0.1:{live.port} did not take the whole flight within 0.5 s; the flight is complete and written"
    ]
    assert result.summary.realtime is not None
    assert result.summary.realtime.achieved_hz == pytest.approx(100.0, rel=0.05)
    _whole(result)
    _same_flight(result, short)


def test_a_dying_process_between_flight_and_viewer_stops_nothing(short: Scenario, tmp_path: Path) -> None:
    said: list[str] = []
    with socket.create_server(("127.0.0.1", 0), backlog=50) as server:
        live = Live(port=server.getsockname()[1], notify=said.append)

        def kill() -> None:
            assert live._process is not None
            os.kill(live._process.pid, signal.SIGKILL)

        result = run(short, tmp_path / "run", pace=_Calling(0.5, kill), live=live)
    assert len(said) == 1
    assert "was lost" in said[0] or "did not answer" in said[0]
    _whole(result)
    _same_flight(result, short)


def test_an_interrupt_while_the_viewer_opens_leaves_no_process(
    short: Scenario, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(_timeout: float) -> bool:
        raise KeyboardInterrupt

    with socket.create_server(("127.0.0.1", 0), backlog=50) as server:
        live = Live(port=server.getsockname()[1])
        monkeypatch.setattr(live._answered, "wait", interrupted)
        with pytest.raises(KeyboardInterrupt):
            run(short, live=live)
    assert live._process is not None
    assert live._process.poll() is not None


def test_an_interrupt_of_a_flight_that_is_written_only_lets_the_viewer_go(
    short: Scenario, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    said: list[str] = []
    with socket.create_server(("127.0.0.1", 0), backlog=50) as server:
        live = Live(port=server.getsockname()[1], notify=said.append)
        finish = live.finish

        def finished(flown: Any) -> None:
            finish(flown)
            assert live._process is not None
            wait = live._process.wait

            def once(timeout: float | None = None) -> int:
                monkeypatch.setattr(live._process, "wait", wait)
                raise KeyboardInterrupt

            monkeypatch.setattr(live._process, "wait", once)

        monkeypatch.setattr(live, "finish", finished)
        result = run(short, tmp_path / "run", live=live)
    _whole(result)
    assert said == [
        f"the viewer at 127.0.0.1:{live.port} did not take the whole flight before the interrupt; the flight is complete and written"
    ]
    assert live._process is not None
    assert live._process.poll() is not None


def test_an_interrupt_while_a_viewer_starts_leaves_none(monkeypatch: pytest.MonkeyPatch) -> None:
    started: list[subprocess.Popen[bytes]] = []
    popen = subprocess.Popen

    def remembered(command: list[str], **options: Any) -> subprocess.Popen[bytes]:
        started.append(popen([sys.executable, "-c", "import time; time.sleep(60)"], **options))
        return started[0]

    def interrupted(_host: str, _port: int) -> bool:
        raise KeyboardInterrupt

    monkeypatch.setattr(viewer.subprocess, "Popen", remembered)
    monkeypatch.setattr(viewer, "listens", interrupted)
    with pytest.raises(KeyboardInterrupt):
        viewer.launch(1)
    assert started[0].poll() is not None


def test_live_runs_nothing_from_the_folder_one_is_in(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    for name in ("rerun", "random", "numpy"):
        (tmp_path / f"{name}.py").write_text("open('ran', 'w').close()")
    command = [
        Path(sys.executable).with_name("flightbed"),
        "run",
        "nominal",
        "--set",
        "duration_s=0.2",
        "--rerun",
        "live",
        "--out",
        "x",
    ]
    done = subprocess.run(
        [*command, "--viewer", f"127.0.0.1:{viewer.free_port()}"], cwd=tmp_path, check=False, capture_output=True
    )
    assert done.returncode == 0, done.stderr
    assert not (tmp_path / "ran").exists()
    assert b"cannot be opened without a display" in done.stderr  # it got as far as looking for a viewer


def test_what_does_not_fit_is_dropped_and_reported_once(monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[str] = []
    live = Live(notify=said.append)
    for _ in range(live_module._QUEUE + 10):
        live._put(live_module.ROWS, b"x")
    assert len(said) == 1
    assert "does not keep up" in said[0]


def test_an_interrupted_live_flight_ends_at_once_and_leaves_nothing(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0), backlog=50) as server:  # hangs
        where = f"127.0.0.1:{server.getsockname()[1]}"
        command = [*COMMAND, "run", "elevator-loss", "--realtime", "--rerun", "live", "--viewer", where, "--out", "x"]
        process = subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True, preexec_fn=heed_interrupts)
        server.settimeout(60.0)
        with server.accept()[0]:  # by the command, before the flight; it starts the process that sends the flight
            time.sleep(1.5)
            assert process.poll() is None
            process.send_signal(signal.SIGINT)
        began = time.monotonic()
        _, said = process.communicate(timeout=20.0)
    assert process.returncode == 130
    assert time.monotonic() - began < 8.0
    assert said == "flightbed: interrupted; nothing was written\n"
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("text", ["host", ":9876", "host:", "host:port", "host:0", "host:70000", "host:²"])
def test_an_address_that_is_none_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="--viewer .*: must be HOST:PORT"):
        address(text)


def test_addresses() -> None:
    assert address(None) == ("127.0.0.1", 9876)
    assert address("there:1234") == ("there", 1234)
    assert address("[::1]:1234") == ("::1", 1234)
    assert viewer.url("::1", 1234) == "rerun+http://[::1]:1234/proxy"


def test_the_command_line_says_it_once_and_ends_well(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    port = viewer.free_port()
    arguments = ["--set", "duration_s=1", "--set", "failures.0.at_s=0.5", "--out", "x", "--json"]
    done = call("run", "elevator-loss", *arguments, "--rerun", "live", "--viewer", f"127.0.0.1:{port}", cwd=tmp_path)
    assert done.returncode == 0
    assert done.stderr.startswith("flightbed: the viewer at 127.0.0.1:")
    assert len(done.stderr.splitlines()) == 1
    assert (tmp_path / "x" / "flight.rrd").is_file()


def test_a_viewer_without_live_is_refused(tmp_path: Path) -> None:
    arguments = ["run", "nominal", "--viewer", "127.0.0.1:9876"]
    assert_one_clear_line(arguments, 2, "--viewer 127.0.0.1:9876: has no effect without --rerun live", cwd=tmp_path)
