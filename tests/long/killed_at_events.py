"""Kill a campaign or a run with SIGKILL at each of its file operations, each time in a new process: the subprocess of test_kills.py.

    python killed_at_events.py campaign|run FOLDER STEP

Prints one JSON line per round: the operation at which it was killed (null: it finished), and the findings afterwards.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import signal
import sys
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from typing import Any

from flightbed.campaigns import run as campaigns
from flightbed.campaigns.file import plain
from flightbed.runs.run import run
from flightbed.scenario.reading import load_scenario

SCENARIO = load_scenario("thesis-loss", ["duration_s=0.4", "failures.0.at_s=0.2"])
RUNS = 24  # three chunks, the last not whole
EVENTS = ("open", "os.rename", "os.remove", "os.rmdir", "os.mkdir", "os.listdir", "os.truncate", "shutil.rmtree")


def _count_and_kill(folder: Path, kill_at: int) -> None:
    """Kill this process before its n-th operation on a file below a folder."""
    count = 0

    def hook(event: str, arguments: tuple[Any, ...]) -> None:
        nonlocal count
        if event in EVENTS and any(
            str(folder) in os.fsdecode(a) for a in arguments if isinstance(a, str | bytes | Path)
        ):
            count += 1
            if count == kill_at:
                (folder / "event").write_text(f"{event} {Path(str(arguments[0])).name}")
                os.kill(os.getpid(), signal.SIGKILL)

    sys.addaudithook(hook)


def _forked(action: Callable[[], object]) -> int:
    """Do an action in a child of this process; return the child's exit code, negative for a signal."""
    child = os.fork()
    if child == 0:
        code = 1
        try:
            action()
            code = 0
        finally:
            sys.stderr.flush()
            os._exit(code)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def _digests(folder: Path) -> dict[str, str]:
    """Return the digest of every file; of those with times, only that it is there."""
    timed = ("summary.json", "metrics.json", "report.html", "flight.rrd")
    return {
        str(path.relative_to(folder)): "" if path.name in timed else hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def main(kind: str, base: Path, step: int) -> None:
    """Kill at operation 1, 1 + step, ... until a round finishes."""
    campaigns.opener = lambda *_: lambda: nullcontext(None)  # type: ignore[assignment]  # flights in this process
    programme = plain(SCENARIO, RUNS)

    def fly(folder: Path, *, again: bool) -> object:
        if kind == "campaign":
            return campaigns.run(programme, folder, resume=again)
        return run(SCENARIO, folder, rerun=False, replace=again)

    assert _forked(lambda: fly(base / "whole" / "x", again=False)) == 0
    whole = _digests(base / "whole" / "x")
    kill_at = 1
    while True:
        place = base / f"round-{kill_at}"
        place.mkdir(parents=True)

        def first(place: Path = place, kill_at: int = kill_at) -> None:
            _count_and_kill(place, kill_at)
            fly(place / "x", again=False)

        code = _forked(first)
        left = _digests(place / "x") if (place / "x").is_dir() else {}
        resumed = _forked(lambda place=place: fly(place / "x", again=True))  # type: ignore[misc]
        found = {
            "event": (place / "event").read_text() if code else None,
            "code": code,
            "resumed": resumed,
            "same": resumed == 0 and _digests(place / "x") == whole,
            "complete_or_absent": kind == "campaign" or left in ({}, whole),
        }
        print(json.dumps(found), flush=True)
        shutil.rmtree(place)
        if code != -signal.SIGKILL:
            return
        kill_at += step


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]), int(sys.argv[3]))
