"""Local processes that fly, each apart from the others: one that dies takes nothing with it but the task that it had."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context, parent_process
from multiprocessing.connection import wait
from threading import Lock, Thread, local
from typing import ParamSpec, TypeVar

from flightbed.errors import InputError

P = ParamSpec("P")
R = TypeVar("R")

_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


class Processes(Executor):
    """An executor of so many fresh processes, each of which has one task at a time.

    A process that dies fails the future of its task with ``BrokenExecutor``, and another takes its place; a pool of the standard
    library would fail all futures, and nobody would know whose task it was. What a process needs to begin is no task's fault:
    ``InputError`` then.
    """

    def __init__(self, count: int) -> None:
        """Begin no process yet: each begins with its first task."""
        self._threads = ThreadPoolExecutor(count, thread_name_prefix="flightbed")  # each waits for a process of its own
        self._own = local()
        self._pools: list[ProcessPoolExecutor] = []
        self._lock = Lock()

    def submit(self, fn: Callable[P, R], /, *args: P.args, **kwargs: P.kwargs) -> Future[R]:
        """Have a task done, tasks in the order in which they are given."""
        return self._threads.submit(self._done, lambda pool: pool.submit(fn, *args, **kwargs))

    def _done(self, begin: Callable[[ProcessPoolExecutor], Future[R]]) -> R:
        pool: ProcessPoolExecutor | None = getattr(self._own, "pool", None)
        if pool is None:
            pool = self._own.pool = self._begun()
        try:
            return begin(pool).result()
        except BrokenExecutor:
            self._own.pool = None
            raise

    def _begun(self) -> ProcessPoolExecutor:
        pool = ProcessPoolExecutor(1, get_context("spawn"), initializer=_begin)
        with self._lock:
            self._pools.append(pool)
        try:
            pool.submit(os.getpid).result()
        except BrokenExecutor:
            raise InputError(
                "processes that should fly end before they have begun; in a script of your own fly below "
                "if __name__ == '__main__':, else see whether memory is short"
            ) from None
        # Our own copy of the end that the process writes to: while it is open, a result that a killed process had written in part would be
        # waited for to its end, for ever. The pool begins no other process that would need it.
        pool._result_queue._writer.close()  # type: ignore[attr-defined]
        return pool

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the processes, after what they are doing."""
        self._threads.shutdown(wait=wait, cancel_futures=cancel_futures)
        for pool in self._pools:
            pool.shutdown(wait=wait)


@contextmanager
def apart(workers: int | None = None) -> Iterator[Executor]:
    """Give an executor of so many fresh local processes, all cores if None; one is a process, too.

    A worker's linear algebra has one thread, unless the environment says otherwise: the matrices are small, and threads that wait for
    more of them by spinning made two workers slower than one.
    """
    with _environment(dict.fromkeys(_THREADS, "1")), Processes(workers or os.cpu_count() or 1) as executor:
        yield executor


def _begin() -> None:
    """Prepare a worker: an interrupt is the parent's to handle, which cancels what has not begun; a killed parent ends it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = parent_process()
    if parent is not None:
        Thread(target=_end_with, args=(parent.sentinel,), daemon=True).start()


def _end_with(sentinel: int) -> None:
    wait([sentinel])
    os._exit(1)  # nobody is there to hear of it, and the queue that the worker waits at would never end


@contextmanager
def _environment(defaults: Mapping[str, str]) -> Iterator[None]:
    """Set variables that are not set, for as long as it lasts: they are read when a worker begins."""
    added = {name: value for name, value in defaults.items() if name not in os.environ}
    os.environ.update(added)
    try:
        yield
    finally:
        for name in added:
            os.environ.pop(name, None)
