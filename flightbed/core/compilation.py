"""Watchers of compilation: functions that are called when a kernel is compiled because the cache does not have it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager

Watcher = Callable[
    [str], AbstractContextManager[object]
]  # dotted name of a kernel -> context, open while it is compiled

WATCHERS: list[Watcher] = []  # of this process; core/kernel_cache.py calls them


@contextmanager
def watched(watcher: Watcher) -> Iterator[None]:
    """Call a watcher for each kernel that this process compiles inside the ``with`` block; kernels that it calls count as part of it."""
    WATCHERS.append(watcher)
    try:
        yield
    finally:
        WATCHERS.remove(watcher)
