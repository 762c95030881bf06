"""Processor time and wall time of work that is repeated: rounds, ratios and differences round by round, medians with ranges.

A figure is a list with one value per round. Ratios and differences are taken round by round: a change of the machine's load then acts
on both figures.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from statistics import median
from typing import TypeVar

Key = TypeVar("Key")
Value = TypeVar("Value")
Figures = list[float]  # one value per round


def interleaved(ways: Mapping[Key, Callable[[], Value]], rounds: int, *, warm: int = 1) -> dict[Key, list[Value]]:
    """Call all ways once per round, in reverse order in every second round; return the results of each, round by round.

    Args:
        ways: functions to call, by name.
        rounds: number of rounds.
        warm: rounds before these, for loading and compiling; their results are dropped.

    """
    given: dict[Key, list[Value]] = {name: [] for name in ways}
    for number in range(-warm, rounds):
        for name in list(ways)[:: -1 if number % 2 else 1]:
            value = ways[name]()
            if number >= 0:
                given[name].append(value)
    return given


def seconds(work: Callable[[], object], repeat: int = 1, *, clock: Callable[[], float] = time.perf_counter) -> float:
    """Return the time of one call, the mean over ``repeat`` calls in a row, s.

    Args:
        work: function to call.
        repeat: number of calls.
        clock: wall time; or ``time.thread_time``, the processor time of this thread, for work that neither waits nor uses other
            threads: a time slice of another process (4 ms under Linux) is longer than some of the work.

    """
    began = clock()
    for _ in range(repeat):
        work()
    return (clock() - began) / repeat


def ratios(over: Sequence[float], under: Sequence[float]) -> Figures:
    """Return one figure over another, round by round."""
    return [a / b for a, b in zip(over, under, strict=True)]


def differences(more: Sequence[float], less: Sequence[float]) -> Figures:
    """Return one figure minus another, round by round."""
    return [a - b for a, b in zip(more, less, strict=True)]


def spread(values: Sequence[float], spec: str) -> str:
    """Return "median (lowest to highest)", or the median alone where all three are written alike."""
    middle, low, high = (format(f(values), spec) for f in (median, min, max))
    return middle if low == high else f"{middle} ({low} to {high})"
