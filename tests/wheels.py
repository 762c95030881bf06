"""Wheels of the source tree, and commands in fresh environments."""

from __future__ import annotations

import os
import subprocess
import sys
import venv
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def call(*command: object, cwd: Path, **environment: str) -> str:
    """Run a command; return its stdout. It must succeed."""
    # PIP_* and the like stay: they name the package index. With PYTHONPATH the source tree would be imported.
    kept = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"} | environment
    done = subprocess.run([str(c) for c in command], cwd=cwd, capture_output=True, text=True, check=False, env=kept)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def build_wheel(folder: Path) -> Path:
    """Build the wheel of the source tree in a folder; needs a package index."""
    call(sys.executable, "-m", "build", "--wheel", "--outdir", folder / "dist", ROOT, cwd=folder)
    (wheel,) = (folder / "dist").glob("flightbed-*.whl")
    return wheel


def fresh_environment(folder: Path, *requirements: object) -> Path:
    """Make an environment with these packages; return its Python. Needs a package index."""
    venv.create(folder, with_pip=True)
    python = folder / "bin" / "python"
    call(python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *requirements, cwd=folder)
    return python
