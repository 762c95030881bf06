"""The command line as the tests call it."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

COMMAND = [sys.executable, "-m", "flightbed"]


def flightbed(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run([*COMMAND, *arguments], capture_output=True, text=True, check=False, cwd=cwd)


def heed_interrupts() -> None:
    """Let a child be interrupted even where this process ignores interrupts, as a shell's background job does."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def assert_one_clear_line(arguments: list[str], code: int, message: str, *, cwd: Path) -> None:
    """An error is one line on stderr with the message, the exit code, and nothing written."""
    done = flightbed(*arguments, cwd=cwd)
    assert done.returncode == code
    assert message in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert done.stderr.startswith("flightbed: ")
    assert done.stdout == ""
    assert list(cwd.iterdir()) == []
