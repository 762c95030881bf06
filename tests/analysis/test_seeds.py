"""Ensembles: seeds in order, equal results on any executor, and histories over flights of any length."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest

from flightbed.analysis import seeds
from flightbed.analysis.metrics import Metrics
from flightbed.analysis.seeds import Flown, Job, fly_chunk, fly_jobs, histories, processes
from flightbed.core.errors import ScenarioError
from flightbed.core.versions import identity
from flightbed.runs.run import run
from flightbed.scenario.reading import Scenario, load_scenario
from tests.campaigns.test_journal import backwards

NOTHING = Metrics(False, None, None, None, None, {})


def _scenario(*overrides: str) -> Scenario:
    return load_scenario("thesis-loss", ["duration_s=6", *overrides])


@pytest.fixture(scope="module")
def jobs() -> list[Job]:
    columns = ("t_s", "q_deg_s", "window.effectiveness_smoothed")
    return [Job(_scenario(), 5, columns, first_seed=3), Job(_scenario("failures.0.to=0.5"), 2, columns[1:])]


@pytest.fixture(scope="module")
def flown(jobs: list[Job]) -> list[list[Flown]]:
    """The jobs in this process, in one chunk each."""
    return fly_jobs(jobs)


def _assert_the_same(found: list[list[Flown]], expected: list[list[Flown]]) -> None:
    for ours, theirs in zip(found, expected, strict=True):
        assert [f.seed for f in ours] == [f.seed for f in theirs]
        assert [f.metrics for f in ours] == [f.metrics for f in theirs]
        for one, other in zip(ours, theirs, strict=True):
            assert one.columns.keys() == other.columns.keys()
            for name, values in one.columns.items():
                assert values.tobytes() == other.columns[name].tobytes(), (one.seed, name)


def test_every_flight_is_the_one_that_its_seed_flies_alone(jobs: list[Job], flown: list[list[Flown]]) -> None:
    assert [[f.seed for f in flights] for flights in flown] == [[3, 4, 5, 6, 7], [0, 1]]
    assert [tuple(f.columns) for f in (flown[0][0], flown[1][0])] == [job.columns for job in jobs]
    alone = run(_scenario("seed=6"))
    flight = flown[0][3]
    assert flight.metrics == alone.metrics
    for name, values in flight.columns.items():
        assert np.array_equal(values, alone.trace[name])
    assert len({f.columns["q_deg_s"].tobytes() for flights in flown for f in flights}) == 7


def test_chunks_threads_and_processes_change_no_bit(
    jobs: list[Job], flown: list[list[Flown]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Five flights in chunks of two, and two; a chunk ends inside the first job and none reaches into the next."""
    monkeypatch.setattr(seeds, "CHUNK", 2)
    done: list[int] = []
    _assert_the_same(fly_jobs(jobs, progress=done.append), flown)
    assert done == [2, 2, 1, 2]
    done.clear()
    with ThreadPoolExecutor(3) as threads:
        _assert_the_same(fly_jobs(jobs, executor=threads, progress=done.append), flown)
    assert sorted(done) == [1, 2, 2, 2]
    done.clear()
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    with processes(2) as executor:
        assert executor is not None
        threads_of_a_worker = [
            executor.submit(os.getenv, f"{name}_NUM_THREADS").result() for name in ("OMP", "OPENBLAS")
        ]
        assert threads_of_a_worker == ["3", "1"]  # as the environment says; where it says nothing, one
        assert executor.submit(signal.getsignal, signal.SIGINT).result() == signal.SIG_IGN
        _assert_the_same(fly_jobs(jobs, executor=executor, progress=done.append), flown)
        with pytest.raises(ScenarioError) as caught:  # a worker's problems are reported like those of this process
            fly_jobs([Job(_scenario("condition.mach=0.5", "condition.gamma_deg=3"), 3)], executor=executor)
        places = [line.partition(":")[0] for line in str(caught.value).splitlines()]
        assert places == ["condition.mach", "condition.gamma_deg"]
    assert sorted(done) == [1, 2, 2, 2]
    assert (os.environ["OMP_NUM_THREADS"], os.getenv("OPENBLAS_NUM_THREADS")) == ("3", None)  # ours is as it was


@pytest.mark.parametrize("runs", [0, 1, 9, 10, 11, 20, 21])
def test_chunk_borders(runs: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """With substitutes for the flights: every seed once, in order, at most CHUNK per task, the remainder last."""
    chunks: list[int] = []

    def flights(job: Job) -> list[Flown]:
        chunks.append(job.runs)
        return [Flown(seed, NOTHING, {}) for seed in range(job.first_seed, job.first_seed + job.runs)]

    monkeypatch.setattr(seeds, "fly_chunk", flights)
    done: list[int] = []
    (found,) = fly_jobs([Job(_scenario(), runs, first_seed=100)], progress=done.append)
    assert [f.seed for f in found] == list(range(100, 100 + runs))
    assert chunks == done == [10] * (runs // 10) + [runs % 10] * (runs % 10 > 0)


def test_order_is_that_of_the_seeds_not_of_the_finish(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(seeds, "CHUNK", 1)
    monkeypatch.setattr(seeds, "fly_chunk", lambda job: [Flown(job.first_seed, NOTHING, {})])

    jobs = [Job(_scenario(), 4), Job(_scenario(), 3, first_seed=9)]
    found = fly_jobs(jobs, executor=backwards(monkeypatch))
    assert [[f.seed for f in flights] for flights in found] == [[0, 1, 2, 3], [9, 10, 11]]


class _Held(Executor):
    """An executor that completes the first task with ``end`` and starts no other."""

    def __init__(self, end: Callable[[Future[Any]], None]) -> None:
        self.end, self.futures = end, list[Future[Any]]()

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()
        if not self.futures:
            self.end(future)
        self.futures.append(future)
        return future


def test_an_exception_of_a_worker_propagates_and_cancels_what_has_not_begun() -> None:
    held = _Held(lambda future: future.set_exception(RuntimeError("lost a wing")))
    with pytest.raises(RuntimeError, match="lost a wing"):
        fly_jobs([Job(_scenario(), 40)], executor=held)
    assert [f.cancelled() for f in held.futures] == [False, True, True, True]


def test_an_interrupt_cancels_what_has_not_begun() -> None:
    def interrupted(_flights: int) -> None:
        raise KeyboardInterrupt

    held = _Held(lambda future: future.set_result(([], dict(identity()))))
    with pytest.raises(KeyboardInterrupt):
        fly_jobs([Job(_scenario(), 40)], executor=held, progress=interrupted)
    assert [f.cancelled() for f in held.futures] == [False, True, True, True]


def test_an_exception_here_and_now_propagates() -> None:
    with pytest.raises(KeyError, match="no_such_column"):
        fly_chunk(Job(_scenario(), 1, ("no_such_column",)))


def test_one_worker_is_no_executor(monkeypatch: pytest.MonkeyPatch) -> None:
    with processes(1) as executor:
        assert executor is None
    monkeypatch.setattr("os.cpu_count", lambda: 1)
    with processes() as executor:
        assert executor is None


def _flown(*columns: list[float]) -> list[Flown]:
    return [Flown(seed, NOTHING, {"x": np.array(values)}) for seed, values in enumerate(columns)]


def test_histories_of_flights_of_unequal_length_are_numpys(rng: np.random.Generator) -> None:
    columns = [rng.normal(5.0, 2.0, n).tolist() for n in (7, 12, 3, 12, 9, 15)]
    mean, std, flying = histories(_flown(*columns), "x")
    assert flying.tolist() == [6, 6, 6, 5, 5, 5, 5, 4, 4, 3, 3, 3, 1, 1, 1]
    for k, (m, s) in enumerate(zip(mean, std, strict=True)):
        there = [c[k] for c in columns if len(c) > k]
        assert m == pytest.approx(np.mean(there), rel=1e-14)
        assert s == pytest.approx(np.std(there, ddof=1) if len(there) > 1 else 0.0, rel=1e-12)


def test_histories_of_one_flight_are_the_flight() -> None:
    mean, std, flying = histories(_flown([1.0, 2.0, 4.0]), "x")
    assert (mean.tolist(), std.tolist(), flying.tolist()) == ([1.0, 2.0, 4.0], [0.0, 0.0, 0.0], [1, 1, 1])


def test_histories_of_what_is_infinite_at_first() -> None:
    """Infinite values, as in the bound of K without information: flights are counted by their length, without warnings."""
    mean, std, flying = histories(_flown([np.inf, 1.0, 3.0], [np.inf, 3.0]), "x")
    assert (mean.tolist(), flying.tolist()) == ([np.inf, 2.0, 3.0], [2, 2, 1])
    assert np.isnan(std[0])
    assert std[1:] == pytest.approx([np.sqrt(2.0), 0.0])
