"""The process that streams a live flight to the viewer: reads ticks from standard input; see ``telemetry/live.py``."""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Iterator

import numpy as np
import rerun as rr

from flightbed.analysis.events import trace_events
from flightbed.analysis.excitation import WINDOW_S, with_excitation
from flightbed.analysis.trace import Trace, Vector, from_rows
from flightbed.core.errors import FlightbedError
from flightbed.telemetry import layout, viewer
from flightbed.telemetry.flight_info import Event, FlightInfo
from flightbed.telemetry.live import FLIGHT, HEADER, HOST, RESULT, ROWS
from flightbed.telemetry.recorder import Recorder
from flightbed.telemetry.recording import APPLICATION

_CHECK_S = 0.5  # interval between checks that the viewer is still reachable
_FLUSH_S = 5.0


def main() -> None:
    """Stream the flight from standard input; end with the flight or with the viewer."""
    host, port = sys.argv[1], int(sys.argv[2])
    messages = _messages()
    kind, content = next(next(messages))
    assert kind == FLIGHT
    _report_readiness(_find_viewer(host, port))
    info = FlightInfo.from_json(content.decode())
    # A second flight of the same scenario needs a recording of its own.
    stream = rr.RecordingStream(APPLICATION, recording_id=f"{info.recording_id}-{time.time_ns():x}")
    stream.connect_grpc(viewer.url(host, port))
    recording = LiveRecording(info, stream)
    checked = time.monotonic()
    for batch in messages:
        rows = b""
        for kind, content in batch:
            if kind == ROWS:
                rows += content
            elif kind == RESULT:
                recording.add(rows)
                rows = b""
                recording.finish(FlightInfo.from_json(content.decode()))
        recording.add(rows)
        if time.monotonic() - checked > _CHECK_S:
            checked = time.monotonic()
            if not viewer.listens(host, port):
                _exit("lost was closed")
    try:
        recording.stream.flush(timeout_sec=_FLUSH_S)
    except Exception:  # RuntimeError or an error of Rerun when the viewer was closed
        _exit("lost was closed")
    # In a thread, because disconnect blocks without limit if the viewer closes at this moment.
    closing = threading.Thread(target=recording.stream.disconnect, daemon=True)
    closing.start()
    closing.join(_FLUSH_S)
    _exit("done")


def _find_viewer(host: str, port: int) -> str:
    """Find or open the viewer; return the message for the flight, "ready" or "lost" and the reason."""
    if viewer.listens(host, port):
        return "ready"
    if host not in (HOST, "localhost"):
        return "lost does not answer"
    if not viewer.has_display():
        return "lost cannot be opened without a display (docs/viewer.md describes a viewer on another computer)"
    try:
        viewer.launch(port, "--expect-data-soon")
    except FlightbedError as error:
        return f"lost cannot be opened: {error}"
    return "ready"


def _report_readiness(message: str) -> None:
    """Send the message to the flight; exit if there is no viewer."""
    if message.startswith("lost"):
        _exit(message)
    rr.Scalars(np.zeros(2))  # the first call takes 0.2 s
    _send(message)


def _exit(message: str) -> None:
    """Send the last message and exit without Rerun's exit handlers, which wait for a closed viewer."""
    try:
        _send(message)
    finally:  # the flight may have closed the pipe
        os._exit(0)


def _send(text: str) -> None:
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


def _messages() -> Iterator[Iterator[tuple[bytes, bytes]]]:
    """Yield the messages received since the last iteration, at least one each time."""
    waiting = b""
    while chunk := os.read(sys.stdin.fileno(), 1 << 20):
        waiting += chunk
        found = []
        while len(waiting) >= HEADER.size:
            kind, length = HEADER.unpack_from(waiting)
            if len(waiting) < HEADER.size + length:
                break
            found.append((kind, waiting[HEADER.size : HEADER.size + length]))
            waiting = waiting[HEADER.size + length :]
        if found:
            yield iter(found)


class LiveRecording:
    """Logs one flight in progress to a stream.

    Args:
        info: description of the flight.
        stream: connected recording stream.

    """

    def __init__(self, info: FlightInfo, stream: rr.RecordingStream) -> None:
        self._info, self.stream = info, stream
        stream.set_log_time_enabled(False)
        self._recorder: Recorder | None = None
        self._logged: set[Event] = set()
        self._kept: Vector = np.zeros(0)  # last rows, needed for events and excitation of the next ones

    def add(self, rows: bytes) -> None:
        """Log further ticks, as packed rows of the trace."""
        if not rows:
            return
        info, values = self._info, np.concatenate([self._kept, np.frombuffer(rows)])
        hz, more = info.control_hz, {"lateral": info.lateral, "load_factor": info.in_g}
        trace = from_rows(values, estimators=info.estimators, control_hz=hz, **more)
        trace = with_excitation(trace, m_delta=info.m_delta, control_hz=hz)
        width = len(values) // len(trace)
        new = len(self._kept) // width
        if self._recorder is None:
            self._recorder = self._begin(trace)
        self._recorder.add(trace, new)
        now = float(trace["t_s"][-1])
        events = [event for event in info.planned if event.t_s <= now + 1e-9]
        events += [Event(*event) for event in trace_events(trace, info.actuators, since=new)]
        self._log(events)
        self._kept = values[-width * (round(WINDOW_S * info.control_hz) + 1) :]

    def finish(self, info: FlightInfo) -> None:
        """Log the outcome of the flight: text summary, events, departure."""
        if self._recorder is None:
            return
        self._recorder.summary_text(info.summary_text)
        self._log(list(info.planned))
        if info.departed:
            self._recorder.departed()

    def _begin(self, trace: Trace) -> Recorder:
        # A filter may have no NIS in its first ticks.
        plots = self._info.plots(trace, certain=[f"{name}.nis" for name in self._info.estimators])
        self.stream.send_blueprint(layout.flight(plots, live=True), make_active=True)
        recorder = Recorder(self.stream, self._info, plots)
        recorder.begin()
        return recorder

    def _log(self, events: list[Event]) -> None:
        assert self._recorder is not None
        self._recorder.events(event for event in events if event not in self._logged)
        self._logged.update(events)


if __name__ == "__main__":
    main()
