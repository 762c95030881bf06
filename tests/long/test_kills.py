"""SIGKILL at many moments: a campaign that is resumed has the table of an undisturbed one; a run is there whole or not at all."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flightbed.campaigns import run as campaigns
from flightbed.campaigns.file import load_programme
from flightbed.document.document import Section
from flightbed.parallel.executor import opener
from flightbed.studies.base import Study, Trials, keyed_part, reproduce
from tests.campaigns.test_journal import started, workers_of
from tests.parallel.test_processes import kill_one_of_two
from tests.wheels import ROOT

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(not sys.platform.startswith("linux"), reason="finds workers in /proc"),
]

SCENARIO = ["--set", "duration_s=2", "--set", "failures.0.at_s=1"]  # of thesis-loss, on the linear plant
RUNS = 120


@pytest.mark.parametrize(("kind", "step", "least"), [("campaign", "3", 12), ("run", "1", 12)])
def test_killed_at_file_operations(tmp_path: Path, kind: str, step: str, least: int) -> None:
    """At each of a run, at every third of a campaign; the flights are flown in the process that dies."""
    command = [sys.executable, "-m", "tests.long.killed_at_events", kind, str(tmp_path), step]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    rounds = [json.loads(line) for line in done.stdout.splitlines()]
    assert len(rounds) > least
    assert rounds[-1]["event"] is None
    assert {found["code"] for found in rounds[:-1]} == {-signal.SIGKILL}
    wrong = [found for found in rounds if found["resumed"] or not found["same"] or not found["complete_or_absent"]]
    assert wrong == []


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    flights = load_programme("thesis-loss", SCENARIO[1::2], RUNS)
    return campaigns.run(flights, tmp_path_factory.mktemp("kills") / "x", workers=1)[1]


def _assert_the_same(folder: Path, whole: Path) -> None:
    assert {p.name for p in folder.iterdir()} == {p.name for p in whole.iterdir()}
    for name in ("table.parquet", "histories.parquet"):
        assert (folder / name).read_bytes() == (whole / name).read_bytes(), name


@pytest.mark.parametrize("workers", ["1", "2"])
def test_a_campaign_killed_again_and_again(undisturbed: Path, tmp_path: Path, workers: str) -> None:
    """The lead process dies as soon as 1, 11, 21, ... rows are on disk; at last it finishes."""
    command = ["campaign", "thesis-loss", "--runs", str(RUNS), *SCENARIO, "--out", "x", "--workers", workers]
    kept = tmp_path / "x" / "unfinished" / "rows.jsonl"
    for rows in range(1, RUNS - 30, 10):
        more = rows - (kept.read_bytes().count(b"\n") if kept.is_file() else 0)
        with started(*command, *(["--resume"] if rows > 1 else []), cwd=tmp_path, rows=max(more, 1)) as process:
            process.kill()
        assert "summary.json" not in {p.name for p in (tmp_path / "x").iterdir()}
    done = subprocess.run(
        [sys.executable, "-m", "flightbed", *command, "--resume"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    _assert_the_same(tmp_path / "x", undisturbed)


def test_a_campaign_that_loses_worker_after_worker(undisturbed: Path, tmp_path: Path) -> None:
    command = ["campaign", "thesis-loss", "--runs", str(RUNS), *SCENARIO, "--out", "x", "--workers", "2"]
    with started(*command, cwd=tmp_path, rows=1) as process:
        kept = tmp_path / "x" / "unfinished" / "rows.jsonl"
        for rows in range(10, RUNS - 20, 30):
            while kept.is_file() and kept.read_bytes().count(b"\n") < rows:
                assert process.poll() is None, process.communicate()
            for worker in workers_of(process)[:1]:
                os.kill(worker, signal.SIGKILL)
        _, stderr = process.communicate(timeout=300)
        assert (process.returncode, stderr) == (0, "")
    _assert_the_same(tmp_path / "x", undisturbed)


def test_processes_killed_while_they_hand_over(rng: np.random.Generator) -> None:
    for _ in range(60):
        kill_one_of_two(rng)


CODE = """
import os, signal, random

def draw(seed, marker, victims):
    if seed in victims:
        try:
            os.close(os.open(f"{marker}-{seed}", os.O_CREAT | os.O_EXCL))
        except FileExistsError:
            pass
        else:
            os.kill(os.getpid(), signal.SIGKILL)
    return random.Random(seed).random()
"""
TRIALS = 44  # five chunks


@pytest.mark.parametrize("workers", [1, 2])
def test_a_study_whose_workers_are_killed_at_any_seed(
    tmp_path: Path, workers: int, monkeypatch: pytest.MonkeyPatch, rng: np.random.Generator
) -> None:
    """Each seed of a round kills the first process that tries it."""
    (tmp_path / "deadly_draw.py").write_text(CODE)
    monkeypatch.syspath_prepend(str(tmp_path))
    import deadly_draw  # type: ignore[import-not-found]

    def drawn(marker: str, victims: tuple[int, ...], workers: int | None) -> Any:
        found: dict[str, list[Any]] = {}

        def build(results: Mapping[str, list[Any]]) -> Section:
            found.update(results)
            return Section("results")

        jobs = {"trials": Trials(deadly_draw.draw, (str(tmp_path / marker), victims), TRIALS)}
        study = Study("dying", "Dying", TRIALS, lambda _: [keyed_part(jobs, build)])
        reproduce(study, TRIALS, executor=None if workers is None else opener(workers))
        return found["trials"]

    undisturbed = drawn("none", (), None)
    rounds = [
        (0,),
        (9, 10),
        (TRIALS - 1,),
        (3, 4),
        *(tuple(map(int, rng.choice(TRIALS, 3, replace=False))) for _ in range(4)),
    ]
    for number, victims in enumerate(rounds):
        assert drawn(f"round-{number}", victims, workers) == undisturbed, victims
        assert len(list(tmp_path.glob(f"round-{number}-*"))) == len(victims)
    monkeypatch.delitem(sys.modules, "deadly_draw")
