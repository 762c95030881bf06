"""The benchmarks run: `--quick` measures every section, no time is asserted; and the scripts in tools/ can be loaded."""

from __future__ import annotations

import json
import math
import os
import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

BENCHMARKS = Path(__file__).resolve().parents[1] / "benchmarks"
TABLES = BENCHMARKS.parent / "tools" / "tables"
NUMBERS = ("median", "low", "high")


def _speed(*arguments: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONPATH": str(BENCHMARKS.parent)}
    command = [sys.executable, str(BENCHMARKS / "speed.py"), *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False, env=environment)


SECTIONS = ("loop", "estimators", "flights", "start-up", "recording", "memory")
FAST = tuple(name for name in SECTIONS if name != "start-up")  # which starts seven shells


@pytest.fixture(scope="module", params=[FAST, pytest.param(SECTIONS, marks=pytest.mark.long)], ids=["some", "all"])
def asked(request: pytest.FixtureRequest) -> tuple[str, ...]:
    """Sections of a smoke run."""
    found: tuple[str, ...] = request.param
    return found


@pytest.fixture(scope="module")
def quick(asked: tuple[str, ...], tmp_path_factory: pytest.TempPathFactory) -> tuple[str, dict[str, Any]]:
    """Output and file of a smoke run of these sections."""
    file = tmp_path_factory.mktemp("speed") / "speed.json"
    only = [] if asked == SECTIONS else ["--only", *asked]
    done = _speed("--quick", *only, "--json", str(file))
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    return done.stdout, json.loads(file.read_text())


@pytest.fixture
def measuring(monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    return import_module("measuring")


@pytest.mark.parametrize(
    ("section", "rows"),
    {
        "loop": {"bare stepping", "loop, no estimator", "loop, differentiated-rls", "loop, both estimators of elevator-loss"},
        "estimators": {"filterpy, plain filter", "plain filter", "window of 30, scheduled", "differentiated-rls"},
        "flights": {"linear aircraft, 1 worker", "F-16, 1 worker"},
        "start-up": {"flightbed run elevator-loss, the first", "flightbed list", "import flightbed"},
        "recording": {"flown into a trace", "metrics", "trace.parquet", "flight.rrd", "report.html"},
        "memory": {"each flight's trace and metrics, kept", "after 10"},
    }.items(),
)  # fmt: skip
def test_a_section_prints_finite_figures_and_writes_them(
    quick: tuple[str, dict[str, Any]], asked: tuple[str, ...], section: str, rows: set[str]
) -> None:
    printed, written = quick
    if section not in asked:
        assert section not in written["sections"]
        return
    tables = written["sections"][section]
    text = printed.partition(f"## {section}\n")[2].partition("\n## ")[0]
    assert rows <= {name for table in tables for name in table["rows"]}
    for table in tables:
        assert table["title"] in text
        for name, figures in table["rows"].items():
            assert figures, name
            line = next(line for line in text.splitlines() if line.startswith(f"| {name} "))
            cells = [cell.strip() for cell in line.strip("|").split("|")[1:]]
            assert sum(cell != "" for cell in cells) == len(figures)
            assert all(math.isfinite(float(number)) for cell in cells for number in cell.split(" ")[:1] if number)
            for figure in figures.values():
                assert figure["unit"]
                assert len(figure["values"]) == 1  # a size, or one round
                assert all(math.isfinite(figure[key]) for key in NUMBERS)


def test_all_sections_are_written_in_order_with_what_they_were_measured_on(
    quick: tuple[str, dict[str, Any]], asked: tuple[str, ...]
) -> None:
    _, written = quick
    assert tuple(written["sections"]) == asked
    assert written["quick"] is True
    assert written["rounds"] == 1
    assert written["machine"]["cores"] == os.cpu_count()


def test_figures_that_are_no_times_are_what_they_must_be(quick: tuple[str, dict[str, Any]]) -> None:
    """Sizes and memory have bounds of their own: a trace holds 8 bytes a value, and one process is one efficient worker."""
    sections = quick[1]["sections"]
    (recording,) = sections["recording"]
    ticks, columns = (int(part.split(" ")[0]) for part in recording["title"].split(", ")[-2:])
    assert ticks == 100
    assert recording["rows"]["flown into a trace"]["size"]["values"] == [ticks * columns * 8 / 1e3]
    (flights,) = sections["flights"]
    assert flights["rows"]["F-16, 1 worker"]["efficiency"]["values"] == [1.0]
    resident = [row["resident"]["median"] for row in sections["memory"][0]["rows"].values()]
    assert 0.0 < resident[0] < resident[1] < resident[2]


def test_only_the_sections_that_are_named_are_measured_and_rounds_are_given_one_value_each(tmp_path: Path) -> None:
    file = tmp_path / "speed.json"
    done = _speed("--quick", "--rounds", "3", "--only", "estimators", "--json", str(file))
    assert done.returncode == 0, done.stderr
    assert [line for line in done.stdout.splitlines() if line.startswith("## ")] == ["## estimators"]
    (table,) = json.loads(file.read_text())["sections"]["estimators"]
    for figures in table["rows"].values():
        for figure in figures.values():
            assert len(figure["values"]) == 3
            assert sorted(figure["values"])[1] == figure["median"]
            assert (figure["low"], figure["high"]) == (min(figure["values"]), max(figure["values"]))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--only", "loops"], "invalid choice: 'loops'"),
        (["--rounds", "0"], "--rounds: must be at least 1"),
        (["--rounds", "many"], "--rounds: invalid"),
    ],
)
def test_what_cannot_be_measured_is_refused(arguments: list[str], message: str) -> None:
    done = _speed("--quick", *arguments)
    assert done.returncode == 2
    assert message in done.stderr


def test_a_cell_without_a_figure_is_empty_and_is_not_written(measuring: Any) -> None:
    columns = (measuring.Column("time", "ms", ".1f"), measuring.Column("ratio", "1", ".0f"))
    table = measuring.Table("Title", columns, {"a": [[1.0, 2.0, 4.0], None], "b": [[3.0] * 3, [2.0] * 3]}, "Note.")
    lines = table.text().splitlines()
    assert lines[0] == "Title"
    assert [[cell.strip() for cell in line.split("|")[1:-1]] for line in (lines[2], *lines[4:6])] == [
        ["", "time, ms", "ratio"], ["a", "2.0 (1.0 to 4.0)", ""], ["b", "3.0", "2"],
    ]  # fmt: skip
    assert len({len(line) for line in lines[2:6]}) == 1  # aligned
    assert lines[-1] == "Note."
    first = table.to_dict()["rows"]["a"]
    assert first == {"time": {"unit": "ms", "median": 2.0, "low": 1.0, "high": 4.0, "values": [1.0, 2.0, 4.0]}}


@pytest.mark.parametrize("folder", [BENCHMARKS, TABLES], ids=lambda folder: folder.name)
def test_every_script_can_be_loaded(folder: Path, tmp_path: Path) -> None:
    """What they import is still there; in one process, in which none is the main program."""
    names = sorted(path.stem for path in folder.glob("*.py"))
    assert {"speed", "effectiveness"} & set(names)
    code = "import importlib, sys; sys.path.insert(0, sys.argv[1]); [importlib.import_module(n) for n in sys.argv[2:]]"
    command = [sys.executable, "-c", code, str(folder), *names]
    environment = {**os.environ, "PYTHONPATH": str(BENCHMARKS.parent), "MPLBACKEND": "Agg"}
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False, env=environment)
    assert done.returncode == 0, done.stderr
    assert list(tmp_path.iterdir()) == []


def test_the_documents_name_every_script_and_none_that_is_not_there() -> None:
    root = BENCHMARKS.parent
    text = "\n".join(page.read_text() for page in (root / "README.md", *(root / "docs").glob("*.md")))
    named = set(re.findall(r"(?:benchmarks|tools/tables)/\w+\.py", text))
    assert {name for name in named if not (root / name).is_file()} == set()
    page = (root / "docs" / "benchmarks.md").read_text()
    scripts = {path.name for folder in (BENCHMARKS, TABLES) for path in folder.glob("*.py")} - {"cells.py"}
    assert scripts <= set(re.findall(r"(\w+\.py)\b", page))


def test_ranges_of_tables_are_written_with_their_median(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(TABLES))
    likely = import_module("cells").likely
    assert likely([float(v) for v in range(101)], ".0f") == "50 (5 - 95)"
    assert likely([None, 7.0], ".0f") == "7 (7 - 7)"
    assert likely([None], ".0f") == "-"


def test_the_page_has_the_sections_and_rows_of_the_command(quick: tuple[str, dict[str, Any]]) -> None:
    """Rows that tell of numbers of flights or workers differ between a smoke run and a full one."""
    page = (BENCHMARKS.parent / "docs" / "benchmarks.md").read_text()
    for section, tables in quick[1]["sections"].items():
        part = page.partition(f"## {section.capitalize()}\n")[2].partition("\n## ")[0]
        written = {line.split("|")[1].strip() for line in part.splitlines() if line.startswith("| ")}
        rows = {name for table in tables for name in table["rows"] if not re.search(r"after \d+|workers", name)}
        assert rows <= written, section
