"""`flightbed upgrade`: rewrites a file of version 0.1."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from flightbed.core import data
from tests.command_line import call, flightbed
from tests.scenario.test_version_0_1 import FOLDER, HAND_WRITTEN


def test_a_file_is_rewritten_once_and_what_was_removed_is_printed(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(HAND_WRITTEN)
    file.chmod(0o640)
    done = flightbed("upgrade", "mine.toml", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "mine.toml: failures.0.to = 0.2 removed: no effect with kind = 'cg-shift'" in done.stdout.splitlines()
    assert (
        "mine.toml: estimators.0.window = 20 removed: no effect with estimators.0.memory = 'expanding'" in done.stdout
    )
    once = file.read_text()
    assert "# a comment between" in once
    assert call("upgrade", "mine.toml", cwd=tmp_path).stdout == "mine.toml: nothing to change\n"
    assert file.read_text() == once
    assert [path.name for path in tmp_path.iterdir()] == ["mine.toml"]


def test_a_resolved_file_becomes_short(tmp_path: Path) -> None:
    file = tmp_path / "scenario.toml"
    shutil.copy(FOLDER / "elevator-loss.toml", file)
    before = len(file.read_text().splitlines())
    assert call("upgrade", "scenario.toml", cwd=tmp_path).returncode == 0
    assert len(file.read_text().splitlines()) < 0.6 * before


@pytest.mark.parametrize("kind", ["campaign", "aircraft", "scenario"])
def test_a_shipped_file_has_nothing_to_change(tmp_path: Path, kind: str) -> None:
    shipped = {
        "campaign": data.shipped("campaign") / "noise.toml",
        "aircraft": data.shipped("aircraft") / "sillence" / "aircraft.toml",
        "scenario": data.shipped("scenario") / "nominal.toml",
    }[kind]
    file = tmp_path / shipped.name
    shutil.copy(shipped, file)
    done = call("upgrade", file.name, cwd=tmp_path)
    assert done.stdout == f"{file.name}: nothing to change\n", done.stderr
    assert file.read_bytes() == shipped.read_bytes()


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("mine.toml", HAND_WRITTEN.replace("duration_s", "durations"), "mine.toml: unknown key durations; did you mean duration_s?"),
        ("mine.toml", "a = = 1", "mine.toml: not TOML"),
        ("mine.toml", 'schema = 1\nname = "a"\nbase = "nominal"\nrunz = 1\n', "mine.toml: unknown key runz; did you mean runs?"),
        ("aircraft.toml", 'schema = 1\nkind = "linear"\n', "aircraft.toml: name is missing"),
    ],
)  # fmt: skip
def test_an_invalid_file_is_refused_and_stays_as_it_is(tmp_path: Path, name: str, text: str, message: str) -> None:
    file = tmp_path / name
    file.write_text(text)
    done = call("upgrade", name, cwd=tmp_path)
    assert done.returncode == 2
    assert message in done.stderr
    assert all(line.startswith("flightbed: ") for line in done.stderr.splitlines())
    assert done.stdout == ""
    assert file.read_text() == text
    assert [path.name for path in tmp_path.iterdir()] == [name]


def test_a_file_that_does_not_exist_is_refused(tmp_path: Path) -> None:
    done = call("upgrade", "none.toml", cwd=tmp_path)
    assert done.returncode == 2
    assert "none.toml: cannot be read" in done.stderr
