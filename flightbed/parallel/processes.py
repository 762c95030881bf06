"""Executor of local worker processes, independent of each other: a process that dies fails only its own task."""

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

from flightbed.core.errors import InputError

P = ParamSpec("P")
R = TypeVar("R")

_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


class Processes(Executor):
    """An executor of fresh processes, each with one task at a time.

    If a process dies, the future of its task fails with ``BrokenExecutor`` and a new process replaces it. A ``ProcessPoolExecutor`` of
    the standard library would fail all futures, so the cause could not be found. If a process dies before it is ready, no task is the
    cause: its future fails with ``InputError``.
    """

    def __init__(self, count: int) -> None:
        """Start no process yet: each starts with its first task."""
        self._threads = ThreadPoolExecutor(count, thread_name_prefix="flightbed")  # one thread per process
        self._own = local()
        self._pools: list[ProcessPoolExecutor] = []
        self._lock = Lock()

    def submit(self, fn: Callable[P, R], /, *args: P.args, **kwargs: P.kwargs) -> Future[R]:
        """Submit a task; tasks start in the order of submission."""
        return self._threads.submit(self._run_in_pool, lambda pool: pool.submit(fn, *args, **kwargs))

    def _run_in_pool(self, start: Callable[[ProcessPoolExecutor], Future[R]]) -> R:
        pool: ProcessPoolExecutor | None = getattr(self._own, "pool", None)
        if pool is None:
            pool = self._own.pool = self._start_pool()
        try:
            return start(pool).result()
        except BrokenExecutor:
            self._own.pool = None
            raise

    def _start_pool(self) -> ProcessPoolExecutor:
        pool = ProcessPoolExecutor(1, get_context("spawn"), initializer=_prepare)
        with self._lock:
            self._pools.append(pool)
        try:
            with _interrupts_blocked():
                ready = pool.submit(os.getpid)
            ready.result()
        except BrokenExecutor:
            raise InputError(
                "worker processes: end before they are ready; in your own script start flights below if __name__ == '__main__':, "
                "otherwise check that enough memory is free"
            ) from None
        # Close this process's copy of the writing end of the result pipe. While it is open, reading a partly written result of a killed
        # process blocks for ever. The pool starts no other process that needs it.
        pool._result_queue._writer.close()  # type: ignore[attr-defined]
        return pool

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the processes after their running tasks."""
        self._threads.shutdown(wait=wait, cancel_futures=cancel_futures)
        for pool in self._pools:
            pool.shutdown(wait=wait)


@contextmanager
def local_processes(workers: int | None = None) -> Iterator[Executor]:
    """Open an executor of fresh local processes, one per core if None; a single worker is a process too.

    Linear algebra in a worker uses one thread, unless the environment sets another number: the matrices are small, and with spinning
    threads two workers were slower than one.
    """
    with _environment(dict.fromkeys(_THREADS, "1")), Processes(workers or os.cpu_count() or 1) as executor:
        yield executor


def _prepare() -> None:
    """Prepare a worker: it ignores interrupts, which the parent handles, and ends if the parent is killed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})  # ignored from here on
    parent = parent_process()
    if parent is not None:
        Thread(target=_end_with, args=(parent.sentinel,), daemon=True).start()


@contextmanager
def _interrupts_blocked() -> Iterator[None]:
    """Block SIGINT in this thread: a process that starts meanwhile inherits the mask, until ``_prepare`` ignores the signal.

    The resource tracker of multiprocessing, which unblocks SIGINT when it starts, must run already; a pool starts it.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _end_with(sentinel: int) -> None:
    wait([sentinel])
    os._exit(1)  # without a parent, the worker would wait at its queue for ever


@contextmanager
def _environment(defaults: Mapping[str, str]) -> Iterator[None]:
    """Set environment variables that are not set, until the context ends; a worker reads them when it starts."""
    added = {name: value for name, value in defaults.items() if name not in os.environ}
    os.environ.update(added)
    try:
        yield
    finally:
        for name in added:
            os.environ.pop(name, None)
