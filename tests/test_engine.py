"""The engine: work done once each, never too far ahead, again where a worker was lost; on a real dask scheduler the same table."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future, ThreadPoolExecutor
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from flightbed import campaign as campaigns
from flightbed.campaign_file import load_programme
from flightbed.engine import engine, results
from flightbed.errors import InputError
from tests.command_line import flightbed
from tests.test_journal import LONGER, started


def _double(n: int) -> int:
    return 2 * n


@pytest.mark.parametrize("threads", [0, 1, 3])
def test_every_task_is_done_once(threads: int) -> None:
    opened = (lambda: nullcontext(None)) if not threads else (lambda: ThreadPoolExecutor(threads))
    found = list(results(range(200), _double, opened, ahead=7))
    assert sorted(found) == [(n, 2 * n) for n in range(200)]


class _Breaks(Executor):
    """Does what it is told at once, but breaks at the task of a number, as a pool does whose worker was killed."""

    def __init__(self, at: int | None) -> None:
        self.at, self.broken = at, False

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()
        self.broken = self.broken or args[0] == self.at
        if self.broken:
            future.set_exception(BrokenExecutor("a worker died"))
        else:
            future.set_result(fn(*args, **kwargs))
        return future


def test_what_a_lost_worker_had_is_given_to_an_executor_opened_anew() -> None:
    breaks = iter([3, 3, 50, None])
    opened: list[_Breaks] = []

    @contextmanager
    def open_one() -> Iterator[Executor]:
        opened.append(_Breaks(next(breaks)))
        yield opened[-1]

    found = list(results(range(60), _double, open_one, ahead=5))
    assert sorted(found) == [(n, 2 * n) for n in range(60)]
    assert len(opened) == 4


def test_workers_that_are_lost_again_and_again_are_told_of() -> None:
    opened: list[int] = []

    @contextmanager
    def open_one() -> Iterator[Executor]:
        opened.append(1)
        yield _Breaks(0)

    with pytest.raises(InputError, match="workers are lost again and again"):
        list(results(range(9), _double, open_one))
    assert len(opened) == 3


class _Waits(Executor):
    """Ends no task but the second and later ones: the first is slow."""

    def __init__(self) -> None:
        self.futures: list[Future[Any]] = []

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()
        if self.futures:
            future.set_result(fn(*args, **kwargs))
        self.futures.append(future)
        return future


def test_it_is_never_too_far_ahead_of_a_slow_task_and_cancels_what_is_left() -> None:
    """So memory for results that wait for an earlier one is bounded, whatever the number of tasks."""
    slow = _Waits()
    found = results(range(1000), _double, lambda: nullcontext(slow), ahead=8)
    assert sorted(next(found)[0] for _ in range(7)) == [1, 2, 3, 4, 5, 6, 7]
    assert len(slow.futures) == 8
    found.close()
    assert slow.futures[0].cancelled()


def test_what_the_work_raises_ends_it() -> None:
    with pytest.raises(ZeroDivisionError):
        list(results([1, 0], lambda n: 1 // n, lambda: ThreadPoolExecutor(1)))


def test_options_that_exclude_each_other() -> None:
    with pytest.raises(InputError, match=r"--workers: must be at least 1 \(got 0\)"):
        engine(0)
    with pytest.raises(InputError, match="--workers 2: has no effect with --scheduler"):
        engine(2, "tcp://127.0.0.1:1")
    with pytest.raises(InputError, match="--scheduler here: must be the address of a dask scheduler, tcp://HOST:PORT"):
        engine(None, "here")


def test_no_extra_is_one_clear_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with (
        pytest.raises(InputError, match=r"needs the extra 'distributed'; pip install 'flightbed\[distributed\]'"),
        engine(None, "tcp://127.0.0.1:1")(),
    ):
        pass


@pytest.fixture
def processes() -> Iterator[list[subprocess.Popen[str]]]:
    begun: list[subprocess.Popen[str]] = []
    yield begun
    for process in reversed(begun):
        process.kill()
        process.wait()


def _begin(part: str, *arguments: str, cwd: Path) -> subprocess.Popen[str]:
    """Start a scheduler or worker of dask."""
    code = f"from distributed.cli.dask_{part} import main; main()"
    silent = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    return subprocess.Popen([sys.executable, "-c", code, *arguments], cwd=cwd, text=True, **silent)  # type: ignore[call-overload,no-any-return]


@pytest.mark.skipif(sys.platform == "win32", reason="kills with signals")
def test_a_dask_cluster_that_loses_a_worker_gives_the_same_table(
    tmp_path: Path, processes: list[subprocess.Popen[str]]
) -> None:
    pytest.importorskip("distributed")
    known = tmp_path / "scheduler.json"
    processes.append(
        _begin(
            "scheduler",
            "--host",
            "127.0.0.1",
            "--port",
            "0",
            "--no-dashboard",
            "--scheduler-file",
            str(known),
            cwd=tmp_path,
        )
    )
    deadline = time.monotonic() + 60.0
    while not known.is_file() or not known.read_text().endswith("}"):
        assert time.monotonic() < deadline
        time.sleep(0.05)
    address = json.loads(known.read_text())["address"]
    command = ["campaign", "elevator-loss", "--runs", "60", *LONGER, "--out", "x", "--scheduler", address]
    nobody = flightbed(*command, cwd=tmp_path)
    assert (nobody.returncode, nobody.stderr.count("\n")) == (2, 1), nobody.stderr
    assert f"--scheduler {address}: has no workers; start some, dask worker {address}\n" in nobody.stderr
    assert not (tmp_path / "x").exists()
    one_thread = ["--nthreads", "1", "--no-nanny", "--no-dashboard", "--host", "127.0.0.1"]
    processes += [_begin("worker", address, *one_thread, cwd=tmp_path) for _ in range(2)]
    _wait_for_workers(address, 2)
    with started(*command, "--resume", cwd=tmp_path, rows=10) as campaign:
        os.kill(processes[1].pid, signal.SIGKILL)
        stdout, stderr = campaign.communicate(timeout=120)
        assert campaign.returncode == 0, stderr
        assert stderr == ""
        assert "60 flights in" in stdout
    whole = campaigns.fly(load_programme("elevator-loss", LONGER[1::2], 60))
    assert pq.read_table(tmp_path / "x" / "table.parquet").to_pylist() == whole.rows
    processes[0].kill()
    processes[0].wait()


def _wait_for_workers(address: str, count: int) -> None:
    code = f"from distributed import Client; Client({address!r}).wait_for_workers({count}, timeout=60)"
    subprocess.run([sys.executable, "-c", code], check=True, capture_output=True)
