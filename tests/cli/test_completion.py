"""Shell completion: what the installed script asks for, and the installation."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from flightbed.config import families
from flightbed.core import data
from tests.command_line import assert_one_clear_line, flightbed


def offered(*words: str, cwd: Path) -> list[str]:
    """Return the words that the program offers for the last of these words; a shell keeps those that begin with it."""
    lines = flightbed("__complete", *words, cwd=cwd).stdout.splitlines()
    return [line.partition("\t")[0] for line in lines if line and not line.startswith("\x1f")]


def test_names_and_paths_are_offered(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").touch()
    (tmp_path / "notes.txt").touch()
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "other.toml").touch()
    paths = {"mine.toml", "folder/"}
    assert set(offered("run", "", cwd=tmp_path)) == {*data.names("scenario"), *paths}
    assert set(offered("campaign", "", cwd=tmp_path)) == {*data.names("campaign"), *data.names("scenario"), *paths}
    assert set(offered("trim", "", cwd=tmp_path)) == {*data.names("aircraft"), "folder/"}
    assert set(offered("linearize", "", cwd=tmp_path)) == {*data.names("aircraft"), "folder/"}
    assert set(offered("reproduce", "", cwd=tmp_path)) == {*families.built_in("studies"), "all"}
    assert "folder/other.toml" in offered("run", "folder/o", cwd=tmp_path)


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish", "powershell"])
def test_the_script_is_written_to_a_named_file_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, shell: str
) -> None:
    home = tmp_path / "home"
    home.mkdir()
    monkeypatch.setenv("HOME", str(home))
    done = flightbed("--install-completion", "--shell", shell, "-o", "script", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout == f"completion for {shell} is in {tmp_path / 'script'}; it works in the next shell\n"
    assert "__complete" in (tmp_path / "script").read_text()
    assert list(home.rglob("*")) == []


def test_bash_finds_the_script_and_completes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bash = shutil.which("bash")
    if bash is None:
        pytest.skip("needs bash")
    monkeypatch.setenv("HOME", str(tmp_path))
    done = flightbed("--install-completion", "--shell", "bash", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    script = tmp_path / ".local" / "share" / "bash-completion" / "completions" / "flightbed"
    assert done.stdout == f"completion for bash is in {script}; it works in the next shell\n"
    assert str(script) in (tmp_path / ".bashrc").read_text()
    program = tmp_path / "flightbed"
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m flightbed "$@"\n')
    program.chmod(0o755)
    words = f'COMP_WORDS=({program} run elevator-lo); COMP_CWORD=2; _flightbed; echo "${{COMPREPLY[@]}}"'
    found = subprocess.run([bash, "-c", f'source "{script}"; {words}'], capture_output=True, text=True, check=True)
    assert found.stdout.split() == ["elevator-loss", "elevator-loss-fixed"]


def test_errors_are_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    arguments = ["--install-completion", "--shell", "bash", "-o", "nowhere/script"]
    assert_one_clear_line(arguments, 2, "--output nowhere/script: there is no folder nowhere", cwd=tmp_path)
