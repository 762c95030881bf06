"""Work -> results on any executor: as they are done, never too far ahead; who kills the process that does it is found, and left out."""

from __future__ import annotations

import re
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Executor, Future, wait
from contextlib import AbstractContextManager, closing, contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any, Generic, TypeVar

from flightbed.errors import InputError
from flightbed.processes import apart

T = TypeVar("T")
R = TypeVar("R")
Engine = Callable[[], AbstractContextManager[Executor | None]]  # opens an executor; None works here and now

AHEAD = 64  # tasks in hand beyond the first that is not done: so many results at most wait for one before them
DEATHS = 3  # of processes that did a task alone: more is no chance
_TRIES = 3  # losses of the way to the workers in a row, without anything done between them
_CONNECT_S = 10


def engine(workers: int | None = None, scheduler: str | None = None) -> Engine:
    """Return what opens local processes, all cores if None, or the workers of a dask scheduler. Raises InputError."""
    if workers is not None and workers < 1:
        raise InputError(f"--workers: must be at least 1 (got {workers})")
    if scheduler is None:
        return partial(apart, workers)
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


@dataclass(frozen=True)
class Work(Generic[T, R]):
    """What is done with tasks.

    Attributes:
        do: makes the result of a task; a function that other processes can import. Doing a task twice is as good as once.
        parts: the smallest tasks that a task consists of.
        join: results of the parts, in their order -> that of the task.
        lost: the result of a part whose process dies whenever it is done.

    """

    do: Callable[[T], R]
    parts: Callable[[T], Sequence[T]]
    join: Callable[[Sequence[R]], R]
    lost: Callable[[T], R]


def results(
    tasks: Iterable[T], work: Work[T, R], opened: Engine, ahead: int = AHEAD
) -> Generator[tuple[T, R], None, None]:
    """Yield every task with its result, in the order in which they are done.

    A task whose process died is taken apart when no other is in hand, and its parts are done one by one, nothing beside them: so none
    is blamed for what another did, or for memory that they needed together. A part with which its process died ``DEATHS`` times is
    lost. Where the way to the workers is lost, what they had is given to an executor opened anew. What ``work`` raises propagates; what
    has not begun is cancelled then, and when the iterator is closed.

    Args:
        tasks: what to do, taken as it is needed.
        work: how.
        opened: where. Here and now, where that gives no executor, a death is that of everything.
        ahead: most tasks in hand beyond the first that is not done.

    Raises:
        InputError: the way to the workers is lost again and again, without anything done.

    """
    source = enumerate(tasks)
    undone: dict[int, T] = {}
    suspects: set[int] = set()  # of the undone: those whose process died
    losses = 0
    while True:
        with opened() as executor:
            if executor is None:
                yield from ((task, work.do(task)) for _, task in source)
                return
            pending: dict[Future[R], int] = {}
            try:
                pending.update((executor.submit(work.do, task), n) for n, task in undone.items() if n not in suspects)
                while True:
                    while not undone or (len(undone) < ahead and next(reversed(undone)) - next(iter(undone)) < ahead):
                        following = next(source, None)
                        if following is None:
                            break
                        number, task = following
                        undone[number] = task
                        pending[executor.submit(work.do, task)] = number
                    if not undone:
                        return
                    if not pending:
                        for number in sorted(suspects):
                            result = _one_by_one(executor, work, undone[number])
                            losses = 0
                            suspects.remove(number)
                            yield undone.pop(number), result
                        continue
                    for future in wait(pending, return_when=FIRST_COMPLETED).done:
                        number = pending[future]
                        error = future.exception()
                        if isinstance(error, Exception) and _deaths(error):
                            suspects.add(number)
                            del pending[future]
                            continue
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
                        f"the way to the workers is lost again and again ({type(error).__name__}); see whether they, and their "
                        "scheduler, still run"
                    ) from error
            finally:
                for future in pending:
                    future.cancel()


def _one_by_one(executor: Executor, work: Work[T, R], task: T) -> R:
    """Do the parts of a task, each alone."""
    found = []
    for part in work.parts(task):
        deaths = 0
        while deaths < DEATHS:
            future = executor.submit(work.do, part)
            try:
                found.append(future.result())
                break
            except Exception as error:
                died = _deaths(error)
                if not died:
                    raise
                deaths += died
        else:
            found.append(work.lost(part))
    return work.join(found)


def _deaths(error: Exception) -> int:
    """Return how many processes died with the task that failed with this; 0 if it failed otherwise."""
    if isinstance(error, BrokenExecutor):
        return 1
    if type(error).__module__.startswith("distributed") and type(error).__name__ == "KilledWorker":
        return int(getattr(error, "allowed_failures", 0)) + 1  # the scheduler has tried it as often
    return 0


def _is_loss(error: Exception) -> bool:
    """Tell whether workers or the way to them were lost, rather than that the work failed."""
    return isinstance(error, BrokenExecutor | CancelledError) or type(error).__module__.startswith("distributed")
