"""Processes that die: at any time their task fails, and no task waits for ever."""

from __future__ import annotations

import os
import signal
import sys
import time
from concurrent.futures import BrokenExecutor, wait

import numpy as np
import pytest

from flightbed.parallel.processes import Processes

TASKS = 200


def _large(number: int) -> tuple[int, np.ndarray[tuple[int], np.dtype[np.float64]]]:
    """More than a pipe holds: a kill often interrupts the writing of a result."""
    return number, np.zeros(60_000)


def kill_one_of_two(rng: np.random.Generator) -> None:
    """Kill one of two processes while it hands over results: its task fails and no other."""
    executor = Processes(2)
    try:
        begun: set[int] = set()
        while len(begun) < 2:  # one that is killed before it has begun is another matter
            begun |= {task.result(timeout=60) for task in [executor.submit(os.getpid) for _ in range(4)]}
        futures = [executor.submit(_large, i) for i in range(TASKS)]
        futures[3].result(timeout=60)
        time.sleep(rng.uniform(0.0, 0.02))
        os.kill(int(rng.choice(sorted(begun))), signal.SIGKILL)
        done, left = wait(futures, timeout=60)
        assert not left
        errors = [future.exception() for future in done if future.exception() is not None]
        assert len(errors) <= 1
        assert all(isinstance(error, BrokenExecutor) for error in errors)
        kept = sorted(future.result()[0] for future in done if future.exception() is None)
        assert len(kept) >= TASKS - 1
    finally:
        executor.shutdown()


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="kills processes")
def test_a_process_that_is_killed_while_it_hands_over_fails_its_task_and_no_other(rng: np.random.Generator) -> None:
    """tests/long/test_kills.py has 60 rounds."""
    kill_one_of_two(rng)
