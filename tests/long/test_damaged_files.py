"""Damaged files of every kind that a command reads: an error of one line and exit code 2, or a correct result."""

from __future__ import annotations

import json
import shutil
import tomllib
from collections.abc import Callable
from contextlib import nullcontext
from itertools import islice
from pathlib import Path
from typing import Any

import jsbsim
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import tomli_w

from flightbed.aircraft.overlay import load_aircraft
from flightbed.analysis.comparison import load_runs, to_dict
from flightbed.analysis.trace import read_trace
from flightbed.campaigns import run as campaigns
from flightbed.campaigns.file import load_programme
from flightbed.core import data
from flightbed.models.linear_aircraft import load_flyable
from flightbed.report.comparison_report import comparison_report
from flightbed.runs.run import run
from flightbed.scenario.reading import load_scenario
from flightbed.studies.base import with_own
from flightbed.studies.estimators.study import estimators
from tests.long.damage import Commands, of_bytes, of_values, to_json
from tests.telemetry.viewers import needs_viewer

pytestmark = pytest.mark.long

LINEAR = ["duration_s=0.5", "failures.0.at_s=0.2"]  # of thesis-loss, on the linear plant
SET = [word for key in LINEAR for word in ("--set", key)]
CAMPAIGN = """
schema = 1
name = "grid"
base = "thesis-loss"
runs = 6
seed = 3
combine = "crossed"
[[axes]]
key = "failures.0.to"
values = [0.2, 0.5]
[[axes]]
key = "sensors.alpha_std_deg"
distribution = "uniform"
low = 0.02
high = 0.04
[[criteria]]
metric = "departed"
equals = false
[traces]
keep = "chosen"
indices = [2, 8]
"""
SETTINGS = """
name = "mine"
kind = "loop-gain"
model = "short-period"
memory = "window"
window = 20
smoothing = 0.9
bounds = [0.0, 1.0]
[prior]
effectiveness = 1.0
effectiveness_std = 0.5
"""


def _toml(value: Any) -> bytes:
    return tomli_w.dumps(value).encode()


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Folders of two runs."""
    folder = tmp_path_factory.mktemp("runs")
    for name, seed in (("sound", 1), ("other", 2)):
        run(load_scenario("thesis-loss", [*LINEAR, f"seed={seed}"]), folder / name, rerun=name == "other")
    return folder / "sound", folder / "other"


@pytest.fixture
def damaged(runs: tuple[Path, Path], tmp_path: Path) -> Path:
    """A copy of the second run, to be damaged."""
    return Path(shutil.copytree(runs[1], tmp_path / "damaged"))


def _compared(sound: Path, damaged: Path, *, page: bool) -> None:
    """Compare two runs; the page, with its figures, takes most of the time."""
    found = load_runs([sound, damaged])
    if page:
        comparison_report(found)
    json.dumps(to_dict(found), allow_nan=False)


@pytest.mark.parametrize("name", ["scenario.toml", "metrics.json", "trace.parquet"])
def test_compare_a_run_with_a_damaged_file(
    runs: tuple[Path, Path], damaged: Path, tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    commands, content = Commands(), (damaged / name).read_bytes()
    for label, bytes_ in of_bytes(content, flips=60):
        (damaged / name).write_bytes(bytes_)
        commands.flightbed(label, "compare", runs[0], damaged, "--out", "c")
        assert not (tmp_path / "c").exists() or label not in commands.wrong
    (damaged / name).unlink()
    assert not commands.flightbed("missing", "compare", runs[0], damaged, "--out", "c")
    (damaged / name).mkdir()
    assert not commands.flightbed("a folder", "compare", runs[0], damaged, "--out", "c")
    commands.check()


@pytest.mark.parametrize("name", ["scenario.toml", "metrics.json"])
def test_compare_a_run_with_values_of_other_types(runs: tuple[Path, Path], damaged: Path, name: str) -> None:
    text = (damaged / name).read_text()
    values, dump = (tomllib.loads(text), _toml) if name == "scenario.toml" else (json.loads(text), to_json)
    commands = Commands()
    cases = list(of_values(values, dump))[::3]  # 3 shares no factor with the number of damages of a value
    for number, (label, bytes_) in enumerate(cases):
        (damaged / name).write_bytes(bytes_)
        commands.call(label, lambda number=number: _compared(runs[0], damaged, page=number % 10 == 0))
    commands.check()


def test_compare_a_run_whose_trace_has_other_columns(runs: tuple[Path, Path], damaged: Path) -> None:
    path, commands = damaged / "trace.parquet", Commands()
    table = pq.read_table(path)
    n = len(table)
    others: dict[str, Callable[[], Any]] = {
        "text": lambda: pa.array(["a"] * n),
        "integers": lambda: pa.array(np.arange(n)),
        "nulls": lambda: pa.nulls(n, pa.float64()),
        "nan": lambda: pa.array(np.full(n, np.nan)),
        "infinite": lambda: pa.array(np.full(n, np.inf)),
        "lists": lambda: pa.array([[1.0]] * n),
        "times": lambda: pa.array(np.arange(n), pa.timestamp("us")),
        "booleans": lambda: pa.array([True] * n),
    }
    tables = {
        "no rows": table.slice(0, 0),
        "one row": table.slice(0, 1),
        "no metadata": table.replace_schema_metadata(None),
    }
    tables["other estimators"] = table.replace_schema_metadata({b"estimators": b"nobody,window"})
    tables["a byte that is not UTF-8"] = table.replace_schema_metadata({b"estimators": b"\xff"})
    tables["no columns"] = table.select([])
    tables["backwards"] = table.take(pa.array(np.arange(n)[::-1]))
    for i, column in enumerate(table.column_names):
        tables[f"without {column}"] = table.remove_column(i)
        tables |= {f"{column}: {kind}": table.set_column(i, column, make()) for kind, make in others.items()}
        tables[f"{column} twice"] = table.append_column(column, table.column(i))
    for number, (label, changed) in enumerate(tables.items()):
        pq.write_table(changed, path)
        commands.call(label, lambda number=number: _compared(runs[0], damaged, page=number % 5 == 0))
        commands.call(f"read_trace, {label}", lambda: read_trace(path))
    commands.check()


def test_run_a_damaged_scenario(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    scenario = load_scenario("thesis-loss", LINEAR)
    path, commands = tmp_path / "mine.toml", Commands()
    command = ["run", path, "--out", "x", "--rerun", "off", "--report", "off"]
    damages = [*of_bytes(scenario.to_toml().encode(), flips=100), *of_values(tomllib.loads(scenario.to_toml()), _toml)]
    for label, bytes_ in damages:
        path.write_bytes(bytes_)
        commands.flightbed(label, *command, codes=(2, 3), several=True)
    # Defect: a metric of this flight is nan, which metrics.json cannot hold.
    commands.check({"control.gains.q_s = -1": "ValueError"})


def test_plan_a_damaged_campaign(tmp_path: Path) -> None:
    path, commands = tmp_path / "grid.toml", Commands()
    for label, bytes_ in [*of_bytes(CAMPAIGN.encode(), flips=150), *of_values(tomllib.loads(CAMPAIGN), _toml)]:
        path.write_bytes(bytes_)
        commands.call(label, lambda: load_programme(path), several=True)
    commands.check()


def test_fly_a_damaged_campaign(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(campaigns, "opener", lambda *_: lambda: nullcontext(None))
    path, commands = tmp_path / "grid.toml", Commands()
    for label, bytes_ in of_bytes(CAMPAIGN.encode(), flips=20):
        path.write_bytes(bytes_)
        commands.flightbed(label, "campaign", path, "--runs", "2", *SET, "--out", "x", codes=(2, 3), several=True)
        shutil.rmtree(tmp_path / "x", ignore_errors=True)
    commands.check()


UNFINISHED = ["campaign.json", "rows.jsonl", "histories.npz", "histories-1.npz", "ensemble-0.npz"]


@pytest.mark.parametrize("name", UNFINISHED)
def test_resume_with_a_damaged_file(tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The table is that of the undisturbed campaign: a row whose checksum does not fit is flown again."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(campaigns, "opener", lambda *_: lambda: nullcontext(None))
    (tmp_path / "grid.toml").write_text(
        CAMPAIGN.replace("runs = 6", "runs = 15").replace("indices = [2, 8]", "indices = [2]")
    )
    programme = load_programme(tmp_path / "grid.toml", LINEAR)

    def stop(done: int, _total: int) -> None:
        if done >= 20:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        campaigns.run(programme, tmp_path / "stopped", progress=stop)
    _, whole = campaigns.run(programme, tmp_path / "whole")
    expected = pq.read_table(whole / "table.parquet").to_pylist()
    sound = tmp_path / "stopped" / "unfinished" / name
    assert sound.is_file(), sorted(p.name for p in sound.parent.iterdir())
    commands = Commands()
    damages = [*of_bytes(sound.read_bytes(), flips=25), ("missing", None)]
    if name == "campaign.json":
        damages += of_values(json.loads(sound.read_bytes()), to_json)
    if name == "rows.jsonl":
        first, *rest = sound.read_text().splitlines(keepends=True)
        # A row without its checksum, whatever it holds, takes the same way: every 60th of some 600 is enough.
        damages += [
            (label, text + b"\n" + "".join(rest).encode())
            for label, text in islice(of_values(json.loads(first.partition(" ")[2]), to_json), 0, None, 60)
        ]
    for label, bytes_ in damages:
        shutil.rmtree(tmp_path / "x", ignore_errors=True)
        shutil.copytree(tmp_path / "stopped", tmp_path / "x")
        (tmp_path / "x" / "unfinished" / name).unlink()
        if bytes_ is not None:
            (tmp_path / "x" / "unfinished" / name).write_bytes(bytes_)
        command = ["campaign", "grid.toml", *SET, "--out", "x", "--resume"]
        if commands.flightbed(label, *command):
            rows = pq.read_table(tmp_path / "x" / "table.parquet").to_pylist()
            differing = [i for i, (a, b) in enumerate(zip(rows, expected, strict=False)) if a != b]
            if len(rows) != len(expected) or differing:
                commands.wrong[label] = f"{len(rows)} rows, other values in rows {differing}"
            if (tmp_path / "x" / "histories.parquet").read_bytes() != (whole / "histories.parquet").read_bytes():
                commands.wrong[label] = "other histories"
    # Defect: the journal does not record which points have histories, so a missing file of a complete point goes unnoticed, and
    # histories.parquet lacks that point.
    lost = name in ("ensemble-0.npz", "histories-1.npz")
    known = {"missing": "histories of a point are lost"} if lost else None
    commands.check(known, recovers=name == "rows.jsonl")  # a damaged row is flown again


@pytest.mark.parametrize("name", ["aircraft.toml", "pitch.xml", "lateral.xml", "leveller.xml"])
def test_patch_with_a_damaged_aircraft_file(tmp_path: Path, name: str) -> None:
    """Up to the patched model. Defect: JSBSim itself aborts the process when it loads some damaged control systems."""
    folder = Path(shutil.copytree(data.shipped("aircraft") / "f16", tmp_path / "mine"))
    stock = (Path(jsbsim.get_default_root_dir()) / "aircraft" / "f16" / "f16.xml").read_bytes()
    commands, content = Commands(), (folder / name).read_bytes()
    for label, bytes_ in of_bytes(content, flips=60):
        (folder / name).write_bytes(bytes_)
        commands.call(label, lambda: load_aircraft(str(folder)).patch(stock), several=True)
    (folder / name).unlink()
    assert commands.call("missing", lambda: load_aircraft(str(folder)).patch(stock)) is None
    commands.check()


@pytest.mark.parametrize("aircraft", ["f16", "sillence"])
def test_read_an_aircraft_with_values_of_other_types(tmp_path: Path, aircraft: str) -> None:
    folder = Path(shutil.copytree(data.shipped("aircraft") / aircraft, tmp_path / "mine"))
    commands, values = Commands(), tomllib.loads((folder / "aircraft.toml").read_text())
    for label, bytes_ in of_values(values, _toml):
        (folder / "aircraft.toml").write_bytes(bytes_)
        commands.call(f"load_flyable, {label}", lambda: load_flyable(str(folder)))
        commands.call(f"load_aircraft, {label}", lambda: load_aircraft(str(folder)))
    commands.check()


def test_run_a_damaged_linear_aircraft(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    folder = Path(shutil.copytree(data.shipped("aircraft") / "sillence", tmp_path / "mine"))
    commands, path = Commands(), folder / "aircraft.toml"
    (tmp_path / "mine.toml").write_text(
        load_scenario("thesis-loss", LINEAR).to_toml().replace('sha256 = "', 'sha256 = "')
    )
    raw = tomllib.loads((tmp_path / "mine.toml").read_text())
    raw["aircraft"] = {"model": str(folder)}
    (tmp_path / "mine.toml").write_bytes(_toml(raw))
    for label, bytes_ in of_bytes(path.read_bytes(), flips=80):
        path.write_bytes(bytes_)
        commands.flightbed(label, "run", "mine.toml", "--out", "x", "--rerun", "off", "--report", "off", codes=(2, 3))
    commands.check()


def test_reproduce_with_damaged_settings(tmp_path: Path) -> None:
    path, commands = tmp_path / "mine.toml", Commands()
    for label, bytes_ in [*of_bytes(SETTINGS.encode(), flips=60), *of_values(tomllib.loads(SETTINGS), _toml)]:
        path.write_bytes(bytes_)
        commands.call(label, lambda: with_own(estimators(), (), [path]), several=True)
    commands.check()


def test_view_what_is_no_run(runs: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for variable in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(variable, raising=False)
    commands = Commands()
    (tmp_path / "empty").mkdir()
    (tmp_path / "file").write_text("hello")
    (tmp_path / "folders").mkdir()
    for name in ("flight.rrd", "trace.parquet", "scenario.toml", "metrics.json"):
        (tmp_path / "folders" / name).mkdir()
    for label, place in [
        ("no recording", runs[0]),
        ("no display", runs[1]),
        ("a name too long", "x" * 5000),
        ("a zero byte", "a\0b"),
    ]:
        commands.flightbed(label, "view", place)
    for name in ("empty", "file", "folders", "nowhere"):
        commands.flightbed(name, "view", tmp_path / name)
        commands.flightbed(f"compare, {name}", "compare", tmp_path / name, runs[0], "--out", tmp_path / "c")
    assert commands.done == 0
    commands.check()


@needs_viewer
def test_picture_of_a_damaged_recording(damaged: Path, tmp_path: Path) -> None:
    commands, path = Commands(), damaged / "flight.rrd"
    content = path.read_bytes()
    for label, bytes_ in {
        "empty": b"",
        "zeros": bytes(4096),
        "text": b"hello",
        "half": content[: len(content) // 2],
    }.items():
        path.write_bytes(bytes_)
        commands.flightbed(label, "view", damaged, "--picture", tmp_path / "p.png")
    commands.check()
