"""A campaign continues only with the sources that started it: flightbed's own, and those of own code with its imports."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

from flightbed.core.data import shipped
from flightbed.core.sources import PACKAGE

BASE = ["--set", "duration_s=6", "--runs", "20", "--workers", "1"]
# Interrupted after the first chunk; flown in the process itself.
START = """
import sys
from contextlib import nullcontext
from flightbed.campaigns import run as campaigns
from flightbed.campaigns.file import load_programme
campaigns.opener = lambda *_: lambda: nullcontext(None)
from flightbed.config.own_code import using
def progress(done, total):
    if done:
        raise KeyboardInterrupt
name, out, *use = sys.argv[1:]
with using(*use):
    own = [f"estimators.0.kind={use[0]}"] if use else []
    try:
        campaigns.run(load_programme(name, ["duration_s=6", *own], 20), out, workers=1, replace=False, progress=progress)
    except KeyboardInterrupt as stop:
        assert "interrupted after 10 of 20 flights" in str(stop), stop
"""
OWN = """
from flightbed import Estimate
from helper import START
class Fixed:
    def __init__(self, settings, onboard):
        pass
    def update(self, measurement):
        return Estimate(START, 0.1, START)
"""


def start(tree: Path, cwd: Path, *arguments: str) -> None:
    environment = {**os.environ, "PYTHONPATH": str(tree)}
    subprocess.run([sys.executable, "-c", START, *arguments], env=environment, cwd=cwd, check=True)


def resume(tree: Path, cwd: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "flightbed", "campaign", arguments[0], *BASE, *arguments[1:], "--resume"]
    environment = {**os.environ, "PYTHONPATH": str(tree)}
    return subprocess.run(command, env=environment, cwd=cwd, capture_output=True, text=True, check=False)


def test_sources_edited_before_a_campaign_is_resumed(tmp_path: Path) -> None:
    tree = tmp_path / "tree"
    shutil.copytree(PACKAGE, tree / "flightbed", ignore=shutil.ignore_patterns("__pycache__"))
    for folder in ("aircraft", "scenarios"):
        (tree / folder).symlink_to(shipped(folder.removesuffix("s")))
    start(tree, tmp_path, "thesis-loss", "campaigns/thesis-loss")
    edited = tree / "flightbed" / "command" / "doublet.py"
    before = edited.read_text()
    edited.write_text(before + "# edited\n")
    for out in (["--out", "campaigns/thesis-loss"], []):  # with its folder, and with the default one
        done = resume(tree, tmp_path, "thesis-loss", *out)
        assert (done.returncode, done.stdout) == (2, ""), done.stderr
        head, _, rest = done.stderr.partition(" (got ")
        assert head == (
            "flightbed: --resume: campaigns/thesis-loss holds campaign 'thesis-loss' (20 flights), which was started by other sources: "
            "flightbed"
        )
        assert rest.endswith("; fly it anew (name another folder with --out), or restore those sources\n")
    edited.write_text(before)
    done = resume(tree, tmp_path, "thesis-loss")
    assert (done.returncode, done.stderr) == (0, ""), done.stderr
    assert "20 flights in" in done.stdout


def test_a_module_of_own_code_edited_before_a_campaign_is_resumed(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(OWN)
    (tmp_path / "helper.py").write_text("START = 0.5\n")
    own = ["--use", "mine.py:Fixed", "--set", "estimators.0.kind=mine.py:Fixed"]
    start(PACKAGE.parent, tmp_path, "thesis-loss", "c", "mine.py:Fixed")
    (tmp_path / "helper.py").write_text("START = 0.625\n")
    done = resume(PACKAGE.parent, tmp_path, "thesis-loss", *own, "--out", "c")
    assert done.returncode == 2, done.stderr
    assert "which was started by other sources: mine.py:Fixed (helper.py); fly it anew" in done.stderr
    (tmp_path / "helper.py").write_text("START = 0.5\n")
    done = resume(PACKAGE.parent, tmp_path, "thesis-loss", *own, "--out", "c")
    assert done.returncode == 0, done.stderr
    assert all("dropped from the file" in line for line in done.stderr.splitlines())
