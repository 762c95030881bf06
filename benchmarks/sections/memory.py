"""Resident memory: of a process that flies, per flight in memory, and its growth over many flights.

Each measurement is a fresh process (resident.py), which measures its own memory after a garbage collection.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

from measuring import Column, Effort, Table, plain_shell

from flightbed.core.timing import interleaved

from .loop import SCENARIO

_MB, _KB = 1e6, 1e3
ROUNDS = 3  # at most: a round takes a minute, and they hardly differ


def measure(effort: Effort) -> list[Table]:
    """Return the tables of memory per flight and of growth."""
    if not Path("/proc/self/statm").exists():
        raise SystemExit("memory: resident memory is read from /proc, which this system has not")
    ways = {
        "held": lambda: _asked("held", effort.held, effort.overrides),
        "grown": lambda: _asked("grown", effort.flights, effort.overrides),
    }
    found = interleaved(ways, min(effort.rounds, ROUNDS), warm=0)
    held, grown = found["held"], [one["memory"] for one in found["grown"]]
    of_process = {
        "python alone": [[h["python"] / _MB for h in held]],
        "flightbed loaded, a flight planned": [[h["planned"] / _MB for h in held]],
        "some flights flown": [[h["flown"] / _MB for h in held]],
        "each flight's trace and metrics, kept": [[h["trace"] / _MB for h in held]],
        "each flight put together, its FDM and noise": [[h["flight"] / _MB for h in held]],
    }
    half, marks = len(grown[0]) // 2, (0, len(grown[0]) // 2, len(grown[0]) - 1)
    each = effort.flights / (len(grown[0]) - 1)  # flights from mark to mark
    over = {
        f"after {each * mark:.0f}": [
            [m[mark] / _MB for m in grown],
            None if mark == 0 else [100.0 * (m[mark] / m[0] - 1.0) for m in grown],
            None if mark == 0 else [(m[mark] - m[mark - half]) / (each * half * _KB) for m in grown],
        ]
        for mark in marks
    }
    megabytes = Column("resident", "MB", ".2f")
    return [
        Table(
            f"{SCENARIO}, in one process; {effort.held} flights held; processes: {len(held)}", (megabytes,), of_process
        ),
        Table(
            f"{effort.flights} flights of {SCENARIO} one after the other, none kept; processes: {len(grown)}",
            (megabytes, Column("growth", "%", ".2f"), Column("growth a flight since the row above", "kB", ".2f")),
            over,
        ),
    ]


def _asked(what: str, flights: int, overrides: tuple[str, ...]) -> dict[str, Any]:
    command = [sys.executable, str(Path(__file__).with_name("resident.py")), what, str(flights), *overrides]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=plain_shell({}))
    if done.returncode != 0:
        raise RuntimeError(f"{' '.join(command)}: {done.stderr}")
    memory: dict[str, Any] = json.loads(done.stdout)
    return memory
