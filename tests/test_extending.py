"""docs/extending.md stays correct: the tests write its files and run its commands in the order of the page."""

from __future__ import annotations

import io
import json
import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from pathlib import Path

import pandas as pd
import pytest

from flightbed.cli import main as cli
from flightbed.config import families
from tests.flights import studies_in_this_process

ROOT = Path(__file__).resolve().parents[1]
PAGE = (ROOT / "docs" / "extending.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```(\w+)\n(.*?)```", PAGE, flags=re.DOTALL)


@contextmanager
def _there(folder: Path) -> Iterator[io.StringIO]:
    """Be in the folder, with what is installed there, and a short study; what was imported from it is forgotten afterwards."""
    modules, printed = set(sys.modules), io.StringIO()
    families._installed.cache_clear()
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(printed):
        patch.chdir(folder)
        patch.syspath_prepend(folder / "installed")
        patch.setitem(families._BUILT_IN["studies"], "estimators", "tests.studies.short_comparison:estimators")
        yield printed
    families._installed.cache_clear()
    for name in set(sys.modules) - modules:
        if str(folder) in str(getattr(sys.modules[name], "__file__", "")):
            del sys.modules[name]


def _run(line: str, folder: Path) -> str:
    program, *arguments = line.split()
    if program == "pytest":
        command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *arguments]
        environment = {**os.environ, "PYTHONPATH": str(ROOT)}
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, env=environment)
        assert (done.returncode, done.stderr) == (0, ""), done.stdout
        return done.stdout
    assert program == "flightbed", line
    with _there(folder) as printed, studies_in_this_process():
        cli.app(arguments)
    return printed.getvalue()


def _python(text: str, folder: Path) -> str:
    with _there(folder) as printed, pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(folder)  # like a script in that folder
        exec(compile(text, "extending.md", "exec"), {})
    return printed.getvalue()


def _install(project: str, folder: Path) -> None:
    """Install a project of one module: the module, and metadata with its entry points."""
    table = tomllib.loads(project)["project"]
    info = folder / "installed" / f"{table['name'].replace('-', '_')}-{table['version']}.dist-info"
    info.mkdir(parents=True)
    info.joinpath("METADATA").write_text(f"Metadata-Version: 2.1\nName: {table['name']}\nVersion: {table['version']}\n")
    groups = table["entry-points"]
    lines = [
        line
        for group, entries in groups.items()
        for line in (f"[{group}]", *(f"{k} = {v}" for k, v in entries.items()))
    ]
    info.joinpath("entry_points.txt").write_text("\n".join(lines) + "\n")
    for module in {value.partition(":")[0] for entries in groups.values() for value in entries.values()}:
        (folder / f"{module}.py").rename(folder / "installed" / f"{module}.py")  # importable from there only


@pytest.fixture(scope="module")
def outputs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Output of each command of the page."""
    folder, printed = tmp_path_factory.mktemp("extending"), {}
    for language, text in BLOCKS:
        named = re.match(r"# (\S+\.(?:py|toml))\n", text)
        if named and named[1] == "pyproject.toml":
            _install(text, folder)
        elif named:
            file = folder / named[1]
            file.parent.mkdir(exist_ok=True)
            file.write_text(text)
        elif language == "python":
            printed["python"] = _python(text, folder)
        else:
            assert language == "sh"
            for line in text.splitlines():
                printed[line] = _run(line, folder)
    printed["folder"] = str(folder)
    return printed


def test_every_command_of_the_page_flies(outputs: dict[str, str]) -> None:
    flown = {line: text for line, text in outputs.items() if line.startswith("flightbed run")}
    assert len(flown) == 9
    for line, text in flown.items():
        for name in re.findall(r"--use (\S+)", line):
            assert re.search(rf"own code\s+{re.escape(name)} \(sha256 [0-9a-f]{{12}}\)", text), line
        assert ("own code" in text) == ("--use" in line), line
        assert "flown to" in text, line  # nothing departs
    assert "pitch-least-squares" in outputs["flightbed list estimators"]
    assert "1 passed" in outputs["pytest test_pitch_ls.py"]
    (reproduced,) = (
        text for line, text in outputs.items() if line.startswith("flightbed reproduce estimators --runs 3")
    )
    assert re.search(
        r"^ *pitch-ls +\d+\.\d +0\.0\d{3} ", reproduced, flags=re.MULTILINE
    )  # time of an update, error of K
    assert 0.0 < float(outputs["python"]) < 0.1


def test_the_examples_of_the_page_have_the_described_results(outputs: dict[str, str]) -> None:
    runs = Path(outputs["folder"]) / "runs"
    options = []
    for name in ("my-filter", "my-filter-2"):
        stored = json.loads((runs / name / "metrics.json").read_text())
        assert stored["estimators"]["mine"]["median_abs_error_post"] < 0.1
        assert stored["estimators"]["built-in"]["median_abs_error_post"] < 0.05
        options.append(tomllib.loads((runs / name / "scenario.toml").read_text())["estimators"][0]["options"])
    assert options == [{"forgetting": 0.95}, {"forgetting": 0.99}]
    assert json.loads((runs / "constant" / "metrics.json").read_text())["estimators"]["constant"]["final"] == 0.9
    constant = tomllib.loads((runs / "constant" / "scenario.toml").read_text())["estimators"][0]
    assert constant.keys() == {"name", "kind", "model", "smoothing", "bounds", "value"}
    plug = pd.read_parquet(runs / "loose-plug" / "trace.parquet")
    lost = plug["effectiveness_true"] == 0.4
    assert [bool(lost[plug["t_s"] == t].iloc[0]) for t in (2.99, 3.0, 3.99, 4.0, 5.0, 6.0)] == [
        False,
        True,
        True,
        False,
        True,
        False,
    ]
    asked = pd.read_parquet(runs / "nominal" / "trace.parquet")["q_cmd_deg_s"]
    assert asked.max() == pytest.approx(5.0)
    assert asked[100] == pytest.approx(0.0, abs=1e-9)
    assert json.loads((runs / "my-jet" / "metrics.json").read_text())["estimators"]["filter"]["final"] == pytest.approx(
        0.4, abs=0.05
    )


def test_the_table_of_the_page_lists_every_key_that_names_code() -> None:
    rows = re.findall(r"^\| `([a-z.]+)` \|", PAGE, flags=re.MULTILINE)
    assert rows == ["estimators.kind", "control.law", "failures.kind", "command.kind"]
