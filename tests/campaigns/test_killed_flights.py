"""Flights that end their process: the same row in the same table on any workers; other flights are not affected."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator
from contextlib import chdir
from functools import cache
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from flightbed import using
from flightbed.campaigns import run as campaigns
from flightbed.campaigns.file import load_programme
from flightbed.campaigns.plan import Programme
from flightbed.campaigns.table import Row
from flightbed.campaigns.worker import (
    DEATH_ERROR,
    Chunk,
    ChunkResult,
    chunk_of,
    fly_chunk,
    join_flights,
    killed_result,
    single_flights,
)
from flightbed.parallel.executor import opener
from flightbed.runs.run import fly
from flightbed.scenario.reading import load_scenario
from tests import dask_cluster
from tests.flights import campaigns_in_this_process

RUNS, VICTIM = 24, 13
SHORT = ["duration_s=0.5", "failures.0.at_s=0.2"]
NAME = "deadly.py:Deadly"
CODE = """
import os, signal
from flightbed.estimation.loop_gain.estimator import LoopGain, LoopGainSettings


class Deadly:
    def __init__(self, settings, onboard):
        self.inner = LoopGain(LoopGainSettings(name=settings.name).config(), onboard)
        self.readings = self.inner.readings
        self.options = settings.options

    def update(self, measurement):
        if measurement.alpha_rad == self.options["kills_at_rad"]:
            if self.options["how"] == "signal":
                os.kill(os.getpid(), signal.SIGKILL)
            os._exit(3)
        return self.inner.update(measurement)
"""


@pytest.fixture(scope="module")
def deadly(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[[str], Programme]]:
    """Return a programme in which one flight ends its process; its first reading, which no other flight has, identifies it."""
    folder = tmp_path_factory.mktemp("deadly")
    (folder / "deadly.py").write_text(CODE)
    reading = next(iter(fly(load_scenario("elevator-loss", [*SHORT, f"seed={VICTIM}"])))).measurement.alpha_rad
    own = [f"estimators.0.kind={NAME}", f"estimators.0.options.kills_at_rad={reading!r}"]

    def make(how: str) -> Programme:
        return load_programme("elevator-loss", [*SHORT, *own, f"estimators.0.options.how={how}"], RUNS)

    with chdir(folder), using(NAME):
        yield make


@pytest.fixture(scope="module")
def killed(deadly: Callable[[str], Programme], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a campaign of two workers."""
    flown, folder = campaigns.run(deadly("signal"), tmp_path_factory.mktemp("killed") / "x", workers=2)
    assert flown is not None
    assert flown.histories[0].moments.flying[0] == RUNS - 1
    return folder


@cache
def _expected() -> list[Row]:
    """Rows of all flights except the victim's."""
    return list(campaigns.fly(load_scenario("elevator-loss", SHORT), RUNS).rows)


def _assert_as_expected(folder: Path) -> None:
    table = pq.read_table(folder / "table.parquet").to_pylist()
    assert [row["error"] for row in table] == [DEATH_ERROR if i == VICTIM else None for i in range(RUNS)]
    assert table[VICTIM]["departed"] is table[VICTIM]["scheduled.final"] is None
    assert len({row["hash"] for row in table} - {None}) == RUNS
    for row, expected in zip(table, _expected(), strict=True):
        if row["index"] != VICTIM:
            assert {**row, "hash": None} == {**expected, "hash": None}
    stored = json.loads((folder / "summary.json").read_text())
    assert (stored["errors"], stored["flights"]) == (1, RUNS)
    assert f"1 of {RUNS} flights failed: {DEATH_ERROR}" in (folder / "report.html").read_text()


def test_it_is_a_row_and_the_campaign_goes_on(killed: Path) -> None:
    _assert_as_expected(killed)


@pytest.mark.long
@pytest.mark.parametrize("workers", [1, 2])
def test_a_process_that_exits_is_a_row_too(deadly: Callable[[str], Programme], tmp_path: Path, workers: int) -> None:
    _, folder = campaigns.run(deadly("exit"), tmp_path / "x", workers=workers)
    _assert_as_expected(folder)


def test_after_an_interrupt_its_table_is_the_same_to_the_last_bit(
    deadly: Callable[[str], Programme], killed: Path, tmp_path: Path
) -> None:
    programme = deadly("signal")

    def stop(done: int, _total: int) -> None:
        if done:
            raise KeyboardInterrupt

    with campaigns_in_this_process(), pytest.raises(KeyboardInterrupt, match="interrupted after 10 of 24 flights"):
        campaigns.run(programme, tmp_path / "x", workers=1, progress=stop)  # before the flight that kills
    assert len(pq.read_table(tmp_path / "x" / "table.parquet")) < RUNS
    _, folder = campaigns.run(programme, tmp_path / "x", workers=1, resume=True)
    for name in ("table.parquet", "histories.parquet"):
        assert (folder / name).read_bytes() == (killed / name).read_bytes()
    _assert_as_expected(folder)


@pytest.mark.long
def test_on_a_dask_cluster_whose_nannies_begin_dead_workers_anew(
    deadly: Callable[[str], Programme], tmp_path: Path
) -> None:
    pytest.importorskip("distributed")
    programme = deadly("signal")
    (tmp_path / "deadly.py").write_text(CODE)  # where the workers start
    with dask_cluster.scheduler(tmp_path) as address, dask_cluster.workers(address, tmp_path):
        _, folder = campaigns.run(programme, tmp_path / "x", scheduler=address)
    _assert_as_expected(folder)
    _, here = campaigns.run(programme, tmp_path / "here", workers=2)
    assert (folder / "table.parquet").read_bytes() == (here / "table.parquet").read_bytes()


def test_flights_flown_one_by_one_are_those_of_their_chunk() -> None:
    programme = load_programme("elevator-loss", SHORT, 4)
    chunk = chunk_of(programme, 0)
    together, alone = fly_chunk(chunk), join_flights([fly_chunk(one) for one in single_flights(chunk)])
    assert alone.rows == together.rows
    assert alone.parts.keys() == together.parts.keys()
    for name, array in together.parts[0].arrays().items():
        assert alone.parts[0].arrays()[name].tobytes() == array.tobytes(), name


def test_the_hash_of_a_flight_that_kills_is_that_of_the_flight() -> None:
    chunk = single_flights(chunk_of(load_programme("elevator-loss", SHORT, 2), 0))[1]
    assert killed_result(chunk).rows[0]["hash"] == fly_chunk(chunk).rows[0]["hash"]


def test_a_process_that_dies_once_blames_nobody(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A worker killed from outside, or out of memory that two tasks needed together: the flight succeeds when it runs alone."""
    monkeypatch.setattr(campaigns, "fly_chunk", _dies_where_it_is_not_alone)
    _, folder = campaigns.run(load_programme("elevator-loss", SHORT, RUNS), tmp_path / "x", workers=1)
    monkeypatch.undo()
    assert pq.read_table(folder / "table.parquet").to_pylist() == _expected()


def _dies_where_it_is_not_alone(chunk: Chunk) -> ChunkResult:
    if chunk.number == 1 and len(chunk.flights) > 1:
        os._exit(1)
    return fly_chunk(chunk)


def test_one_worker_is_a_process_too() -> None:
    with opener(1)() as executor:
        assert executor is not None
        assert executor.submit(os.getpid).result() != os.getpid()
