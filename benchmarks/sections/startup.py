"""Time of commands from a cold shell: the first after an install, and later ones.

Every command is a fresh process. The first has neither compiled code nor the F-16's tables nor matplotlib's list of fonts: these lie in
folders of this benchmark; the user's caches are not touched. Python's bytecode exists, as after an installation.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from itertools import count
from pathlib import Path

from measuring import Column, Effort, Table, plain_shell

from flightbed.core.timing import interleaved, seconds

from .loop import SCENARIO


class Shell:
    """A shell whose caches lie in a folder of its own."""

    def __init__(self, folder: Path, environment: Mapping[str, str]) -> None:
        self._folder, self._environment, self._numbers = folder, plain_shell(environment), count()

    def clear(self) -> None:
        """Empty the caches."""
        caches = self._folder / f"caches-{next(self._numbers)}"
        caches.mkdir()
        self._environment |= {"NUMBA_CACHE_DIR": str(caches / "numba"), "XDG_CACHE_HOME": str(caches)}

    def python(self, *arguments: str) -> float:
        """Run Python in the folder; returns wall seconds. Raises RuntimeError for a command that fails."""
        command, env = [sys.executable, *arguments], self._environment
        done: list[subprocess.CompletedProcess[str]] = []
        taken = seconds(
            lambda: done.append(
                subprocess.run(command, cwd=self._folder, env=env, capture_output=True, text=True, check=False)
            )
        )
        if done[0].returncode != 0:
            raise RuntimeError(f"{' '.join(command)}: {done[0].stderr}")
        return taken

    def cached(self) -> set[str]:
        """Return the kinds of files in the caches, by their suffixes."""
        return {path.suffix for path in Path(self._environment["XDG_CACHE_HOME"]).rglob("*") if path.is_file()}


def measure(effort: Effort) -> list[Table]:
    """Return the table of the commands."""
    fly = ["-m", "flightbed", "run", SCENARIO, "--out", "run", *(f"--set={override}" for override in effort.overrides)]
    whole, bare = [*fly, "--report", effort.report], [*fly, "--report", "off", "--rerun", "off"]
    with tempfile.TemporaryDirectory() as folder:
        shell = Shell(Path(folder), effort.environment)

        def first() -> float:
            shell.clear()
            taken = shell.python(*whole)
            wanted = {".npz"} if "FLIGHTBED_PLAIN" in effort.environment else {".npz", ".kernel"}
            if not wanted <= shell.cached():
                raise RuntimeError(
                    "the first run left no cache in its cache folder: the measurement was not of a first run"
                )
            return taken

        ways = {
            f"flightbed run {SCENARIO}, the first": first,
            f"flightbed run {SCENARIO}, later": lambda: shell.python(*whole),
            "the same, without recording and report": lambda: shell.python(*bare),
            "flightbed list": lambda: shell.python("-m", "flightbed", "list"),
            "import flightbed": lambda: shell.python("-c", "import flightbed"),
            "from flightbed import run": lambda: shell.python("-c", "from flightbed import run"),
            "python alone": lambda: shell.python("-c", "pass"),
        }
        taken = interleaved(ways, effort.rounds, warm=0)
    rows: dict[str, Sequence[Sequence[float]]] = {name: [times] for name, times in taken.items()}
    return [Table("Fresh processes, wall time", (Column("from start to end", "s", ".2f"),), rows)]
