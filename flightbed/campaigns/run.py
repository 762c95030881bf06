"""Campaigns: many flights of a scenario or of a campaign file, their table, their worst flight, and their folder."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import closing, contextmanager, suppress
from pathlib import Path

from flightbed.analysis.result import fly_scenario
from flightbed.campaigns.file import plain
from flightbed.campaigns.histories import Histories
from flightbed.campaigns.journal import Journal, journal
from flightbed.campaigns.plan import Programme, scenario_of
from flightbed.campaigns.result import Campaign, worst_of
from flightbed.campaigns.table import Row, passes
from flightbed.campaigns.worker import (
    Chunk,
    ChunkResult,
    chunk_of,
    fly_chunk,
    join_flights,
    killed_result,
    single_flights,
)
from flightbed.core.errors import FlightbedError, InputError
from flightbed.parallel.executor import CHUNK, Opener, Work, opener, results
from flightbed.scenario.tables import Scenario

Progress = Callable[[int, int], None]


def run(
    flights: Scenario | Programme,
    out: str | Path,
    *,
    runs: int = 100,
    workers: int | None = None,
    scheduler: str | None = None,
    replace: bool = True,
    resume: bool = False,
    progress: Progress | None = None,
) -> tuple[Campaign | None, Path]:
    """Fly a campaign and write its folder: scenario, campaign file, table, summary and report.

    Finished chunks are stored in the folder (``campaigns/journal.py``). After an interrupt or a kill, ``resume`` flies the rest;
    the table is the same bit for bit.

    Args:
        flights: a programme, or a scenario for ``runs`` flights with successive seeds.
        out: folder to write.
        runs: flights of a scenario.
        workers: number of local processes, one per core if None.
        scheduler: address of a dask scheduler whose workers replace the local processes.
        replace: replace a finished campaign in ``out``, and refuse any other folder that is not empty; if false, use the first of OUT,
            OUT-2, OUT-3, ... that does not exist.
        resume: continue this campaign.
        progress: called with the numbers of finished flights and of all flights, whenever some finish.

    Returns:
        The campaign, None if ``resume`` found it finished, and its folder.

    Raises:
        As ``fly``; OutputError if the folder cannot be written; InputError if it holds another campaign; KeyboardInterrupt, with the
        command that continues, after it has written the table of the finished flights.

    """
    from flightbed.campaigns.folder import finish

    began, executor = time.perf_counter(), opener(workers, scheduler)
    programme = plain(flights, runs) if isinstance(flights, Scenario) else flights
    with journal(Path(out), programme, replace=replace, resume=resume) as book:
        if isinstance(book, Path):
            return None, book
        with _store_on_interrupt(book, programme):
            if progress is not None:
                progress(book.done, len(programme))
            for number, result in _chunk_results(programme, book.missing, executor):
                book.add(number, result)
                if progress is not None:
                    progress(book.done, len(programme))
            campaign = _campaign(programme, book.rows(), book.histories, began)
            finish(campaign, book)
        return campaign, book.target


def fly(
    flights: Scenario | Programme,
    runs: int = 100,
    *,
    executor: Executor | Opener | None = None,
    progress: Progress | None = None,
) -> Campaign:
    """Fly a programme, or a scenario with ``runs`` successive seeds, without a folder.

    Args:
        flights: a programme or a scenario.
        runs: flights of a scenario.
        executor: an executor (``processes.local_processes``), or a function that opens one (``executor.opener``); None flies in this
            process, which a crash of a flight ends. The flights do not depend on it.
        progress: called with the numbers of finished flights and of all flights, whenever some finish.

    Raises:
        InputError, NotComputableError: as ``runs.run.run``, for a scenario; InputError also for runs < 1, for seeds beyond the largest,
            and as ``executor.results``.

    """
    programme = plain(flights, runs) if isinstance(flights, Scenario) else flights
    began, done, rows = time.perf_counter(), 0, dict[int, list[Row]]()
    histories = Histories(programme)
    chunks = range(-(-len(programme) // CHUNK))
    for number, result in _chunk_results(programme, chunks, executor):
        rows[number] = result.rows
        done += len(result.rows)
        histories.add(number, result.parts)
        if progress is not None:
            progress(done, len(programme))
    return _campaign(programme, [row for n in sorted(rows) for row in rows[n]], histories, began)


def _chunk_results(
    programme: Programme, chunks: Sequence[int], executor: Executor | Opener | None
) -> Iterator[tuple[int, ChunkResult]]:
    """Yield the number and the result of each chunk, in the order in which they finish."""
    if not chunks:
        return
    work: Work[Chunk, ChunkResult] = Work(fly_chunk, single_flights, join_flights, killed_result)
    with closing(results((chunk_of(programme, n) for n in chunks), work, executor)) as finished:
        for chunk, result in finished:
            yield chunk.number, result


@contextmanager
def _store_on_interrupt(book: Journal, programme: Programme) -> Iterator[None]:
    """After an early end, write the table of the finished flights, and add the command that continues to the error."""
    from flightbed.campaigns.folder import put_table

    try:
        yield
    except (KeyboardInterrupt, SystemExit, FlightbedError) as stop:
        if book.done == 0:
            book.discard()
            raise
        table, how = "", f"continue with the same command and --out {book.target} --resume"
        if isinstance(stop, FlightbedError):
            raise InputError(f"{stop}; {book.done} of {len(programme)} flights are stored; {how}") from stop
        if rows := _with_passed(programme, book.rows()):
            with suppress(FlightbedError):
                put_table(rows, programme, book)
                table = f" (table: {book.target / 'table.parquet'})"
        if isinstance(stop, SystemExit):
            raise
        raise KeyboardInterrupt(f"interrupted after {book.done} of {len(programme)} flights{table}; {how}") from None


def _with_passed(programme: Programme, rows: list[Row]) -> list[Row]:
    """Return the rows with the column ``passed``; replaces them in the list, because there may be many."""
    criteria = () if programme.settings is None else programme.settings.criteria
    for i, row in enumerate(rows):
        rows[i] = {**row, "passed": passes(row, criteria)}
    return rows


def _campaign(programme: Programme, rows: list[Row], histories: Histories, began: float) -> Campaign:
    rows = _with_passed(programme, rows)
    index, reason = worst_of(rows)
    worst = None if index < 0 else fly_scenario(scenario_of(programme.raw, programme.flight(index)))
    return Campaign(programme, rows, histories.ensembles, worst, index, reason, time.perf_counter() - began)
