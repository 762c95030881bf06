"""Campaigns: many flights of a scenario or of a campaign file, their table, their worst flight, and their folder."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from flightbed.campaign_file import plain
from flightbed.campaign_flights import Chunk, ChunkResult, chunk_of, fly_chunk, joined, killed, single_flights
from flightbed.campaign_histories import Histories
from flightbed.campaign_table import Quantity, Row, followed, passes, quantities, quantity
from flightbed.consistency import detectors, estimates
from flightbed.engine import CHUNK, Opener, Work, opener, results
from flightbed.errors import FlightbedError, InputError
from flightbed.extension import permits
from flightbed.journal import Journal, journal
from flightbed.mission import Result
from flightbed.mission import run as fly_one
from flightbed.percentiles import Ensemble
from flightbed.programme import Programme, scenario_of
from flightbed.settings import Scenario
from flightbed.statistics import Interval, share

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Campaign:
    """Flights of a programme.

    Attributes:
        programme: what was flown.
        rows: one a flight, in order of their indices: column -> value, None where there is none.
        histories: point -> of the columns ``campaign_flights.HISTORIES`` and ``<name>.effectiveness_smoothed``; of the points that
            keep them, and in which something flew.
        worst: the worst flight, flown again, whole; None where every flight raised.
        worst_index: its index.
        reason: why it is the worst, in words.
        wall_time_s: how long it took, after the last ``--resume``.

    """

    programme: Programme
    rows: Sequence[Row]
    histories: Mapping[int, Ensemble]
    worst: Result | None
    worst_index: int
    reason: str
    wall_time_s: float

    @property
    def scenario(self) -> Scenario:
        """The base scenario, complete."""
        return self.programme.scenario

    @property
    def estimators(self) -> tuple[str, ...]:
        """Names of the estimates, as the scenario orders their estimators."""
        return estimates(self.scenario)

    @cached_property
    def flown(self) -> list[Row]:
        """Rows of the flights that did not raise."""
        return [row for row in self.rows if row["error"] is None]

    @cached_property
    def failed(self) -> list[Row]:
        """Rows of the flights that raised."""
        return [row for row in self.rows if row["error"] is not None]

    @property
    def departed(self) -> Interval | None:
        """Share of the flights that departed, with its exact binomial interval."""
        return departed(self.rows)

    @property
    def passed(self) -> Interval | None:
        """Share of the flights that keep the criteria, those that raised counted as not; None without criteria."""
        return passed(self.rows)

    @property
    def override(self) -> str:
        """Options of ``flightbed run`` that fly the worst flight again, of the campaign's scenario.toml."""
        if self.worst is None:
            return ""
        return f"{self.programme.overrides(self.programme.flight(self.worst_index))}{permits(self.worst.summary)}"

    @property
    def again(self) -> str:
        """Command that flies the worst flight again; FOLDER is the campaign's."""
        return f"flightbed run FOLDER/scenario.toml{self.override}"

    def quantity(self, column: str) -> Quantity:
        """Return a column of the table as a quantity of the flights that did not raise."""
        return quantity(self.flown, column, tests=detectors(self.scenario), seed=self.programme.seed)

    def quantities(self) -> list[Quantity]:
        """Return every metric that is a number and that some flight has."""
        return quantities(self.flown, self.scenario, self.programme.seed)


def departed(rows: Sequence[Row]) -> Interval | None:
    """Return the share that departed of the flights that did not raise, with its exact interval; None if all did."""
    known = [row["departed"] for row in rows if row["error"] is None]
    return share(known.count(True), len(known)) if known else None


def passed(rows: Sequence[Row]) -> Interval | None:
    """Return the share of the flights that keep the criteria, with its exact interval; None without criteria."""
    known = [row["passed"] for row in rows]
    return None if not known or None in known else share(known.count(True), len(known))


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

    Finished chunks are stored in the folder (``journal.py``). After an interrupt or a kill, ``resume`` flies the rest; the table is the
    same bit for bit.

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
        As ``fly``; OutputError if the folder cannot be written; InputError if it holds another campaign; KeyboardInterrupt, with the way
        to continue, after it has written the table of the finished flights.

    """
    from flightbed.campaign_folder import finish

    began, executor = time.perf_counter(), opener(workers, scheduler)
    programme = plain(flights, runs) if isinstance(flights, Scenario) else flights
    with journal(Path(out), programme, replace=replace, resume=resume) as book:
        if isinstance(book, Path):
            return None, book
        with _kept(book, programme):
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
        executor: an executor (``processes.local_processes``), or a function that opens one (``engine.opener``); None flies in this
            process, where a flight that ends the process ends everything. The flights do not depend on it.
        progress: called with the numbers of finished flights and of all flights, whenever some finish.

    Raises:
        InputError, NotComputableError: as ``mission.run``, for a scenario; InputError also for runs < 1, for seeds beyond the largest,
            and as ``engine.results``.

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
    work: Work[Chunk, ChunkResult] = Work(fly_chunk, single_flights, joined, killed)
    with closing(results((chunk_of(programme, n) for n in chunks), work, executor)) as finished:
        for chunk, result in finished:
            yield chunk.number, result


@contextmanager
def _kept(book: Journal, programme: Programme) -> Iterator[None]:
    """If the flights end early, write the table of the finished ones, and add to the error how to continue."""
    from flightbed.campaign_folder import put_table

    try:
        yield
    except (KeyboardInterrupt, SystemExit, FlightbedError) as stop:
        if book.done == 0:
            book.discard()
            raise
        table, how = "", f"continue with the same command and --out {book.target} --resume"
        if isinstance(stop, FlightbedError):
            raise InputError(f"{stop}; {book.done} of {len(programme)} flights are stored; {how}") from stop
        if rows := _judged(programme, book.rows()):
            with suppress(FlightbedError):
                put_table(rows, programme, book)
                table = f" (table: {book.target / 'table.parquet'})"
        if isinstance(stop, SystemExit):
            raise
        raise KeyboardInterrupt(f"interrupted after {book.done} of {len(programme)} flights{table}; {how}") from None


def _judged(programme: Programme, rows: list[Row]) -> list[Row]:
    """Fill in the column ``passed``, in place because there may be many rows."""
    criteria = () if programme.settings is None else programme.settings.criteria
    for i, row in enumerate(rows):
        rows[i] = {**row, "passed": passes(row, criteria)}
    return rows


def _campaign(programme: Programme, rows: list[Row], histories: Histories, began: float) -> Campaign:
    rows = _judged(programme, rows)
    index, reason = worst_of(rows)
    worst = None if index < 0 else fly_one(scenario_of(programme.raw, programme.flight(index)))
    return Campaign(programme, rows, histories.ensembles, worst, index, reason, time.perf_counter() - began)


def worst_of(rows: Sequence[Row]) -> tuple[int, str]:
    """Return the worst flight, the first of several, and why: it departed first, hit the ground first, or tracked worst.

    Of flights that all raised there is none: -1.
    """
    flown = [row for row in rows if row["error"] is None]
    if not flown:
        return -1, "every flight failed"
    for how, words in (("departed", "departed first"), ("ground", "hit the ground first")):
        gone = [row for row in flown if row["ended"] == how]
        if gone:
            worst = min(gone, key=lambda row: float(row["flown_s"] or 0.0))
            return int(worst["index"] or 0), f"{words}, at {worst['departed_at_s'] or worst['flown_s']:.2f} s"
    worst = max(flown, key=_tracking)
    column, what, unit, after = followed([worst])
    if worst[column] is None:
        return int(worst["index"] or 0), "the first: all flew to the end, and none is asked for anything"
    when = "from 0.3 s after the failure" if after else "over the whole flight"
    return int(worst["index"] or 0), f"largest RMS of {what} {when}, {_tracking(worst):.3g} {unit}"


def _tracking(row: Row) -> float:
    return float(row[followed([row]).column] or 0.0)
