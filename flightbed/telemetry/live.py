"""Live view of a flight through a separate process: problems of the viewer never affect the flight.

The loop only copies the values of a tick; a thread passes them to the process, the only one that uses Rerun
(``telemetry/streamer.py``). A missing, slow or closed viewer at most fills a queue; the live view then ends with one notification.
"""

from __future__ import annotations

import queue
import struct
import subprocess
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, BinaryIO

from flightbed.core.errors import InputError
from flightbed.core.signals import Sample
from flightbed.flight.record import row_packer

if TYPE_CHECKING:
    from collections.abc import Iterable

    from flightbed.telemetry.flight_info import FlightInfo

HOST, PORT = "127.0.0.1", 9876  # this computer; Rerun's default port
HEADER = struct.Struct("<cI")  # kind and length of a message
FLIGHT, ROWS, RESULT = b"F", b"R", b"E"
_TICKS, _SECONDS = 5, 0.03  # smallest number of ticks per message and shortest time between messages
_QUEUE = 4096  # capacity of the queue, messages
_OPENING_S, _CLOSING_S, _BREAKING_S = 40.0, 15.0, 1.0


def _warn(text: str) -> None:
    warnings.warn(text, stacklevel=2)


def address(text: str | None) -> tuple[str, int]:
    """Return host and port from ``HOST:PORT``, the local defaults for None. Raises InputError."""
    if text is None:
        return HOST, PORT
    host, _, port = text.rpartition(":")
    if not host or not port.isdecimal() or not 0 < int(port) < 65536:
        raise InputError(f"--viewer {text}: must be HOST:PORT, for example {HOST}:{PORT}")
    return host.strip("[]"), int(port)


@dataclass(eq=False)
class Live:
    """Live view of a single flight; use one instance per flight.

    Attributes:
        host, port: address of the viewer; on this computer a viewer is opened if none is running.
        notify: called with a message, at most once, if the viewer is missing or lost; by default it issues a warning.

    """

    host: str = HOST
    port: int = PORT
    notify: Callable[[str], object] = _warn
    _process: subprocess.Popen[bytes] | None = field(default=None, init=False)
    _queue: queue.Queue[bytes] = field(default_factory=lambda: queue.Queue(_QUEUE), init=False)
    _answered: threading.Event = field(default_factory=threading.Event, init=False)
    _threads: list[threading.Thread] = field(default_factory=list, init=False)
    _lock: threading.Lock = field(default_factory=threading.Lock, init=False)
    _gone: bool = field(default=False, init=False)
    _over: bool = field(default=False, init=False)

    def start(self, info: FlightInfo) -> None:
        """Find or open the viewer; return when the viewer is ready or known to be unavailable."""
        # -P: no imports from the current folder.
        command = [sys.executable, "-P", "-m", "flightbed.telemetry.streamer", self.host, str(self.port)]
        try:
            self._process = process = subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                start_new_session=True,  # an interrupt reaches the flight only
            )
        except OSError as error:
            self._lose(f"cannot be started: {error.strerror}")
            return
        assert process.stdin is not None
        assert process.stdout is not None
        self._threads = [
            threading.Thread(target=self._write, args=(process.stdin,), daemon=True),
            threading.Thread(target=self._read, args=(process.stdout,), daemon=True),
        ]
        for thread in self._threads:
            thread.start()
        self._put(FLIGHT, info.to_json().encode())
        if not self._answered.wait(_OPENING_S):
            self._lose(f"did not answer within {_OPENING_S:g} s")

    def forward(self, samples: Iterable[Sample]) -> Iterator[Sample]:
        """Yield the samples unchanged and send them to the viewer."""
        rows: list[bytes] = []
        row, last = None, time.perf_counter()
        for sample in samples:
            if not self._gone:
                more = {"lateral": sample.lateral is not None, "load_factor": sample.load_factor is not None}
                row = row or row_packer(len(sample.estimates), **more)
                rows.append(row(sample))
                if len(rows) >= _TICKS and (now := time.perf_counter()) - last >= _SECONDS:
                    self._put(ROWS, b"".join(rows))
                    rows, last = [], now
            yield sample
        if rows:
            self._put(ROWS, b"".join(rows))

    def finish(self, info: FlightInfo) -> None:
        """Send the outcome of the completed flight: text summary, events, departure."""
        self._over = True
        self._put(RESULT, info.to_json().encode())

    def close(self) -> None:
        """Wait some seconds at most for the data to arrive (1 s for an aborted flight), then end; the viewer stays open."""
        if self._process is None:
            return
        patience = 0.0 if self._gone else _CLOSING_S if self._over else _BREAKING_S
        until = time.monotonic() + patience
        try:
            with suppress(queue.Full):
                self._queue.put(b"", timeout=patience)
            self._process.wait(max(0.0, until - time.monotonic()))
        except subprocess.TimeoutExpired:
            if self._over:
                self._lose(f"did not take the whole flight within {patience:g} s")
        except KeyboardInterrupt:
            if not self._over:
                raise
            # The flight is complete and written: the interrupt only ends the wait for the viewer.
            self._lose("did not take the whole flight before the interrupt")
        finally:
            self._gone = True
            self._process.kill()
            self._process.wait()
        for thread in self._threads:
            thread.join(1.0)

    def _put(self, kind: bytes, content: bytes) -> None:
        if self._gone:
            return
        try:
            self._queue.put_nowait(HEADER.pack(kind, len(content)) + content)
        except queue.Full:
            self._lose("does not keep up")

    def _write(self, pipe: BinaryIO) -> None:
        """Write messages to the process; an empty message is the last."""
        with suppress(OSError, ValueError), pipe:
            while message := self._queue.get():
                pipe.write(message)
                pipe.flush()

    def _read(self, pipe: BinaryIO) -> None:
        """Read the messages of the process: ready, lost with a reason, or done."""
        done = False
        with pipe:
            for line in pipe:
                word, _, reason = line.decode(errors="replace").strip().partition(" ")
                if word == "lost":
                    self._lose(reason)
                done = done or word in ("lost", "done")
                self._answered.set()
        if not done:
            self._lose("was lost: the streaming process ended")
        self._answered.set()

    def _lose(self, reason: str) -> None:
        with self._lock:
            known, self._gone = self._gone, True
        if not known:
            self._answered.set()
            state = "the flight is complete and written" if self._over else "the flight continues without it"
            self.notify(f"the viewer at {self.host}:{self.port} {reason}; {state}")
