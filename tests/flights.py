"""The shipped scenarios, each flown once per test session, whichever worker asks first."""

from __future__ import annotations

import fcntl
import pickle
from collections.abc import Callable, Container, Iterable, Iterator
from contextlib import contextmanager, nullcontext
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from flightbed.campaigns import run as campaigns
from flightbed.parallel import executor
from flightbed.runs.run import Result, run
from flightbed.scenario.reading import load_scenario

ShippedFlight = Callable[[str], Result]


# One scenario of each form of report and recording; the others are exhaustive, for `make test-long`.
REPRESENTATIVE = (
    "elevator-and-aileron", "elevator-hardover", "elevator-loss", "elevator-redesign", "harmonic-gust", "pull-up-loss",
    "straight-and-level", "thesis-loss", "turbulent-loss",
)  # fmt: skip


def representative(values: Iterable[Any], fast: Container[Any] = REPRESENTATIVE) -> list[Any]:
    """Return values as parameters of a test, those not in ``fast`` for the long suite only."""
    several = [(value, value if isinstance(value, tuple) else (value,)) for value in values]
    return [pytest.param(*parts, marks=[] if value in fast else pytest.mark.long) for value, parts in several]


@contextmanager
def campaigns_in_this_process() -> Iterator[None]:
    """Fly campaigns in this process, whatever the number of workers; a worker process takes two seconds to start."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(campaigns, "opener", lambda *_: lambda: nullcontext(None))
        yield


@contextmanager
def studies_in_this_process() -> Iterator[None]:
    """Let ``flightbed reproduce`` run here, whatever the number of workers; it refuses the same numbers."""
    opener = executor.opener

    def here(workers: int | None = None, scheduler: str | None = None) -> executor.Opener:
        opener(workers, scheduler)
        return lambda: nullcontext(None)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(executor, "opener", here)
        yield


def fly_shipped(name: str) -> Result:
    """Fly a shipped scenario as it stands."""
    return run(load_scenario(name), rerun=False)


def once(folder: Path, fly: ShippedFlight = fly_shipped) -> ShippedFlight:
    """Return ``fly`` with its results kept in a folder, which all workers of a session share.

    A flight is kept as it is (pickled: the same bits). Nothing that uses it may change it.
    """

    @cache
    def flown(name: str) -> Result:
        kept = folder / f"{name}.pickle"
        with (folder / f"{name}.lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)  # a worker that dies gives it back
            if kept.is_file():
                result: Result = pickle.loads(kept.read_bytes())
                return result
            result = fly(name)
            written = kept.with_suffix(".part")
            written.write_bytes(pickle.dumps(result))
            written.replace(kept)
            return result

    return flown
