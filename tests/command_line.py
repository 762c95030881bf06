"""The command line as the tests call it."""

from __future__ import annotations

import io
import signal
import subprocess
import sys
from contextlib import chdir, redirect_stderr, redirect_stdout
from pathlib import Path

import pytest

from flightbed.cli import main as cli

COMMAND = [sys.executable, "-m", "flightbed"]


def flightbed(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run a command in a new process."""
    return subprocess.run([*COMMAND, *arguments], capture_output=True, text=True, check=False, cwd=cwd)


def call(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run a command in this process, in a folder; for tests of its results. A new process takes two seconds to start."""
    out, err, handler = io.TextIOWrapper(io.BytesIO(), "utf-8"), io.StringIO(), signal.getsignal(signal.SIGTERM)
    try:
        with chdir(cwd), redirect_stdout(out), redirect_stderr(err), pytest.raises(SystemExit) as ended:
            cli.main(arguments)
    finally:
        signal.signal(signal.SIGTERM, handler)
    code = ended.value.code
    assert isinstance(code, int)
    out.seek(0)
    return subprocess.CompletedProcess(arguments, code, out.read(), err.getvalue())


def heed_interrupts() -> None:
    """Let a child be interrupted even where this process ignores interrupts, as a shell's background job does."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def assert_one_clear_line(arguments: list[str], code: int, message: str, *, cwd: Path) -> None:
    """An error is one line on stderr with the message, the exit code, and nothing written.

    The command runs in this process. ``tests/cli`` also reads an error of a new process.
    """
    done = call(*arguments, cwd=cwd)
    assert_error(done.returncode, done.stdout, done.stderr, code, message)
    assert list(cwd.iterdir()) == []


def assert_error(found: object, stdout: str, stderr: str, code: int, message: str) -> None:
    """An error is one line on stderr with the message, and the exit code."""
    assert found == code
    assert message in stderr
    assert len(stderr.splitlines()) == 1
    assert stderr.startswith("flightbed: ")
    assert stdout == ""
