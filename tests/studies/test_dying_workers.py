"""Studies with workers that are killed: the results of an undisturbed study, or one error that names case, seed and cure."""

from __future__ import annotations

import importlib
import json
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from flightbed import using
from flightbed.analysis.seeds import Job, fly_jobs
from flightbed.cli import main as cli
from flightbed.config import families
from flightbed.core.errors import InputError
from flightbed.document.document import Section
from flightbed.parallel.executor import DEATHS, Opener, opener
from flightbed.scenario.reading import Scenario, load_scenario
from flightbed.studies.base import Study, Trials, keyed_part, reproduce, run_trials
from tests import dask_cluster

RUNS = 24  # three chunks
SHORT = ["duration_s=0.5", "failures.0.at_s=0.2"]
CODE = '''
import os, signal, random
from multiprocessing import parent_process
from flightbed.estimation.loop_gain.estimator import LoopGain, LoopGainSettings


def kill_first(marker):
    """Kill the first process that calls this, and no other."""
    try:
        os.close(os.open(marker, os.O_CREAT | os.O_EXCL))
    except FileExistsError:
        return
    os.kill(os.getpid(), signal.SIGKILL)


def estimator(settings, onboard):
    kill_first(settings.options["marker"])
    return LoopGain(LoopGainSettings(name=settings.name).config(), onboard)


def deadly_estimator(settings, onboard):
    os.kill(os.getpid(), signal.SIGKILL)


def draw(seed, marker):
    if seed == 13:
        kill_first(marker)
    return random.Random(seed).random()


def deadly(seed, victim):
    if seed == victim:
        os.kill(os.getpid(), signal.SIGKILL)
    return seed
'''
pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="kills with signals")


@pytest.fixture
def dying(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[ModuleType]:
    """A module of functions that kill their process; workers can import it."""
    (tmp_path / "dying.py").write_text(CODE)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    yield importlib.import_module("dying")
    monkeypatch.delitem(sys.modules, "dying")


def _scenario(attribute: str, marker: Path) -> Scenario:
    own = [f"estimators.0.kind=dying.py:{attribute}", f"estimators.0.options.marker={marker}"]
    return load_scenario("elevator-loss", [*SHORT, *own])


def _results(dying: ModuleType, folder: Path, executor: Opener | None) -> Mapping[str, list[Any]]:
    """Return the results of a study; a worker that flies and a worker that tries are killed if the folder has no markers yet."""
    found: dict[str, list[Any]] = {}

    def build(results: Mapping[str, list[Any]]) -> Section:
        found.update(results)
        return Section("results")

    jobs = {
        "flights": Job(_scenario("estimator", folder / "flights"), RUNS, ("q_deg_s",)),
        "trials": Trials(dying.draw, (str(folder / "trials"),), RUNS),
    }
    reproduce(Study("dying", "Dying", RUNS, lambda _: [keyed_part(jobs, build)]), RUNS, executor=executor)
    return found


def _assert_undisturbed(found: Mapping[str, list[Any]], dying: ModuleType, folder: Path) -> None:
    assert {p.name for p in folder.iterdir()} == {"flights", "trials"}  # both workers were killed
    undisturbed = _results(dying, folder, None)
    assert found["trials"] == undisturbed["trials"]
    assert [f.seed for f in found["flights"]] == list(range(RUNS))
    for one, other in zip(found["flights"], undisturbed["flights"], strict=True):
        assert (one.seed, one.metrics) == (other.seed, other.metrics)
        assert one.columns["q_deg_s"].tobytes() == other.columns["q_deg_s"].tobytes()


@pytest.mark.parametrize("workers", [1, pytest.param(2, marks=pytest.mark.long)])
def test_a_study_with_killed_workers_has_the_results_of_an_undisturbed_one(
    dying: ModuleType, tmp_path: Path, workers: int
) -> None:
    folder = tmp_path / "markers"
    folder.mkdir()
    with using("dying.py:estimator"):
        _assert_undisturbed(_results(dying, folder, opener(workers)), dying, folder)


@pytest.mark.long
def test_on_a_dask_cluster_too(
    dying: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("distributed")
    folder = tmp_path / "markers"
    folder.mkdir()
    monkeypatch.setitem(families._BUILT_IN["studies"], "tiny", "tests.studies.tiny:tiny")
    with dask_cluster.scheduler(tmp_path) as address, dask_cluster.workers(address, tmp_path):
        with using("dying.py:estimator"):
            _assert_undisturbed(_results(dying, folder, opener(None, address)), dying, folder)
        tables = []
        for where in (["--scheduler", address], ["--workers", "1"]):
            with pytest.raises(SystemExit, match="0"):
                cli.main(["reproduce", "tiny", "--runs", "1", "--json", *where])
            tables.append(json.loads(capsys.readouterr().out)["tables"])
        assert tables[0] == tables[1]


def test_a_trial_that_kills_every_time_is_named(dying: ModuleType) -> None:
    trials = [Trials(dying.deadly, (99,), 5), Trials(dying.deadly, (13,), RUNS)]
    done: list[int] = []
    with pytest.raises(InputError) as caught:
        run_trials(trials, executor=opener(1), progress=done.append)
    assert str(caught.value) == (
        f"case 2 of 2, dying.deadly with the arguments (13,), seed 13: the worker process died {DEATHS} times while it ran only this "
        "case and seed; free memory, or correct the compiled or own code that this case uses"
    )
    assert sum(done) == 5 + RUNS - 10  # the others, except the seeds of the same chunk


def test_a_flight_that_kills_every_time_is_named_by_its_settings(dying: ModuleType, tmp_path: Path) -> None:
    (tmp_path / "marker").touch()
    with using("dying.py:estimator", "dying.py:deadly_estimator"):
        jobs = [Job(_scenario(name, tmp_path / "marker"), 1, (), 7) for name in ("estimator", "deadly_estimator")]
        with pytest.raises(InputError) as caught:
            fly_jobs(jobs, executor=opener(1))
    assert str(caught.value).startswith(
        "case 2 of 2, scenario 'elevator-loss' (estimators.0.kind = dying.py:deadly_estimator), seed 7: the worker process died"
    )
