"""Histories over flights against numpy's mean, deviation and percentiles, for any lengths and any order of the flights."""

from __future__ import annotations

import io
import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow.parquet as pq
import pytest
from rich.console import Console

from flightbed.campaigns import run as campaigns
from flightbed.campaigns import worker
from flightbed.campaigns.file import load_programme
from flightbed.campaigns.histories import Histories
from flightbed.campaigns.plan import Programme, scenario_of, select_points
from flightbed.campaigns.report.histories import histories_sections
from flightbed.campaigns.settings import CampaignSettings
from flightbed.campaigns.worker import chunk_of
from flightbed.cli.campaign import campaign_lines
from flightbed.parallel.executor import CHUNK
from flightbed.runs.run import run as fly_one
from flightbed.statistics import histories
from flightbed.statistics.histories import PERCENTILES, Ensemble, Part

Vector = npt.NDArray[np.float64]

SHORT = ["duration_s=0.5", "failures.0.at_s=0.2"]
GRID = """
schema = 1
name = "grid"
base = "elevator-loss"
runs = 7
seed = 3
[[axes]]
key = "failures.0.to"
values = [0.2, 0.6]
[[axes]]
key = "condition.mach"
values = [0.7, 0.8]
"""


def _grid(folder: Path, more: str = "", runs: int | None = None) -> Programme:
    (folder / "grid.toml").write_text(GRID + more)
    return load_programme(folder / "grid.toml", SHORT, runs)


def _at_every_tick(flights: list[Vector]) -> list[Vector]:
    """Values of the flights that still fly, tick by tick."""
    return [np.array([f[k] for f in flights if len(f) > k]) for k in range(max(map(len, flights)))]


@pytest.mark.parametrize("lengths", [(9,), (7, 12, 3, 12, 9, 15), (5,) * 40, (1, 2, 3, 4, 5)])
def test_percentiles_are_numpys_whatever_the_lengths(rng: np.random.Generator, lengths: tuple[int, ...]) -> None:
    flights = [rng.normal(5.0, 2.0, n) for n in lengths]
    found = histories.percentiles(flights, max(lengths) + 2)
    assert found.shape == (5, max(lengths) + 2)
    assert np.isnan(found[:, -2:]).all()
    for k, there in enumerate(_at_every_tick(flights)):
        # Single precision has 24 bits: half a unit in the last place is 2^-24 of the value.
        assert found[:, k] == pytest.approx(np.percentile(there, PERCENTILES), rel=2.0**-23)


def test_the_percentiles_do_not_depend_on_the_order_of_the_flights(rng: np.random.Generator) -> None:
    flights = [rng.normal(size=n) for n in rng.integers(1, 30, 60)]
    found = histories.percentiles(flights, 40)
    again = histories.percentiles([flights[i] for i in rng.permutation(60)], 40)
    assert found.tobytes() == again.tobytes()


def test_infinite_values_rank_last_without_a_warning() -> None:
    found = histories.percentiles([np.array([v]) for v in (1.0, 2.0, 3.0, np.inf, np.inf)], 1)[:, 0]
    assert found[1:3].tolist() == [2.0, 3.0]
    assert np.isinf(found[3])


def test_an_ensemble_agrees_with_numpy_and_survives_a_file(rng: np.random.Generator, tmp_path: Path) -> None:
    flights = [rng.normal(5.0, 2.0, n) for n in (7, 12, 3, 12, 9, 15)]
    parts = [Part.of({"x": flight}, sampled=i < 4) for i, flight in enumerate(flights)]
    whole = parts[0] + parts[1] + parts[2] + (parts[3] + parts[4] + parts[5])
    np.savez(tmp_path / "part.npz", **whole.arrays())  # type: ignore[arg-type]
    with np.load(tmp_path / "part.npz") as found:
        ensemble = Ensemble.of(Part.of_arrays(dict(found)))
    assert (ensemble.sampled, ensemble.moments.flying.tolist()) == (4, [6, 6, 6, 5, 5, 5, 5, 4, 4, 3, 3, 3, 1, 1, 1])
    for k, there in enumerate(_at_every_tick(flights)):
        assert ensemble.moments.mean["x"][k] == pytest.approx(np.mean(there), rel=1e-14)
        assert ensemble.moments.std("x")[k] == pytest.approx(
            np.std(there, ddof=1) if len(there) > 1 else 0.0, rel=1e-12
        )
    for k, there in enumerate(_at_every_tick(flights[:4])):
        assert ensemble.percentiles["x"][:, k] == pytest.approx(np.percentile(there, PERCENTILES), rel=2.0**-23)
    again = Ensemble.of_arrays(ensemble.arrays())
    assert all(np.array_equal(again.arrays()[n], a, equal_nan=True) for n, a in ensemble.arrays().items())


def _parts(programme: Programme, rng: np.random.Generator) -> tuple[list[dict[int, Part]], list[dict[str, Vector]]]:
    """Parts of the chunks of synthetic flights of any length, and the flights."""
    flights = [{"x": rng.normal(i, 1.0, int(rng.integers(1, 9)))} for i in range(len(programme))]
    chunks: list[dict[int, Part]] = []
    for number in range(-(-len(programme) // CHUNK)):
        chunk = chunk_of(programme, number)
        parts: dict[int, Part] = {}
        for flight in chunk.flights:
            if flight.index in chunk.with_histories:
                one = Part.of(flights[flight.index], sampled=flight.index in chunk.sampled)
                histories.add_all(parts, {flight.point: one})
        chunks.append(parts)
    return chunks, flights


@pytest.mark.parametrize("runs", [1, 3, 7, 10, 26])
def test_any_order_and_any_number_of_restarts_give_the_same_sum(
    rng: np.random.Generator, tmp_path: Path, runs: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Points begin and end within chunks; a restart after every chunk continues with the files on disk."""
    monkeypatch.setattr(worker, "SAMPLE", 20)
    programme = _grid(tmp_path, runs=runs)
    chunks, flights = _parts(programme, rng)
    straight = Histories(programme)
    for number, parts in enumerate(chunks):
        straight.add(number, parts)
    folder = tmp_path / "x"
    folder.mkdir()
    for number in rng.permutation(len(chunks)).tolist():
        once = Histories(programme, folder)
        assert not once.has(number)
        once.add(number, chunks[number])
    restarted = Histories(programme, folder)
    assert restarted.number == straight.number == len(chunks)
    assert not list(folder.glob("histories-*.npz"))  # a complete point needs no flights any more
    for point, ensemble in straight.ensembles.items():
        for name, array in ensemble.arrays().items():
            assert restarted.ensembles[point].arrays()[name].tobytes() == array.tobytes(), name
        there = [f["x"] for f in flights[point * runs : (point + 1) * runs]]
        assert ensemble.sampled == min(runs, 20)
        middle = [np.median(v) for v in _at_every_tick(there[:20])]
        assert ensemble.percentiles["x"][2][: len(middle)] == pytest.approx(middle, rel=2.0**-23)
        assert ensemble.moments.mean["x"] == pytest.approx([np.mean(v) for v in _at_every_tick(there)], rel=1e-13)
    assert list(straight.ensembles) == [0, 1, 2, 3]


def test_a_stored_chunk_that_is_not_in_the_sum_is_added(rng: np.random.Generator, tmp_path: Path) -> None:
    """The state after a kill between the two steps: the file of the chunk exists, without any other record."""
    programme = _grid(tmp_path)
    chunks, _ = _parts(programme, rng)
    (tmp_path / "x").mkdir()
    book = Histories(programme, tmp_path / "x")
    book.add(0, chunks[0])
    before = (tmp_path / "x" / "histories.npz").read_bytes()
    shutil.copytree(tmp_path / "x", tmp_path / "y")
    book.add(1, chunks[1])
    shutil.copy(tmp_path / "x" / "histories-1.npz", tmp_path / "y")
    assert (tmp_path / "y" / "histories.npz").read_bytes() == before
    late = Histories(programme, tmp_path / "y")
    assert late.has(1)
    assert late.number == 2


def test_a_chunk_without_flights_adds_nothing(rng: np.random.Generator, tmp_path: Path) -> None:
    programme = _grid(tmp_path)
    chunks, _ = _parts(programme, rng)
    book = Histories(programme)
    for number in (2, 0, 1):
        book.add(number, {} if number == 1 else chunks[number])
    assert book.number == 3
    assert [e.moments.flying[0] for e in book.ensembles.values()] == [7, 3, 1, 7]  # flights 10 to 19 are missing


def _from_flights(programme: Programme, point: int, column: str) -> list[Vector]:
    """A column of the flights of a point, flown one by one."""
    indices = range(point * programme.runs, (point + 1) * programme.runs)
    return [fly_one(scenario_of(programme.raw, programme.flight(i))).trace[column] for i in indices]


@pytest.mark.usefixtures("in_this_process")
def test_the_folder_holds_the_histories_of_every_point(tmp_path: Path) -> None:
    programme = _grid(tmp_path)
    flown, folder = campaigns.run(programme, tmp_path / "x", workers=1)
    assert flown is not None
    table = pq.read_table(folder / "histories.parquet")
    assert table.schema.field("q_deg_s.p95").metadata == {b"unit": b"deg/s"}
    found = table.to_pandas()
    assert found["point"].unique().tolist() == [0, 1, 2, 3]
    for point in (0, 3):
        there = found[found["point"] == point]
        assert there["t_s"].to_numpy() == pytest.approx(np.arange(50) / 100.0, abs=0.0)
        flights = np.array(_from_flights(programme, point, "scheduled.effectiveness_smoothed"))
        for part, expected in (
            ("mean", flights.mean(axis=0)), ("std", flights.std(axis=0, ddof=1)), ("p5", np.percentile(flights, 5, axis=0)),
            ("p95", np.percentile(flights, 95, axis=0)),
        ):  # fmt: skip
            ours = there[f"scheduled.effectiveness_smoothed.{part}"].to_numpy()
            assert ours == pytest.approx(expected, rel=1e-6, abs=1e-7), part
    summary = json.loads((folder / "summary.json").read_text())["histories"]
    assert summary == {"points": [0, 1, 2, 3], "percentiles_of_flights": histories.SAMPLE}
    pictures = {p.key: p for section in histories_sections(flown) for p in section.items if hasattr(p, "svg")}
    assert set(pictures) == {
        "points-q-deg-s",
        "points-scheduled-effectiveness-smoothed",
        "points-expanding-effectiveness-smoothed",
    }
    for picture in pictures.values():
        for words in ("to 0.2, mach 0.7", "to 0.6, mach 0.8"):
            assert words in picture.svg


def test_the_first_flights_of_a_point_are_the_sample(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(worker, "SAMPLE", 4)
    programme = _grid(tmp_path)
    flown = campaigns.fly(programme)
    flights = np.array(_from_flights(programme, 1, "q_deg_s"))
    assert (flown.histories[1].sampled, flown.histories[1].moments.flying[0]) == (4, 7)
    expected = np.percentile(flights[:4], PERCENTILES, axis=0)
    assert flown.histories[1].percentiles["q_deg_s"] == pytest.approx(expected, rel=1e-6, abs=1e-7)
    assert flown.histories[1].moments.mean["q_deg_s"] == pytest.approx(flights.mean(axis=0), rel=1e-12, abs=1e-15)
    (section,) = histories_sections(flown)
    assert "first 4 flights" in section.text[0]
    # 1.96 sqrt(5 95 / 4) and so on
    assert "5 +-21.4, 25 +-42.4, 50 +-49.0" in section.text[0]


@pytest.mark.usefixtures("in_this_process")
@pytest.mark.parametrize(("more", "kept"), [('keep = "none"', []), ('keep = "chosen"\npoints = [2, 0]', [0, 2])])
def test_points_that_keep_histories_are_chosen(tmp_path: Path, more: str, kept: list[int]) -> None:
    flown, folder = campaigns.run(_grid(tmp_path, f"[histories]\n{more}\n", runs=3), tmp_path / "x", workers=1)
    assert flown is not None
    assert sorted(flown.histories) == kept
    assert (folder / "histories.parquet").exists() == bool(kept)
    sections = histories_sections(flown)
    assert [s.text[-1] for s in sections] == ["Shown are 2 of 4 points; the campaign file selects 2."] * bool(kept)


def test_of_many_points_a_few_that_span_the_grid_keep_histories(tmp_path: Path) -> None:
    wide = GRID.replace("values = [0.2, 0.6]", "from = 0.2\nto = 0.95\ncount = 16")
    (tmp_path / "wide.toml").write_text(wide.replace("values = [0.7, 0.8]", "from = 0.6\nto = 0.8\ncount = 8"))
    programme = load_programme(tmp_path / "wide.toml", SHORT)
    assert len(programme.history_points) == 12
    values = [programme.points[p] for p in sorted(programme.history_points)]
    for key, ends in (("failures.0.to", (0.2, 0.95)), ("condition.mach", (0.6, 0.8))):
        assert (min(v[key] for v in values), max(v[key] for v in values)) == ends
    assert len(_grid(tmp_path).history_points) == 4


def _settings(**changes: Any) -> CampaignSettings:
    axes = tuple({"key": f"a.{i}", "values": tuple(range(n))} for i, n in enumerate(changes.pop("lengths")))
    return CampaignSettings.model_validate({"schema": 1, "name": "x", "base": "y", "runs": 1, "axes": axes, **changes})


def test_few_of_many() -> None:
    grid = select_points(_settings(lengths=(8, 8)), range(64), 12)
    assert sorted({p // 8 for p in grid}) == [0, 4, 7]
    assert sorted({p % 8 for p in grid}) == [0, 2, 5, 7]
    assert len(grid) == 12
    assert select_points(_settings(lengths=(40,)), range(40), 5) == [0, 10, 20, 29, 39]
    assert select_points(_settings(lengths=(20, 20), combine="paired"), range(20), 3) == [0, 10, 19]
    assert select_points(_settings(lengths=(3, 4)), range(12), 12) == list(range(12))
    assert select_points(None, [0], 12) == [0]
    assert select_points(_settings(lengths=(8, 8)), [1, 5, 9], 2) == [1, 9]  # chosen points have no grid
    assert 0 < len(select_points(_settings(lengths=(5, 5, 5)), range(125), 12)) <= 12


def test_the_terminal_lists_few_points_within_its_width(tmp_path: Path) -> None:
    screen = Console(width=80, record=True, file=io.StringIO())
    for line in campaign_lines(campaigns.fly(_grid(tmp_path, runs=2)), Path("x")):
        screen.print(line, soft_wrap=isinstance(line, str))
    shown = screen.export_text()
    assert (
        max(len(line) for line in shown.splitlines() if "worst flight:" not in line) <= 80
    )  # that line is for copying
    assert [line.split()[:3] for line in shown.splitlines() if line.split()[1:2] in (["0.2"], ["0.6"])] == [
        ["0", "0.2", "0.7"], ["1", "0.2", "0.8"], ["2", "0.6", "0.7"], ["3", "0.6", "0.8"],
    ]  # fmt: skip
    for word in ("failures.0.to", "condition.mach", "departed,", "tracking"):
        assert word in shown
