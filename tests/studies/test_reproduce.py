"""`flightbed reproduce` and the code common to all studies: shared flights, atomic folders, results independent of the workers."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from flightbed.cli import main as cli
from flightbed.config import families
from flightbed.document.document import Section
from flightbed.studies.base import Part, Results, Study, Trials, distinct_jobs, reproduce
from tests.campaigns.test_journal import workers_of
from tests.command_line import COMMAND, assert_one_clear_line, call, heed_interrupts
from tests.flights import studies_in_this_process
from tests.studies.tiny import tiny


@pytest.fixture(autouse=True)
def _registered(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(families._BUILT_IN["studies"], "tiny", "tests.studies.tiny:tiny")
    monkeypatch.chdir(tmp_path)


def _call(*arguments: str) -> int:
    before = signal.getsignal(signal.SIGTERM)
    try:
        with pytest.raises(SystemExit) as ended:
            cli.main(arguments)
    finally:
        signal.signal(signal.SIGTERM, before)
    return int(str(ended.value.code))


def test_flights_that_parts_share_are_flown_once_with_all_columns() -> None:
    parts = tiny().parts(3)
    jobs = distinct_jobs(parts)
    assert [job.runs for job in jobs] == [5, 5]
    assert all(job.columns == ("t_s",) for job in jobs)
    reports: list[tuple[int, int]] = []
    document = reproduce(tiny(), 3, progress=lambda done, total: reports.append((done, total)))
    assert document.facts["flights"] == 10
    assert reports[-1] == (10, 10)
    assert [t[0] for t in reports] == sorted(t[0] for t in reports)
    first, second = document.tables()
    assert [row[2] for row in first.rows] == [3, 3]
    assert [row[2] for row in second.rows] == [5, 5]


def test_the_executor_changes_no_number() -> None:
    with ThreadPoolExecutor(2) as threads:
        pooled = reproduce(tiny(), 3, executor=threads).to_dict()
    assert pooled["tables"] == reproduce(tiny(), 3).to_dict()["tables"]


def _walk(seed: int, length: int) -> tuple[int, float]:
    return seed, float(np.random.default_rng(seed).standard_normal(length).sum())


def test_trials_beside_flights_are_run_once_in_the_order_of_their_seeds() -> None:
    seen: list[list[tuple[int, float]]] = []

    def build(results: Results) -> Section:
        seen.extend(results)
        return Section("walks")

    def study(runs: int) -> list[Part]:
        return [
            *tiny().parts(2),
            Part([Trials(_walk, (5,), runs), Trials(_walk, (6,), 3)], build),
            Part([Trials(_walk, (5,), 2)], build),
        ]

    with ThreadPoolExecutor(2) as threads:
        pooled = reproduce(Study("walks", "Walks", 60, study), 60, executor=threads)
    assert pooled.facts["flights"] == 8 + 60 + 3
    assert seen == [[_walk(s, 5) for s in range(60)], [_walk(s, 6) for s in range(3)], [_walk(s, 5) for s in range(2)]]


def test_json_is_alone_on_stdout_and_the_folder_is_whole(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert _call("reproduce", "tiny", "--workers", "1", "--json", "--runs", "2") == 0
    captured = capsys.readouterr()
    result = json.loads(captured.out)
    assert captured.err == ""
    assert result.pop("folder") == "studies/tiny"
    assert sorted(p.name for p in (tmp_path / "studies/tiny").iterdir()) == ["report.html", "results.json"]
    assert result == json.loads((tmp_path / "studies/tiny/results.json").read_text())
    assert result["again"] == "flightbed reproduce tiny --runs 2"
    assert result["tables"]["first"][0]["final"]["runs"] == 2
    with studies_in_this_process():
        assert _call("reproduce", "tiny", "--workers", "1", "--runs", "1") == 0
    shown = capsys.readouterr().out
    assert "A tiny study" in shown
    assert "written to studies/tiny-2" in shown


def test_an_earlier_study_is_replaced_and_nothing_else_is(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    with studies_in_this_process():
        for _ in range(2):
            assert _call("reproduce", "tiny", "--workers", "1", "--runs", "1", "--out", "x") == 0
    (tmp_path / "x" / "mine.txt").write_text("keep")
    capsys.readouterr()
    assert _call("reproduce", "tiny", "--workers", "1", "--runs", "1", "--out", "x") == 2
    assert capsys.readouterr().err == (
        "flightbed: --out x: holds 'mine.txt', which is not from a study; name a new folder\n"
    )
    assert (tmp_path / "x" / "mine.txt").read_text() == "keep"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["reproduce", "all"], "unknown study 'all'; known: estimators, gupta, kemp, sillence, "),
        (["reproduce", "silence"], "unknown study 'silence'; did you mean sillence?"),
        (["reproduce", "sillence", "--runs", "0"], "--runs: must be at least 1 (got 0)"),
        (["reproduce", "sillence", "--workers", "-1"], "--workers: must be at least 1 (got -1)"),
        (
            ["reproduce", "sillence", "--workers", "2", "--scheduler", "tcp://h:1"],
            "--workers 2: has no effect with --scheduler",
        ),
        (["reproduce", "sillence", "--scheduler", "here"], "--scheduler here: must be the address of a dask scheduler"),
        (["reproduce", "sillence", "--out", "."], "--out .: is the folder you are in"),
        (["reproduce", "sillence", "--runs", "many"], "many"),
    ],
)
def test_bad_input_is_one_clear_line(tmp_path: Path, arguments: list[str], message: str) -> None:
    assert_one_clear_line(arguments, 2, message, cwd=tmp_path)


def test_studies_are_listed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(families._BUILT_IN["studies"], "tiny")
    listed = call("list", "studies", cwd=tmp_path).stdout.splitlines()
    assert [line.split()[0] for line in listed if not line.startswith(" ")] == [
        "estimators", "gupta", "kemp", "sillence", "wu",
    ]  # fmt: skip


def _handles_interrupts(worker: int) -> bool:
    """Return whether Python in a worker has set its handler of interrupts, or ignores them already."""
    try:
        lines = Path(f"/proc/{worker}/status").read_text().splitlines()
    except OSError:
        return False
    sets = [int(line.split()[1], 16) for line in lines if line.startswith(("SigCgt", "SigIgn"))]
    return any(signals >> (signal.SIGINT - 1) & 1 for signals in sets)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="finds workers in /proc")
def test_an_interrupted_study_leaves_nothing(tmp_path: Path) -> None:
    """As from the keyboard: parent and workers get the signal, workers while they start."""
    process = subprocess.Popen(
        [*COMMAND, "reproduce", "sillence", "--runs", "500", "--workers", "2", "--out", "x"],
        cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
        preexec_fn=heed_interrupts,
    )  # fmt: skip
    deadline = time.monotonic() + 120.0
    while len([worker for worker in workers_of(process) if _handles_interrupts(worker)]) < 2:
        assert process.poll() is None
        assert time.monotonic() < deadline
    os.killpg(process.pid, signal.SIGINT)
    out, err = process.communicate(timeout=120)
    assert (process.returncode, out, err) == (130, "", "flightbed: interrupted; nothing was written\n")
    assert list(tmp_path.iterdir()) == []
