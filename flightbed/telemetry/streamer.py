"""The process that shows a flight live: takes its ticks from standard input, tells the viewer; see ``live.py``."""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Iterator

import numpy as np
import rerun as rr

from flightbed.errors import FlightbedError
from flightbed.event_log import seen_events
from flightbed.excitation import WINDOW_S, with_excitation
from flightbed.live import FLIGHT, HEADER, HOST, RESULT, ROWS
from flightbed.telemetry import layout, viewer
from flightbed.telemetry.recorder import Recorder
from flightbed.telemetry.recording import APPLICATION
from flightbed.telemetry.shown import Event, Shown
from flightbed.trace import Trace, Vector, from_rows

_LOOK_S = 0.5  # between looks whether the viewer is still there
_FLUSH_S = 5.0


def main() -> None:
    """Show the flight that comes in; ends with it, or with the viewer."""
    host, port = sys.argv[1], int(sys.argv[2])
    messages = _messages()
    kind, content = next(next(messages))
    assert kind == FLIGHT
    _tell(_opened(host, port))
    shown = Shown.from_json(content.decode())
    # A second flight of the same scenario is another recording.
    stream = rr.RecordingStream(APPLICATION, recording_id=f"{shown.recording_id}-{time.time_ns():x}")
    stream.connect_grpc(viewer.url(host, port))
    show = Show(shown, stream)
    looked = time.monotonic()
    for batch in messages:
        rows = b""
        for kind, content in batch:
            if kind == ROWS:
                rows += content
            elif kind == RESULT:
                show.add(rows)
                rows = b""
                show.result(Shown.from_json(content.decode()))
        show.add(rows)
        if time.monotonic() - looked > _LOOK_S:
            looked = time.monotonic()
            if not viewer.listens(host, port):
                _end("lost is gone")
    try:
        show.stream.flush(timeout_sec=_FLUSH_S)
    except Exception:  # it says RuntimeError or its own error when the viewer is gone
        _end("lost is gone")
    # In a thread, because it waits for ever for a viewer that goes just now.
    parting = threading.Thread(target=show.stream.disconnect, daemon=True)
    parting.start()
    parting.join(_FLUSH_S)
    _end("done")


def _opened(host: str, port: int) -> str:
    """Find the viewer, or open one; returns what to tell the flight."""
    if viewer.listens(host, port):
        return "ready"
    if host not in (HOST, "localhost"):
        return "lost does not answer"
    if not viewer.has_display():
        return "lost is not there, and there is no display to open one on (docs/viewer.md: a viewer elsewhere)"
    try:
        viewer.launch(port, "--expect-data-soon")
    except FlightbedError as error:
        return f"lost is not there: {error}"
    return "ready"


def _tell(text: str) -> None:
    if text.startswith("lost"):
        _end(text)
    rr.Scalars(np.zeros(2))  # the first one costs 0.2 s
    _say(text)


def _end(text: str) -> None:
    """Say the last word and go, without what Rerun does at exit: it waits for a viewer that is not there."""
    try:
        _say(text)
    finally:  # nobody may be listening any more
        os._exit(0)


def _say(text: str) -> None:
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


def _messages() -> Iterator[Iterator[tuple[bytes, bytes]]]:
    """Yield the messages that have come in since the last time, at least one."""
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


class Show:
    """One flight on its way to a stream.

    Args:
        shown: the flight.
        stream: where to; connected.

    """

    def __init__(self, shown: Shown, stream: rr.RecordingStream) -> None:
        self._shown, self.stream = shown, stream
        stream.set_log_time_enabled(False)
        self._recorder: Recorder | None = None
        self._seen: set[Event] = set()
        self._kept: Vector = np.zeros(0)  # last rows, which the next ones are judged with

    def add(self, rows: bytes) -> None:
        """Show further ticks."""
        if not rows:
            return
        shown, values = self._shown, np.concatenate([self._kept, np.frombuffer(rows)])
        hz, more = shown.control_hz, {"lateral": shown.lateral, "load_factor": shown.in_g}
        trace = from_rows(values, estimators=shown.estimators, control_hz=hz, **more)
        trace = with_excitation(trace, m_delta=shown.m_delta, control_hz=hz)
        width = len(values) // len(trace)
        new = len(self._kept) // width
        if self._recorder is None:
            self._recorder = self._begin(trace)
        self._recorder.add(trace, new)
        now = float(trace["t_s"][-1])
        happened = [event for event in shown.planned if event.t_s <= now + 1e-9]
        happened += [Event(*event) for event in seen_events(trace, shown.actuators, since=new)]
        self._log(happened)
        self._kept = values[-width * (round(WINDOW_S * shown.control_hz) + 1) :]

    def result(self, flown: Shown) -> None:
        """Show what came of the flight."""
        if self._recorder is None:
            return
        self._recorder.card(flown.card)
        self._log(list(flown.planned))
        if flown.departed:
            self._recorder.departed()

    def _begin(self, trace: Trace) -> Recorder:
        # A filter may have no NIS at its first ticks.
        plots = self._shown.plots(trace, certain=[f"{name}.nis" for name in self._shown.estimators])
        self.stream.send_blueprint(layout.flight(plots, live=True), make_active=True)
        recorder = Recorder(self.stream, self._shown, plots)
        recorder.begin()
        return recorder

    def _log(self, events: list[Event]) -> None:
        assert self._recorder is not None
        self._recorder.events(event for event in events if event not in self._seen)
        self._seen.update(events)


if __name__ == "__main__":
    main()
