"""Executor for the tasks of studies and campaigns, on local processes or dask workers; the task of a worker that dies is repeated."""

from __future__ import annotations

import logging
import re
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Executor, Future, wait
from contextlib import AbstractContextManager, closing, contextmanager, nullcontext
from dataclasses import dataclass
from functools import partial
from typing import Any, Generic, TypeVar

from flightbed.core.errors import InputError
from flightbed.core.versions import identity
from flightbed.parallel.processes import local_processes

T = TypeVar("T")
R = TypeVar("R")
Opener = Callable[[], AbstractContextManager[Executor | None]]  # opens an executor; None: run in this process

# Seeds per task, of studies and campaigns. Results of studies do not depend on it. For campaigns it is part of the format of an
# unfinished folder (the journal counts chunks), and the order in which moments are added, thus their last bits, depends on it.
CHUNK = 10
AHEAD = 64  # most submitted tasks beyond the first unfinished one; this bounds the results that wait for their turn
DEATHS = 3  # worker deaths with one part alone, after which the part counts as the cause
_CONNECTION_LOSSES = 3  # in a row, without a finished task between them
_CONNECT_S = 10


def opener(workers: int | None = None, scheduler: str | None = None) -> Opener:
    """Return a function that opens an executor.

    Args:
        workers: number of local processes, one per core if None.
        scheduler: address of a dask scheduler, tcp://HOST:PORT, whose workers replace the local processes.

    Raises:
        InputError: workers < 1, no such address, or both options at once.

    """
    if workers is not None and workers < 1:
        raise InputError(f"--workers: must be at least 1 (got {workers})")
    if scheduler is None:
        return partial(local_processes, workers)
    if workers is not None:
        raise InputError(f"--workers {workers}: has no effect with --scheduler, whose workers fly; leave it out")
    if not re.fullmatch(r"[a-z]+://.+:\d+", scheduler):
        raise InputError(f"--scheduler {scheduler}: must be the address of a dask scheduler, tcp://HOST:PORT")
    return partial(cluster, scheduler)


@contextmanager
def _quiet(name: str) -> Iterator[None]:
    """Keep the warnings of a logger back inside the ``with`` block."""
    logger = logging.getLogger(name)
    level = logger.level
    logger.setLevel(logging.ERROR)
    try:
        yield
    finally:
        logger.setLevel(level)


@contextmanager
def cluster(address: str) -> Iterator[Executor]:
    """Open the executor of a dask scheduler. Raises InputError if it cannot be reached or has no workers."""
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
    with closing(client), _quiet("distributed.client"):  # it reports lost results; ``results`` flies them again
        if not client.scheduler_info(n_workers=-1)["workers"]:
            raise InputError(f"--scheduler {address}: has no workers; start some, dask worker {address}")
        executor = client.get_executor(pure=False)
        try:
            yield executor
        finally:
            executor.shutdown(wait=False)


@dataclass(frozen=True)
class Work(Generic[T, R]):
    """Functions that turn a task into its result.

    Attributes:
        do: task -> result; other processes must be able to import it. A repeated call gives the same result.
        parts: task -> its smallest parts, which are tasks too.
        join: results of the parts, in their order -> result of the task.
        lost: part -> its result if its worker dies every time, or raises an error that names the part.

    """

    do: Callable[[T], R]
    parts: Callable[[T], Sequence[T]]
    join: Callable[[Sequence[R]], R]
    lost: Callable[[T], R]


def results(
    tasks: Iterable[T], work: Work[T, R], executor: Executor | Opener | None, ahead: int = AHEAD
) -> Generator[tuple[T, R], None, None]:
    """Yield each task with its result, in the order in which they finish.

    If a worker dies, its task is set aside until no other task is running. Then the parts of the task run one at a time, with nothing
    beside them, so no part is rejected because of another task or because of memory that both needed together. A part whose worker
    dies ``DEATHS`` times is lost. After a lost connection a new executor is opened and gets the unfinished tasks. An error that
    ``work`` raises propagates. Tasks that have not started are cancelled then, and when the iterator is closed.

    Args:
        tasks: read as needed.
        work: functions for one task.
        executor: an executor, a function that opens one, or None to run in this process, which a crash of a task ends.
        ahead: most submitted tasks beyond the first unfinished one.

    Raises:
        InputError: the connection is lost three times in a row, or a worker has other versions or sources than this process.

    """
    opened = executor if callable(executor) else partial(nullcontext, executor)
    do = _WithIdentity(work.do)
    source = enumerate(tasks)
    undone: dict[int, T] = {}
    suspects: set[int] = set()  # unfinished tasks whose worker died
    losses = 0
    while True:
        with opened() as workers:
            if workers is None:
                yield from ((task, work.do(task)) for _, task in source)
                return
            pending: dict[Future[tuple[R, dict[str, str]]], int] = {}
            try:
                pending.update((workers.submit(do, task), n) for n, task in undone.items() if n not in suspects)
                while True:
                    while not undone or (len(undone) < ahead and next(reversed(undone)) - next(iter(undone)) < ahead):
                        following = next(source, None)
                        if following is None:
                            break
                        number, task = following
                        undone[number] = task
                        pending[workers.submit(do, task)] = number
                    if not undone:
                        return
                    if not pending:
                        for number in sorted(suspects):
                            result = _one_by_one(workers, work, undone[number])
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
                        result = _result(future)
                        del pending[future]
                        losses = 0
                        yield undone.pop(number), result
            except Exception as error:
                losses += 1
                if not _is_loss(error):
                    raise
                if losses >= _CONNECTION_LOSSES:
                    raise InputError(
                        f"lost connection to the workers {losses} times in a row ({type(error).__name__}); check that the workers "
                        "and the scheduler are running"
                    ) from error
            finally:
                for future in pending:
                    future.cancel()


@dataclass(frozen=True)
class _WithIdentity(Generic[T, R]):
    """Task -> result and the identity of the worker: versions of packages, digest of sources."""

    do: Callable[[T], R]

    def __call__(self, task: T) -> tuple[R, dict[str, str]]:
        return self.do(task), dict(identity())


def _result(future: Future[tuple[R, dict[str, str]]]) -> R:
    """Return the result of a finished future. Raises InputError if its worker has other versions or sources than this process."""
    result, found = future.result()
    for package, ours in identity().items():
        theirs = found.get(package, "unknown")
        if theirs != ours:
            raise InputError(
                f"workers: must have the versions of this process (got {package} {theirs[:16]}, here {ours[:16]}); install the same, "
                "start the workers again"
            )
    return result


def _one_by_one(executor: Executor, work: Work[T, R], task: T) -> R:
    """Run the parts of a task, each alone, and join their results."""
    found = []
    for part in work.parts(task):
        deaths = 0
        while deaths < DEATHS:
            future = executor.submit(_WithIdentity(work.do), part)
            try:
                found.append(_result(future))
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
    """Return how many workers died with the task that failed with this error; 0 for any other error."""
    if isinstance(error, BrokenExecutor):
        return 1
    if type(error).__module__.startswith("distributed") and type(error).__name__ == "KilledWorker":
        return int(getattr(error, "allowed_failures", 0)) + 1  # the scheduler has already repeated it as often
    return 0


def _is_loss(error: Exception) -> bool:
    """Return whether workers or the connection to them were lost; other errors come from the work itself."""
    return isinstance(error, BrokenExecutor | CancelledError) or type(error).__module__.startswith("distributed")
