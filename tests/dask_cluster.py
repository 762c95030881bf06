"""A dask scheduler and workers as processes of a test."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def scheduler(folder: Path) -> Iterator[str]:
    """Start one on this computer; gives its address."""
    known = folder / "scheduler.json"
    silent = ["--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(known)]
    with _begun("scheduler", *silent, cwd=folder) as process:
        deadline = time.monotonic() + 60.0
        while not known.is_file() or not known.read_text().endswith("}"):
            assert process.poll() is None
            assert time.monotonic() < deadline
            time.sleep(0.05)
        yield json.loads(known.read_text())["address"]


@contextmanager
def workers(address: str, folder: Path, *options: str) -> Iterator[list[subprocess.Popen[str]]]:
    """Start two, of one thread each."""
    each = [address, "--nthreads", "1", "--no-dashboard", "--host", "127.0.0.1", *options]
    with _begun("worker", *each, cwd=folder) as one, _begun("worker", *each, cwd=folder) as other:
        code = f"from distributed import Client; Client({address!r}).wait_for_workers(2, timeout=60)"
        subprocess.run([sys.executable, "-c", code], check=True, capture_output=True)
        yield [one, other]


@contextmanager
def _begun(part: str, *arguments: str, cwd: Path) -> Iterator[subprocess.Popen[str]]:
    # A nanny begins its worker by importing the main module anew: as a script it would begin nannies for ever.
    code = f"from distributed.cli.dask_{part} import main\nif __name__ == '__main__': main()"
    silent = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    command = [sys.executable, "-c", code, *arguments]
    process: subprocess.Popen[str] = subprocess.Popen(command, cwd=cwd, text=True, **silent)  # type: ignore[call-overload]
    try:
        yield process
    finally:
        process.terminate()  # a nanny takes its worker with it
        try:
            process.wait(timeout=20)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
