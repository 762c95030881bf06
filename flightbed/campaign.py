"""Many flights of a scenario or over the points of a campaign file: their rows, the worst of them, and the folder that they leave."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import closing, contextmanager, nullcontext, suppress
from pathlib import Path

from flightbed.campaign_file import plain
from flightbed.campaign_flights import CHUNK, Chunk, Flown, chunk_of, fly_chunk, joined, killed, single_flights
from flightbed.campaign_histories import Histories
from flightbed.campaign_result import Campaign, worst_of
from flightbed.campaign_table import Row, passes
from flightbed.engine import Engine, Work, engine, results
from flightbed.errors import FlightbedError, InputError
from flightbed.flight_result import fly_scenario
from flightbed.journal import Journal, journal
from flightbed.programme import Programme, scenario_of, versions
from flightbed.settings import Scenario

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
    """Fly a campaign, and leave a folder with scenario, campaign file, table, summary and report.

    What is flown is kept in the folder from flight to flight (``journal.py``); after an interrupt or a kill ``resume`` flies the rest,
    and the table is the same to the last bit.

    Args:
        flights: a programme, or a scenario to be flown ``runs`` times with successive seeds.
        out: folder to write.
        runs: of a scenario how often.
        workers: processes, all cores if None.
        scheduler: address of a dask scheduler whose workers fly instead.
        replace: an ``out`` that holds a finished campaign is replaced, and any other folder that is not empty is refused; if false, the
            first free one of OUT, OUT-2, OUT-3, ... is taken instead.
        resume: go on with what is there of this campaign.
        progress: called with the numbers of flights that are done, and of all, whenever some are done.

    Returns:
        The campaign, None if ``resume`` found it finished, and where it is.

    Raises:
        As ``fly``; OutputError when the folder cannot be written; InputError when it is another campaign's; KeyboardInterrupt, with how to
        go on, after having written the table of what is done.

    """
    from flightbed.campaign_folder import finish

    began, opened = time.perf_counter(), engine(workers, scheduler)
    programme = plain(flights, runs) if isinstance(flights, Scenario) else flights
    with journal(Path(out), programme, replace=replace, resume=resume) as book:
        if isinstance(book, Path):
            return None, book
        with _kept(book, programme):
            if progress is not None:
                progress(book.done, len(programme))
            for number, flown in _flown(programme, book.missing, opened):
                book.add(number, flown)
                if progress is not None:
                    progress(book.done, len(programme))
            campaign = _campaign(programme, book.rows(), book.histories, began)
            finish(campaign, book)
        return campaign, book.target


def fly(
    flights: Scenario | Programme,
    runs: int = 100,
    *,
    executor: Executor | None = None,
    progress: Progress | None = None,
) -> Campaign:
    """Fly a programme, or a scenario with ``runs`` successive seeds, and leave no folder.

    Args:
        flights: what to fly.
        runs: of a scenario how often.
        executor: where, see ``processes.Processes``; None flies here and now, and what kills the process ends everything. The flights
            do not depend on it.
        progress: called with the numbers of flights that are done, and of all, whenever some are done.

    Raises:
        InputError, NotComputableError, as ``mission.run`` does with a scenario; InputError for runs < 1, and for seeds beyond the largest.

    """
    programme = plain(flights, runs) if isinstance(flights, Scenario) else flights
    began, parts, done = time.perf_counter(), dict[int, Flown](), 0
    histories = Histories(programme)
    chunks = range(-(-len(programme) // CHUNK))
    for number, flown in _flown(programme, chunks, lambda: nullcontext(executor)):
        parts[number] = flown
        done += len(flown.rows)
        histories.add(number, flown.parts)
        if progress is not None:
            progress(done, len(programme))
    return _campaign(programme, [row for n in sorted(parts) for row in parts[n].rows], histories, began)


def _flown(programme: Programme, chunks: Sequence[int], opened: Engine) -> Iterator[tuple[int, Flown]]:
    """Yield chunks as they are done. Raises InputError when a worker has other versions than we."""
    if not chunks:
        return
    work: Work[Chunk, Flown] = Work(fly_chunk, single_flights, joined, killed)
    with closing(results((chunk_of(programme, n) for n in chunks), work, opened)) as found:
        for chunk, flown in found:
            for package, ours in versions().items():
                if flown.versions[package] != ours:
                    raise InputError(
                        f"a worker has {package} {flown.versions[package]}, here it is {ours}; install the same"
                    )
            yield chunk.number, flown


@contextmanager
def _kept(book: Journal, programme: Programme) -> Iterator[None]:
    """Tell of what ends the flights how to go on; leave a table of what is done."""
    from flightbed.campaign_folder import put_table

    try:
        yield
    except (KeyboardInterrupt, SystemExit, FlightbedError) as stop:
        if book.done == 0:
            book.discard()
            raise
        kept, how = "", f"the same command with --out {book.target} --resume goes on"
        if isinstance(stop, FlightbedError):
            raise InputError(f"{stop}; {book.done} of {len(programme)} flights are kept; {how}") from stop
        if rows := _judged(programme, book.rows()):
            with suppress(FlightbedError):
                put_table(rows, programme, book)
                kept = f", which are in {book.target / 'table.parquet'}"
        if isinstance(stop, SystemExit):
            raise
        raise KeyboardInterrupt(f"interrupted after {book.done} of {len(programme)} flights{kept}; {how}") from None


def _judged(programme: Programme, rows: list[Row]) -> list[Row]:
    """Fill in whether they passed, in place: there may be many."""
    criteria = () if programme.settings is None else programme.settings.criteria
    for i, row in enumerate(rows):
        rows[i] = {**row, "passed": passes(row, criteria)}
    return rows


def _campaign(programme: Programme, rows: list[Row], histories: Histories, began: float) -> Campaign:
    rows = _judged(programme, rows)
    index, reason = worst_of(rows)
    worst = None if index < 0 else fly_scenario(scenario_of(programme.raw, programme.flight(index)))
    return Campaign(programme, rows, histories.ensembles, worst, index, reason, time.perf_counter() - began)
