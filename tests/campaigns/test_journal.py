"""The folder of a campaign: kills, full disks, interrupts and errors lose only unfinished chunks; the resumed campaign gives the same table."""

from __future__ import annotations

import json
import os
import shlex
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from flightbed.campaigns import run as campaigns
from flightbed.campaigns import worker
from flightbed.campaigns.file import load_programme, plain
from flightbed.campaigns.journal import CAMPAIGN, Journal, journal
from flightbed.campaigns.plan import Programme
from flightbed.campaigns.worker import Chunk, ChunkResult, chunk_of, fly_chunk
from flightbed.core.errors import InputError, OutputError
from flightbed.parallel.executor import Opener
from flightbed.runs.run import run as fly_one
from flightbed.scenario.reading import load_scenario
from tests.command_line import COMMAND, call, heed_interrupts
from tests.flights import campaigns_in_this_process

SHORT = ["duration_s=0.5", "failures.0.at_s=0.2"]
RUNS = 34  # four chunks, the last not whole

GRID = """
schema = 1
name = "grid"
base = "elevator-loss"
runs = 6
seed = 3
[[axes]]
key = "condition.mach"
values = [0.8, 0.1]
[[criteria]]
metric = "departed"
equals = false
[traces]
keep = "chosen"
indices = [2, 8]
"""


@pytest.fixture(scope="module")
def programme() -> Programme:
    return plain(load_scenario("elevator-loss", SHORT), RUNS)


@pytest.fixture(scope="module", autouse=True)
def in_this_process() -> Iterator[None]:
    """Commands that a test starts have their own workers."""
    with campaigns_in_this_process():
        yield


@pytest.fixture(scope="module")
def whole(programme: Programme, in_this_process: None, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a campaign without interruption."""
    return campaigns.run(programme, tmp_path_factory.mktemp("whole") / "x", workers=1)[1]


def _assert_the_same(folder: Path, whole: Path) -> None:
    assert {p.name for p in folder.iterdir()} == {p.name for p in whole.iterdir()}
    assert (folder / "table.parquet").read_bytes() == (whole / "table.parquet").read_bytes()
    ours, theirs = (json.loads((f / "summary.json").read_text()) for f in (folder, whole))
    assert {**ours, "wall_time_s": 0} == {**theirs, "wall_time_s": 0}
    pages = [(f / "report.html").read_text().partition("How it was made</h2>")[0] for f in (folder, whole)]
    assert pages[0] == pages[1]
    assert (folder / "histories.parquet").read_bytes() == (whole / "histories.parquet").read_bytes()


@pytest.fixture
def counted(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Numbers of the chunks in flight order."""
    numbers: list[int] = []

    def flying(chunk: Chunk) -> ChunkResult:
        numbers.append(chunk.number)
        return fly_chunk(chunk)

    monkeypatch.setattr(campaigns, "fly_chunk", flying)
    return numbers


def _stop_after(chunks: int) -> Callable[[int, int], None]:
    def tell(done: int, _total: int) -> None:
        if done >= 10 * chunks:
            raise KeyboardInterrupt

    return tell


def test_a_finished_folder_holds_what_it_should(whole: Path, programme: Programme) -> None:
    assert {p.name for p in whole.iterdir()} == CAMPAIGN.files - {"campaign.toml", "traces"}
    table = pq.read_table(whole / "table.parquet").to_pylist()
    assert [row["index"] for row in table] == list(range(RUNS))
    assert len({row["hash"] for row in table}) == RUNS


def test_an_interrupt_leaves_a_usable_table_and_says_how_to_go_on(
    programme: Programme, whole: Path, tmp_path: Path, counted: list[int]
) -> None:
    out = tmp_path / "x"
    with pytest.raises(KeyboardInterrupt) as caught:
        campaigns.run(programme, out, workers=1, progress=_stop_after(2))
    assert str(caught.value) == (
        f"interrupted after 20 of {RUNS} flights (table: {out}/table.parquet); continue with the same command and --out {out} --resume"
    )
    assert {p.name for p in out.iterdir()} == {"unfinished", "table.parquet"}
    assert pq.read_table(out / "table.parquet").equals(pq.read_table(whole / "table.parquet").slice(0, 20))
    with pytest.raises(InputError, match="holds an unfinished campaign; continue it with --resume"):
        campaigns.run(programme, out)
    counted.clear()
    campaigns.run(programme, out, workers=1, resume=True)
    assert counted == [2, 3]
    _assert_the_same(out, whole)
    counted.clear()
    assert campaigns.run(programme, out, resume=True) == (None, out)
    assert counted == []


def test_what_keeps_nothing_leaves_an_earlier_campaign_as_it_was(
    programme: Programme, whole: Path, tmp_path: Path
) -> None:
    out = tmp_path / "x"
    other = plain(load_scenario("elevator-loss", [*SHORT, "failures.0.to=0.3"]), RUNS)
    with pytest.raises(KeyboardInterrupt) as caught:
        campaigns.run(other, out, workers=1, progress=_stop_after(0))
    assert (str(caught.value), list(tmp_path.iterdir())) == ("", [])
    shutil.copytree(whole, out)
    with pytest.raises(KeyboardInterrupt):
        campaigns.run(other, out, workers=1, progress=_stop_after(0))
    _assert_the_same(out, whole)
    with pytest.raises(KeyboardInterrupt):
        campaigns.run(other, out, workers=1, progress=_stop_after(1))
    assert {p.name for p in out.iterdir()} == {"unfinished", "table.parquet"}


def test_a_torn_line_is_flown_again_and_nothing_else(
    programme: Programme, whole: Path, tmp_path: Path, counted: list[int]
) -> None:
    out = tmp_path / "x"
    with pytest.raises(KeyboardInterrupt):
        campaigns.run(programme, out, workers=1, progress=_stop_after(3))
    rows = out / "unfinished" / "rows.jsonl"
    rows.write_bytes(rows.read_bytes()[:-40])  # as a kill or a full disk leaves it
    (out / "unfinished" / "table.parquet.tmp").write_bytes(b"PAR1")
    counted.clear()
    campaigns.run(programme, out, workers=1, resume=True)
    assert counted == [2, 3]
    _assert_the_same(out, whole)


class _Backwards(Executor):
    """Runs all tasks at once, and returns the results in reverse order."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()
        future.set_result(fn(*args, **kwargs))
        return future


def backwards(monkeypatch: pytest.MonkeyPatch) -> Opener:
    def last(futures: dict[Future[Any], int], **_: Any) -> Any:
        found = max(futures, key=lambda f: futures[f])
        return type("Done", (), {"done": [found]})

    monkeypatch.setattr("flightbed.parallel.executor.wait", last)
    return lambda: nullcontext(_Backwards())


def test_the_order_in_which_chunks_come_back_shows_nowhere(
    programme: Programme, whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, counted: list[int]
) -> None:
    opened = backwards(monkeypatch)
    monkeypatch.setattr(campaigns, "opener", lambda *_: opened)
    out = tmp_path / "x"
    with pytest.raises(KeyboardInterrupt):
        campaigns.run(programme, out, progress=_stop_after(1))
    early = {p.name for p in (out / "unfinished").glob("histories*")}
    assert early == {"histories-2.npz", "histories-3.npz"}  # they wait for the first two, on disk
    counted.clear()
    campaigns.run(programme, out, resume=True)
    assert sorted(counted) == [0, 1]
    _assert_the_same(out, whole)


def test_histories_that_were_merged_before_their_rows_were_kept_count_once(
    programme: Programme, whole: Path, tmp_path: Path
) -> None:
    out = tmp_path / "x"
    with journal(out, programme, replace=True, resume=False) as book:
        assert isinstance(book, Journal)
        book.histories.add(0, fly_chunk(chunk_of(programme, 0)).parts)  # killed here
    campaigns.run(programme, out, workers=1, resume=True)
    _assert_the_same(out, whole)


@pytest.mark.parametrize("at", [2, 4])
def test_a_full_disk_is_one_clear_line_and_loses_nothing(
    programme: Programme, whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, at: int
) -> None:
    """The disk is full when the second chunk is stored, or the last."""
    out, calls = tmp_path / "x", list[int]()

    def full(number: int) -> None:
        calls.append(number)
        if len(calls) >= at:
            raise OSError(28, "No space left on device")

    monkeypatch.setattr("flightbed.campaigns.journal.os.fsync", full)
    with pytest.raises(InputError) as caught:
        campaigns.run(programme, out, workers=1)
    assert str(caught.value) == (
        f"--out {out}: cannot be written: No space left on device; {10 * (at - 1)} of {RUNS} flights are stored; "
        f"continue with the same command and --out {out} --resume"
    )
    monkeypatch.undo()
    campaigns.run(programme, out, workers=1, resume=True)
    _assert_the_same(out, whole)


def test_a_disk_that_is_full_at_the_end_leaves_an_unfinished_campaign_without_a_summary(
    programme: Programme, whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, counted: list[int]
) -> None:
    out = tmp_path / "x"

    def full(*_: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("flightbed.campaigns.folder.write_table", full)
    with pytest.raises(InputError, match=rf"No space left on device; {RUNS} of {RUNS} flights are stored"):
        campaigns.run(programme, out, workers=1)
    assert (out / "unfinished").is_dir()
    assert not (out / "summary.json").exists()
    monkeypatch.undo()
    counted.clear()
    campaigns.run(programme, out, workers=1, resume=True)
    assert counted == []
    _assert_the_same(out, whole)


def test_the_folder_of_another_campaign_is_refused(programme: Programme, whole: Path, tmp_path: Path) -> None:
    other = plain(load_scenario("elevator-loss", [*SHORT, "failures.0.to=0.3"]), RUNS)
    longer = plain(load_scenario("elevator-loss", SHORT), RUNS + 1)
    for wanted, message in (
        (
            other,
            f"holds campaign 'elevator-loss' ({RUNS} flights) with other settings, aircraft or versions; name another folder",
        ),
        (
            longer,
            f"holds campaign 'elevator-loss' ({RUNS} flights), not this campaign 'elevator-loss' ({RUNS + 1} flights)",
        ),
    ):
        with pytest.raises(InputError) as caught:
            campaigns.run(wanted, whole, resume=True)
        assert message in str(caught.value)
    with (
        journal(tmp_path / "x", programme, replace=True, resume=False),
        pytest.raises(OutputError, match="another process is flying this campaign"),
    ):
        campaigns.run(programme, tmp_path / "x", resume=True)
    with pytest.raises(InputError, match="holds campaign 'elevator-loss'"):
        campaigns.run(other, tmp_path / "x", resume=True)


def test_without_a_folder_it_is_the_first_free_one_and_resume_finds_its_own(
    programme: Programme, whole: Path, tmp_path: Path
) -> None:
    other = plain(load_scenario("elevator-loss", [*SHORT, "failures.0.to=0.3"]), 10)
    assert campaigns.run(other, tmp_path / "x", workers=1, replace=False)[1] == tmp_path / "x"
    shutil.copytree(whole, tmp_path / "x-2")  # the same campaign, complete
    with pytest.raises(KeyboardInterrupt):
        campaigns.run(programme, tmp_path / "x", workers=1, replace=False, progress=_stop_after(1))
    resumed, place = campaigns.run(programme, tmp_path / "x", workers=1, replace=False, resume=True)
    assert (resumed is not None, place.name) == (True, "x-3")
    assert campaigns.run(other, tmp_path / "x", replace=False, resume=True) == (None, tmp_path / "x")


def test_flights_that_raise_are_rows_and_traces_that_are_chosen_are_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "grid.toml").write_text(GRID)
    grid = load_programme(tmp_path / "grid.toml", SHORT)
    fly_plan = worker.fly_plan

    def fails(plan: Any) -> Any:
        if plan.scenario.seed == grid.flight(3).seed:
            raise ZeroDivisionError("lost a\nwing")
        return fly_plan(plan)

    monkeypatch.setattr(worker, "fly_plan", fails)
    flown, out = campaigns.run(grid, tmp_path / "x", workers=1)
    assert flown is not None
    table = pq.read_table(out / "table.parquet").to_pylist()
    assert [row["error"] is not None for row in table] == [False] * 3 + [True] + [False] * 2 + [True] * 6
    assert table[3]["error"].startswith("test_journal.py:")
    assert table[3]["error"].endswith(": ZeroDivisionError: lost a wing")
    assert table[7]["error"].startswith("no trim at Mach 0.10")
    assert [row["passed"] for row in table] == [row["error"] is None for row in table]
    assert [row["condition.mach"] for row in table] == [0.8] * 6 + [0.1] * 6
    assert table[7]["departed"] is table[7]["scheduled.final"] is None
    found = json.loads((out / "summary.json").read_text())
    assert (found["errors"], found["passed"]["count"], [p["errors"] for p in found["points"]]) == (7, 5, [1, 6])
    assert found["points"][1]["departed"] is None
    assert "7 of 12 flights failed" in (out / "report.html").read_text()
    assert [p.name for p in (out / "traces").iterdir()] == ["flight-2.parquet"]  # the other one never flew
    assert (out / "campaign.toml").is_file()
    alone = fly_one(load_scenario(out / "scenario.toml", [f"seed={grid.flight(2).seed}", "condition.mach=0.8"]))
    kept = pq.read_table(out / "traces" / "flight-2.parquet").column("q_deg_s").to_numpy()
    assert np.array_equal(kept, alone.trace["q_deg_s"])
    assert table[2]["scheduled.final"] == alone.metrics.estimators["scheduled"].final
    program, command, base, *options = shlex.split(found["worst"]["command"].replace("FOLDER", str(out)))
    assert (program, command, options[::2]) == ("flightbed", "run", ["--set"] * 2)
    reflown = fly_one(load_scenario(base, options[1::2])).metrics
    assert reflown.to_dict() == found["worst"]["metrics"]
    assert reflown.tracking_rms_pre_deg_s == max(row["tracking_rms_pre_deg_s"] or 0.0 for row in table)
    again = load_programme(out / "campaign.toml")  # the folder flies again as it is
    assert [again.flight(i) for i in range(12)] == [grid.flight(i) for i in range(12)]


def test_where_every_flight_fails_the_page_says_why(tmp_path: Path) -> None:
    (tmp_path / "grid.toml").write_text(GRID.replace("0.8, 0.1", "0.1, 0.11"))
    flown, out = campaigns.run(load_programme(tmp_path / "grid.toml"), tmp_path / "x", workers=1)
    assert flown is not None
    assert flown.worst is None
    assert json.loads((out / "summary.json").read_text())["worst"] is None
    assert "12 of 12 flights failed: no trim at Mach 0.10" in (out / "report.html").read_text()


LONGER = ["--set", "duration_s=4", "--set", "failures.0.at_s=2"]
MANY = ["campaign", "elevator-loss", "--runs", "90", *LONGER, "--out", "x"]


@contextmanager
def started(*arguments: str, cwd: Path, rows: int) -> Iterator[subprocess.Popen[str]]:
    """A campaign that has stored this number of rows since its start; killed at the end if it still runs."""
    kept = cwd / "x" / "unfinished" / "rows.jsonl"
    before = kept.read_bytes().count(b"\n") if kept.is_file() else 0
    process = subprocess.Popen(
        [*COMMAND, *arguments],
        cwd=cwd,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=heed_interrupts,
    )
    try:
        deadline = time.monotonic() + 120.0
        while not kept.is_file() or kept.read_bytes().count(b"\n") < before + rows:
            assert process.poll() is None, process.communicate()[1]
            assert time.monotonic() < deadline
            time.sleep(0.02)
        yield process
    finally:
        process.kill()
        process.communicate()


def workers_of(process: subprocess.Popen[str]) -> list[int]:
    """Return the process numbers of a command's workers."""
    found = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            parent = path.read_text().rpartition(")")[2].split()[1]
            command = (path.parent / "cmdline").read_bytes()
        except OSError:
            continue
        if parent == str(process.pid) and b"spawn_main" in command:
            found.append(int(path.parent.name))
    return found


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The table of MANY, flown in this process."""
    flights = load_programme("elevator-loss", LONGER[1::2], 90)
    return campaigns.run(flights, tmp_path_factory.mktemp("many") / "x", workers=1)[1]


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="finds workers in /proc")
def test_killed_interrupted_and_robbed_of_a_worker_it_leaves_the_same_table(undisturbed: Path, tmp_path: Path) -> None:
    with started(*MANY, "--workers", "1", cwd=tmp_path, rows=10) as process:
        process.kill()  # -9
    assert {p.name for p in (tmp_path / "x").iterdir()} == {"unfinished"}
    with started(*MANY, "--workers", "1", "--resume", cwd=tmp_path, rows=10) as process:
        process.send_signal(signal.SIGINT)
        stdout, stderr = process.communicate(timeout=60)
        assert (process.returncode, stdout) == (130, "")
        assert "of 90 flights (table: x/table.parquet); continue with the same command and --out x --resume\n" in stderr
        assert len(stderr.splitlines()) == 1
    with started(*MANY, "--workers", "2", "--resume", cwd=tmp_path, rows=10) as process:
        os.kill(workers_of(process)[0], signal.SIGKILL)
        stdout, stderr = process.communicate(timeout=120)
        assert (process.returncode, stderr) == (0, "")
    _assert_the_same(tmp_path / "x", undisturbed)
    shutil.rmtree(tmp_path / "x")


def test_a_folder_that_cannot_be_written_is_told_before_anything_flies(tmp_path: Path) -> None:
    done = call("campaign", "nominal", "--out", "/proc/nowhere/x", cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("flightbed: --out /proc/nowhere/x: cannot be written")
    assert len(done.stderr.splitlines()) == 1
