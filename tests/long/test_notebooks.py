"""The examples as notebooks: cells in one namespace, without ``__file__``, in a folder of their own, run one after the other and again."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.long

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))

# A kernel: the cells of stdin, each compiled as its own unit in one namespace; the value of a last expression is displayed.
KERNEL = """
import ast, json, sys
cells, rounds = json.load(sys.stdin)
namespace = {"__name__": "__main__"}
for _ in range(rounds):
    for number, source in enumerate(cells, start=1):
        tree = ast.parse(source, f"<cell {number}>")
        last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
        exec(compile(tree, f"<cell {number}>", "exec"), namespace)
        if last is not None:
            value = eval(compile(ast.Expression(last.value), f"<cell {number}>", "eval"), namespace)
            if value is not None:
                print(repr(value))
"""


def cells(text: str) -> list[str]:
    """Return the code cells of a script, as editors split it; the text before the first marker is the description."""
    return re.split(r"^# %%[^\n]*\n", text, flags=re.MULTILINE)[1:]


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda p: p.name)
def test_an_example_runs_cell_by_cell_and_again(path: Path, tmp_path: Path) -> None:
    source = cells(path.read_text())
    assert 3 <= len(source) <= 6
    environment = {"PYTHONPATH": str(ROOT), "MPLBACKEND": "Agg", "HOME": str(tmp_path / "home")}

    def run(folder: Path, *command: str, stdin: str = "") -> str:
        folder.mkdir()
        done = subprocess.run(
            [sys.executable, *command], cwd=folder, capture_output=True, text=True, check=False, input=stdin,
            env=environment,
        )  # fmt: skip
        assert (done.returncode, done.stderr) == (0, ""), done.stderr
        return done.stdout

    as_script = run(tmp_path / "script", str(path))
    as_notebook = run(tmp_path / "notebook", "-c", KERNEL, stdin=json.dumps([source, 2]))
    printed, displayed = [], []
    for line in as_notebook.splitlines():
        (printed if line in as_script.splitlines() else displayed).append(line)
    assert printed == as_script.splitlines() * 2
    assert all(re.match(r"[<(\[]", line) for line in displayed), displayed  # values of last expressions: plots
    made = [sorted(p.name for p in (tmp_path / folder).iterdir()) for folder in ("script", "notebook")]
    assert made[0] == made[1]
