"""A flight shown while it flies, by a process of its own: whatever becomes of the viewer, the flight goes on.

The loop only copies a tick's numbers; a thread hands them to the process, which alone knows Rerun (``telemetry/streamer.py``).
A viewer that is missing, slow or gone can fill a queue, no more; then the flight is shown no further, and that is told once.
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

from flightbed.errors import InputError
from flightbed.signals import Sample
from flightbed.trace import row_packer

if TYPE_CHECKING:
    from collections.abc import Iterable

    from flightbed.telemetry.shown import Shown

HOST, PORT = "127.0.0.1", 9876  # of this computer; Rerun's own port
HEADER = struct.Struct("<cI")  # kind and length of what follows
FLIGHT, ROWS, RESULT = b"F", b"R", b"E"
_TICKS, _SECONDS = 5, 0.03  # at least so many ticks are sent together, and no sooner than so long after the last ones
_QUEUE = 4096  # messages that may wait
_OPENING_S, _CLOSING_S, _BREAKING_S = 40.0, 15.0, 1.0


def _warn(text: str) -> None:
    warnings.warn(text, stacklevel=2)


def address(text: str | None) -> tuple[str, int]:
    """Return host and port of ``HOST:PORT``; of this computer for None. Raises InputError."""
    if text is None:
        return HOST, PORT
    host, _, port = text.rpartition(":")
    if not host or not port.isdecimal() or not 0 < int(port) < 65536:
        raise InputError(f"--viewer {text}: must be HOST:PORT, for example {HOST}:{PORT}")
    return host.strip("[]"), int(port)


@dataclass(eq=False)
class Live:
    """Shows one flight in a viewer while it flies; used once.

    Attributes:
        host, port: where a viewer listens; on this computer one is opened if none does.
        notify: told in words, once, when there is no viewer, or no longer; warns without it.

    """

    host: str = HOST
    port: int = PORT
    notify: Callable[[str], object] = _warn
    _process: subprocess.Popen[bytes] | None = field(default=None, init=False)
    _queue: queue.Queue[bytes] = field(default_factory=lambda: queue.Queue(_QUEUE), init=False)
    _told: threading.Event = field(default_factory=threading.Event, init=False)
    _threads: list[threading.Thread] = field(default_factory=list, init=False)
    _lock: threading.Lock = field(default_factory=threading.Lock, init=False)
    _gone: bool = field(default=False, init=False)
    _over: bool = field(default=False, init=False)

    def start(self, shown: Shown) -> None:
        """Find or open the viewer; returns when it is ready for the flight, or told that there will be none."""
        # -P: nothing is imported from the folder that one happens to be in.
        command = [sys.executable, "-P", "-m", "flightbed.telemetry.streamer", self.host, str(self.port)]
        try:
            self._process = process = subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                start_new_session=True,  # an interrupt is the flight's to handle
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
        self._put(FLIGHT, shown.to_json().encode())
        if not self._told.wait(_OPENING_S):
            self._lose(f"did not answer within {_OPENING_S:g} s")

    def watched(self, samples: Iterable[Sample]) -> Iterator[Sample]:
        """Yield the samples unchanged, and show them."""
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

    def finish(self, flown: Shown) -> None:
        """Show what came of the flight that is over: its card, its events, a departure."""
        self._over = True
        self._put(RESULT, flown.to_json().encode())

    def close(self) -> None:
        """Let what was sent arrive, for some seconds at most, and end; the viewer stays open. Of a flight that broke off nothing has to."""
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
            # The flight is flown and written: the interrupt says not to wait for the viewer any longer.
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
        """Hand messages on; an empty one is the last."""
        with suppress(OSError, ValueError), pipe:
            while message := self._queue.get():
                pipe.write(message)
                pipe.flush()

    def _read(self, pipe: BinaryIO) -> None:
        """Take what the process says: that it is ready, or why there is no viewer."""
        done = False
        with pipe:
            for line in pipe:
                word, _, reason = line.decode(errors="replace").strip().partition(" ")
                if word == "lost":
                    self._lose(reason)
                done = done or word in ("lost", "done")
                self._told.set()
        if not done:
            self._lose("was lost: the process that shows the flight ended")
        self._told.set()

    def _lose(self, reason: str) -> None:
        with self._lock:
            told, self._gone = self._gone, True
        if not told:
            self._told.set()
            how = "it is flown and written without it" if self._over else "the flight goes on without it"
            self.notify(f"the viewer at {self.host}:{self.port} {reason}; {how}")
