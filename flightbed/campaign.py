"""Many flights of a scenario or over the points of a campaign file: their rows, the worst of them, and the folder that they leave."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import closing, contextmanager, nullcontext, suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from flightbed.campaign_file import plain
from flightbed.campaign_flights import CHUNK, Chunk, Flown, chunk_of, fly_chunk, joined, killed, single_flights
from flightbed.campaign_histories import Histories
from flightbed.campaign_table import Quantity, Row, followed, passes, quantities, quantity
from flightbed.consistency import detectors, estimates
from flightbed.engine import Engine, Work, engine, results
from flightbed.errors import FlightbedError, InputError
from flightbed.extension import permits
from flightbed.journal import Journal, journal
from flightbed.mission import Result
from flightbed.mission import run as fly_one
from flightbed.percentiles import Ensemble
from flightbed.programme import Programme, scenario_of, versions
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
