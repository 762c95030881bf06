"""The executor: each task runs once, few tasks ahead, a task that ends its workers is identified; a dask scheduler gives the same table."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future, ThreadPoolExecutor
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from flightbed.campaigns import run as campaigns
from flightbed.campaigns.file import load_programme
from flightbed.core.errors import InputError
from flightbed.core.sources import source_sha256
from flightbed.core.versions import versions
from flightbed.parallel.executor import DEATHS, Work, opener, results
from tests import dask_cluster
from tests.campaigns.test_journal import LONGER, started
from tests.command_line import flightbed


def _double(n: int) -> int:
    return 2 * n


WORK = Work(_double, lambda n: [n], lambda found: found[0], lambda n: -n)


@pytest.mark.parametrize("threads", [0, 1, 3])
def test_every_task_is_done_once(threads: int) -> None:
    expected = [(n, 2 * n) for n in range(200)]
    opened = (lambda: nullcontext(None)) if not threads else (lambda: ThreadPoolExecutor(threads))
    assert sorted(results(range(200), WORK, opened, ahead=7)) == expected
    with nullcontext(None) if not threads else ThreadPoolExecutor(threads) as executor:  # an open one, or none
        assert sorted(results(range(200), WORK, executor, ahead=7)) == expected


class _Dies(Executor):
    """Run each task at once, except those in ``killers``, which kill their worker that many times; records the tasks."""

    def __init__(self, killers: dict[int, int], error: Exception | None = None) -> None:
        self.killers, self.error = dict(killers), error or BrokenExecutor("a worker died")
        self.asked: list[int] = []

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()
        self.asked.append(args[0])
        if self.killers.get(args[0], 0) > 0:
            self.killers[args[0]] -= 1
            future.set_exception(self.error)
        else:
            future.set_result(fn(*args, **kwargs))
        return future


def test_only_a_task_that_kills_every_time_is_lost() -> None:
    always, once, thrice = 17, 3, 40
    dies = _Dies({always: 99, once: 1, thrice: 3})  # the last with one death of the task and two of its part
    found = sorted(results(range(60), WORK, dies, ahead=5))
    assert found == [(n, -n if n == always else 2 * n) for n in range(60)]
    assert [dies.asked.count(n) for n in (always, once, thrice)] == [1 + DEATHS, 2, 4]
    assert all(dies.asked.count(n) == 1 for n in range(60) if n not in (always, once, thrice))


def test_the_parts_of_a_suspect_run_alone() -> None:
    """Tasks are pairs: only the part that kills is lost, and no other task runs beside a part."""
    pairs = Work[tuple[int, ...], int](
        sum, lambda pair: [(n,) for n in pair], lambda found: sum(found), lambda one: -1000 * one[0]
    )
    waiting: list[Future[Any]] = []

    class Later(Executor):
        """Completes tasks when they are polled, so that the test knows the other submitted tasks."""

        def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
            (task,) = args
            future: Future[Any] = Future()
            if len(task) == 1:
                assert all(f.done() for f in waiting), "a part runs beside another task"
            waiting.append(future)
            if 3 in task:
                future.set_exception(BrokenExecutor())
            else:
                future.set_result(fn(*args, **kwargs))
            return future

    found = dict(results([(1, 2), (3, 4), (5, 6)], pairs, Later()))
    assert found == {(1, 2): 3, (3, 4): -2996, (5, 6): 11}


def test_what_dask_says_of_a_killer_counts_as_often_as_it_was_tried() -> None:
    scheduler = pytest.importorskip("distributed.scheduler")
    twice, often = scheduler.KilledWorker("n", None, 1), scheduler.KilledWorker("n", None, 3)
    for error, asked in ((twice, 1 + 2), (often, 1 + 1)):
        dies = _Dies({2: 99}, error)
        assert sorted(results(range(4), WORK, dies)) == [(0, 0), (1, 2), (2, -2), (3, 6)]
        assert dies.asked.count(2) == asked


def test_after_a_lost_connection_another_executor_gets_the_unfinished_tasks() -> None:
    lost = iter([3, 3, 50, None])
    opened: list[_Dies] = []

    @contextmanager
    def open_one() -> Iterator[Executor]:
        at = next(lost)
        opened.append(_Dies({} if at is None else {at: 1}, CancelledError()))
        yield opened[-1]

    found = list(results(range(60), WORK, open_one, ahead=5))
    assert sorted(found) == [(n, 2 * n) for n in range(60)]
    assert len(opened) == 4


def test_a_connection_lost_three_times_in_a_row_is_an_error() -> None:
    opened: list[int] = []

    @contextmanager
    def open_one() -> Iterator[Executor]:
        opened.append(1)
        yield _Dies(dict.fromkeys(range(9), 1), CancelledError())

    with pytest.raises(InputError) as caught:
        list(results(range(9), WORK, open_one))
    assert str(caught.value) == (
        "lost connection to the workers 3 times in a row (CancelledError); check that the workers and the scheduler are running"
    )
    assert len(opened) == 3


def test_a_worker_with_other_versions_is_refused() -> None:
    class Elsewhere(_Dies):
        """Its workers have another numpy."""

        def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
            future: Future[Any] = Future()
            result, found = fn(*args, **kwargs)
            future.set_result((result, {**found, "numpy": "0.1"}))
            return future

    ours = versions()["numpy"]
    with pytest.raises(InputError) as caught:
        list(results(range(3), WORK, Elsewhere({})))
    assert str(caught.value) == (
        f"workers: must have the versions of this process (got numpy 0.1, here {ours}); install the same, start the workers again"
    )


def test_a_worker_with_other_sources_is_refused() -> None:
    class Elsewhere(_Dies):
        """Its workers have the sources of another commit, of the same version."""

        def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
            future: Future[Any] = Future()
            result, found = fn(*args, **kwargs)
            assert found == {**versions(), "sources of flightbed": source_sha256()}
            future.set_result((result, {**found, "sources of flightbed": "0" * 64}))
            return future

    with pytest.raises(InputError, match=f"got sources of flightbed 0000000000000000, here {source_sha256()[:16]}"):
        list(results(range(3), WORK, Elsewhere({})))


def test_processes_that_cannot_start_are_an_error_of_no_task(monkeypatch: pytest.MonkeyPatch) -> None:
    """As in a script without a guard, which each process starts again: the error names no flight."""
    monkeypatch.setattr("flightbed.parallel.processes._prepare", _ends)
    with pytest.raises(
        InputError, match="worker processes: end before they are ready; in your own script start flights below"
    ):
        list(results(range(3), WORK, opener(1)))


def _ends() -> None:
    os._exit(1)


class _Waits(Executor):
    """Completes the second and later tasks, but not the first."""

    def __init__(self) -> None:
        self.futures: list[Future[Any]] = []

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()
        if self.futures:
            future.set_result(fn(*args, **kwargs))
        self.futures.append(future)
        return future


def test_it_is_never_too_far_ahead_of_a_slow_task_and_cancels_what_is_left() -> None:
    """This bounds the memory of results that wait for an earlier one, for any number of tasks."""
    slow = _Waits()
    found = results(range(1000), WORK, slow, ahead=8)
    assert sorted(next(found)[0] for _ in range(7)) == [1, 2, 3, 4, 5, 6, 7]
    assert len(slow.futures) == 8
    found.close()
    assert slow.futures[0].cancelled()


def test_what_the_work_raises_ends_it() -> None:
    with pytest.raises(ZeroDivisionError):
        list(results([1, 0], replace(WORK, do=lambda n: 1 // n), lambda: ThreadPoolExecutor(1)))


def test_options_that_exclude_each_other() -> None:
    with pytest.raises(InputError, match=r"--workers: must be at least 1 \(got 0\)"):
        opener(0)
    with pytest.raises(InputError, match="--workers 2: has no effect with --scheduler"):
        opener(2, "tcp://127.0.0.1:1")
    with pytest.raises(InputError, match="--scheduler here: must be the address of a dask scheduler, tcp://HOST:PORT"):
        opener(None, "here")


def test_no_extra_is_one_clear_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with (
        pytest.raises(InputError, match=r"needs the extra 'distributed'; pip install 'flightbed\[distributed\]'"),
        opener(None, "tcp://127.0.0.1:1")(),
    ):
        pass


@pytest.mark.skipif(sys.platform == "win32", reason="kills with signals")
def test_a_dask_cluster_that_loses_a_worker_gives_the_same_table(tmp_path: Path) -> None:
    pytest.importorskip("distributed")
    with dask_cluster.scheduler(tmp_path) as address:
        command = ["campaign", "elevator-loss", "--runs", "40", *LONGER, "--out", "x", "--scheduler", address]
        done = flightbed(*command, cwd=tmp_path)
        assert (done.returncode, done.stderr.count("\n")) == (2, 1), done.stderr
        assert f"--scheduler {address}: has no workers; start some, dask worker {address}\n" in done.stderr
        assert not (tmp_path / "x").exists()
        with (
            dask_cluster.workers(address, tmp_path, "--no-nanny") as workers,
            started(*command, "--resume", cwd=tmp_path, rows=10) as campaign,
        ):
            os.kill(workers[0].pid, signal.SIGKILL)
            stdout, stderr = campaign.communicate(timeout=120)
            assert campaign.returncode == 0, stderr
            assert stderr == ""
            assert "40 flights in" in stdout
    whole = campaigns.fly(load_programme("elevator-loss", LONGER[1::2], 40))
    assert pq.read_table(tmp_path / "x" / "table.parquet").to_pylist() == whole.rows
