"""Terminal output of several commands: lines, JSON, tables and a progress bar."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.console import Console, RenderableType
from rich.padding import PaddingDimensions
from rich.table import Table
from rich.text import Text


class _Stdout(Console):
    def on_broken_pipe(self) -> None:  # rich would exit with 1
        raise BrokenPipeError


_stdout = _Stdout(highlight=False)
stderr = Console(stderr=True)


def print_lines(lines: Iterable[RenderableType]) -> None:
    """Print lines, tables and paragraphs as they arrive; only a string may be wider than the terminal."""
    for line in lines:
        _stdout.print(line, soft_wrap=isinstance(line, str))


def print_json(content: Mapping[str, Any], folder: Path | None) -> None:
    """Print results and their folder as one JSON object."""
    print(json.dumps({**content, "folder": str(folder)}, indent=2))


def table(padding: PaddingDimensions = (0, 1)) -> Table:
    """Return an empty table without lines."""
    return Table(box=None, header_style="dim", padding=padding)


def without_intervals(row: Sequence[Any]) -> list[Any]:
    """Return the cells of a row of a document's table, each interval replaced by its estimate."""
    from flightbed.statistics.intervals import Interval

    return [cell.estimate if isinstance(cell, Interval) else cell for cell in row]


@contextmanager
def progress_bar() -> Iterator[Callable[[int, int], None]]:
    """Show progress on stderr, if it is a terminal: flights done, rate, time left; yields the function to update it."""
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        ProgressColumn,
        Task,
        TextColumn,
        TimeRemainingColumn,
    )

    class Rate(ProgressColumn):
        def render(self, task: Task) -> Text:
            return Text("" if task.speed is None else f"{task.speed:.3g} flights/s", style="dim")

    columns = (TextColumn("flying"), BarColumn(), MofNCompleteColumn(), Rate(), TimeRemainingColumn())
    with Progress(*columns, console=stderr, transient=True, disable=not stderr.is_terminal) as bar:
        task = bar.add_task("", total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)
