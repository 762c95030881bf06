"""Work -> results on any executor: as they are done, never too far ahead, and again where a worker was lost."""

from __future__ import annotations

import re
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Executor, Future, wait
from contextlib import AbstractContextManager, closing, contextmanager
from functools import partial
from typing import Any, TypeVar

from flightbed.ensemble import processes
from flightbed.errors import InputError

T = TypeVar("T")
R = TypeVar("R")
Engine = Callable[[], AbstractContextManager[Executor | None]]  # opens an executor; None works here and now

AHEAD = 64  # tasks in hand beyond the first that is not done: so many results at most wait for one before them
_TRIES = 3  # losses in a row, without anything done between them
_CONNECT_S = 10


def engine(workers: int | None = None, scheduler: str | None = None) -> Engine:
    """Return what opens local processes, all cores if None, or the workers of a dask scheduler. Raises InputError."""
    if workers is not None and workers < 1:
        raise InputError(f"--workers: must be at least 1 (got {workers})")
    if scheduler is None:
        return partial(processes, workers)
    if workers is not None:
        raise InputError(f"--workers {workers}: has no effect with --scheduler, whose workers fly; leave it out")
    if not re.fullmatch(r"[a-z]+://.+:\d+", scheduler):
        raise InputError(f"--scheduler {scheduler}: must be the address of a dask scheduler, tcp://HOST:PORT")
    return partial(cluster, scheduler)


@contextmanager
def cluster(address: str) -> Iterator[Executor]:
    """Give the executor of a dask scheduler. Raises InputError when it is not there, or has no workers."""
    try:
        from distributed import Client
    except ImportError:
        raise InputError(
            f"--scheduler {address}: needs the extra 'distributed'; pip install 'flightbed[distributed]'"
        ) from None
    try:
        client: Any = Client(address, timeout=_CONNECT_S, set_as_default=False)  # type: ignore[no-untyped-call]
    except (OSError, ValueError) as error:
        reason = " ".join(str(error).split())[:120]
        raise InputError(
            f"--scheduler {address}: cannot be reached ({reason}); start one, dask scheduler, and give its address, tcp://HOST:PORT"
        ) from None
    with closing(client):
        if not client.scheduler_info(n_workers=-1)["workers"]:
            raise InputError(f"--scheduler {address}: has no workers; start some, dask worker {address}")
        executor = client.get_executor(pure=False)
        try:
            yield executor
        finally:
            executor.shutdown(wait=False)


def results(
    tasks: Iterable[T], work: Callable[[T], R], opened: Engine, ahead: int = AHEAD
) -> Generator[tuple[T, R], None, None]:
    """Yield every task with its result, in the order in which they are done.

    Tasks whose worker is lost are given to others, and, where that needs it, to an executor opened anew. What ``work`` raises
    propagates; what has not begun is cancelled then, and when the iterator is closed.

    Args:
        tasks: what to do, taken as it is needed.
        work: a function that other processes can import; doing a task twice is as good as once.
        opened: where.
        ahead: most tasks in hand beyond the first that is not done.

    Raises:
        InputError: workers are lost again and again, without doing anything.

    """
    source = enumerate(tasks)
    undone: dict[int, T] = {}
    losses = 0
    while True:
        with opened() as executor:
            if executor is None:
                for number, task in [*undone.items()]:
                    yield undone.pop(number), work(task)
                yield from ((task, work(task)) for _, task in source)
                return
            pending: dict[Future[R], int] = {}
            try:
                pending.update((executor.submit(work, task), number) for number, task in undone.items())
                while True:
                    while not undone or (len(undone) < ahead and next(reversed(undone)) - next(iter(undone)) < ahead):
                        following = next(source, None)
                        if following is None:
                            break
                        number, task = following
                        undone[number] = task
                        pending[executor.submit(work, task)] = number
                    if not undone:
                        return
                    for future in wait(pending, return_when=FIRST_COMPLETED).done:
                        number = pending[future]
                        result = future.result()
                        del pending[future]
                        losses = 0
                        yield undone.pop(number), result
            except Exception as error:
                losses += 1
                if not _is_loss(error):
                    raise
                if losses >= _TRIES:
                    raise InputError(
                        f"workers are lost again and again ({type(error).__name__}); see whether memory is short, "
                        "and give fewer --workers"
                    ) from error
            finally:
                for future in pending:
                    future.cancel()


def _is_loss(error: Exception) -> bool:
    """Tell whether a worker or the way to it was lost, rather than that the work failed."""
    return isinstance(error, BrokenExecutor | CancelledError) or type(error).__module__.startswith("distributed")
