"""Compiled kernels on disk: an edited source is enough, an unchanged one is not compiled again, and nothing is needed to write."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from flightbed.core import files
from flightbed.core.compilation import watched
from flightbed.core.compiled import PLAIN
from flightbed.core.files import write_cached

pytestmark = pytest.mark.skipif(PLAIN, reason="nothing is compiled")
PACKAGE = Path(files.__file__).parents[1]

# A kernel that calls a kernel of another file, whose constant is in a third.
KERNELS = {
    "upper": "from flightbed.core.compiled import compiled\nfrom flightbed.core.lower import twice\n\n@compiled\ndef above(x):\n    return twice(x) + 1.0\n",
    "lower": "from flightbed.core.compiled import compiled\nfrom flightbed.core.number import TWO\n\n@compiled\ndef twice(x):\n    return TWO * x\n",
    "number": "TWO = 2.0\n",
    "apart": "X = 1\n",
}
CALL = """
from contextlib import contextmanager
from flightbed.core.compilation import watched
@contextmanager
def watch(name):
    print(name, end=" ")
    yield
with watched(watch):
    from flightbed.core.upper import above
    print(above(3.0))
"""


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """A copy of the package with some kernels of its own, in a folder."""
    shutil.copytree(
        PACKAGE, tmp_path / "tree" / "flightbed", ignore=shutil.ignore_patterns("__pycache__", "studies", "telemetry")
    )
    for name, source in KERNELS.items():
        (tmp_path / "tree" / "flightbed" / "core" / f"{name}.py").write_text(source)
    return tmp_path / "tree"


def start(tree: Path, code: str = CALL, **environment: str) -> subprocess.Popen[str]:
    kept = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    env = {**kept, "XDG_CACHE_HOME": str(tree.parent / "cache"), "PYTHONPATH": str(tree), **environment}
    return subprocess.Popen(
        [sys.executable, "-c", code], env=env, cwd=tree, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def ended(process: subprocess.Popen[str]) -> str:
    stdout, stderr = process.communicate()
    assert (process.returncode, stderr) == (0, ""), stderr
    return stdout.strip()


def edit(path: Path, old: str, new: str) -> None:
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))


def test_an_edited_kernel_of_another_file_is_enough(tree: Path) -> None:
    core = tree / "flightbed" / "core"
    assert ended(start(tree)) == "flightbed.core.upper.above 7.0"
    assert ended(start(tree)) == "7.0"
    edit(core / "lower.py", "TWO * x", "TWO * x * 10.0")
    assert ended(start(tree)) == "flightbed.core.upper.above 61.0"
    edit(core / "number.py", "2.0", "3.0")
    assert ended(start(tree)) == "flightbed.core.upper.above 91.0"
    edit(core / "apart.py", "1", "2")
    assert ended(start(tree)) == "91.0"
    edit(core / "number.py", "3.0", "2.0")
    edit(core / "lower.py", " * 10.0", "")
    assert ended(start(tree)) == "7.0"  # both trees share the folder
    assert len(list((tree.parent / "cache" / "flightbed" / "kernels").iterdir())) == 6
    assert not list(tree.rglob("*.nbi"))


def test_variants_of_a_kernel_are_kept_apart_by_the_values_that_they_enclose(tree: Path) -> None:
    variants = (
        "from flightbed.core.compiled import compiled\n\ndef times(factor):\n    def multiplied(x):\n        return factor * x\n"
        "    return compiled(multiplied)\n"
    )
    (tree / "flightbed" / "core" / "variants.py").write_text(variants)
    code = CALL.replace("upper import above", "variants import times").replace(
        "above(3.0)", "times(2.0)(3.0), times(5.0)(3.0)"
    )
    name = "flightbed.core.variants.multiplied"
    assert ended(start(tree, code)) == f"{name} {name} 6.0 15.0"
    assert ended(start(tree, code)) == "6.0 15.0"


def test_two_processes_at_once_and_a_damaged_file(tree: Path) -> None:
    at_once = {ended(process) for process in [start(tree), start(tree)]}
    assert "flightbed.core.upper.above 7.0" in at_once
    assert at_once <= {"flightbed.core.upper.above 7.0", "7.0"}  # the other may find what the first has compiled
    folder = tree.parent / "cache" / "flightbed" / "kernels"
    kept = {path.name: path.read_bytes() for path in folder.iterdir()}
    assert len(kept) == 2
    for path in folder.iterdir():
        path.write_bytes(path.read_bytes()[:500])
    assert ended(start(tree)) == "flightbed.core.upper.above 7.0"
    assert {path.name for path in folder.iterdir()} == set(kept)
    assert ended(start(tree)) == "7.0"


def test_a_folder_that_cannot_be_written_and_another_folder(tree: Path) -> None:
    (tree.parent / "file").write_text("")
    assert ended(start(tree, XDG_CACHE_HOME=str(tree.parent / "file"))) == "flightbed.core.upper.above 7.0"
    other = tree.parent / "other"
    assert ended(start(tree, NUMBA_CACHE_DIR=str(other))) == "flightbed.core.upper.above 7.0"
    assert len(list(other.rglob("*.kernel"))) == 2
    assert ended(start(tree, NUMBA_CACHE_DIR=str(other))) == "7.0"


def test_a_source_edited_while_the_process_runs_gives_no_file(tree: Path) -> None:
    """The machine code is of the old source, and the key would be of the new one."""
    code = CALL.replace(
        "    print(above(3.0))", "    print('imported', flush=True)\n    input()\n    print(above(3.0))"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", code],
        env={**os.environ, "NUMBA_CACHE_DIR": str(tree.parent / "kept"), "PYTHONPATH": str(tree)},
        cwd=tree, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert process.stdin is not None
    lower = tree / "flightbed" / "core" / "lower.py"
    assert process.stdout is not None
    assert process.stdout.readline() == "imported\n"
    edit(lower, "TWO * x", "TWO * x * 10.0")
    stdout, _ = process.communicate("\n")
    assert stdout.strip() == "flightbed.core.upper.above 7.0"
    assert not list(tree.parent.rglob("*.kernel"))
    assert ended(start(tree, NUMBA_CACHE_DIR=str(tree.parent / "kept"))) == "flightbed.core.upper.above 61.0"


def test_the_least_recently_used_files_are_removed(tmp_path: Path) -> None:
    for number in range(5):
        path = tmp_path / f"{number}.kernel"
        write_cached(path, b"x" * 10, pattern="*.kernel", most_bytes=30)
        os.utime(path, (100.0 + number, 100.0 + number))
    (tmp_path / "other").write_bytes(b"x" * 100)
    os.utime(tmp_path / "2.kernel")
    write_cached(tmp_path / "5.kernel", b"x" * 10, pattern="*.kernel", most_bytes=30)
    assert {path.name for path in tmp_path.iterdir()} == {"2.kernel", "4.kernel", "5.kernel", "other"}


def test_a_watcher_is_called_inside_its_block_only() -> None:
    from flightbed.core.compiled import compiled

    seen: list[str] = []

    @contextmanager
    def watch(name: str) -> Iterator[None]:
        seen.append(name)
        yield
        seen.append("end")

    def made(factor: float) -> Callable[[float], float]:
        def kernel(x: float) -> float:
            return factor * x

        kernel.__module__ = "flightbed.made"
        return compiled(kernel)

    with watched(watch):
        assert made(2.0)(3.0) == 6.0
    assert seen == ["flightbed.made.kernel", "end"]
    assert made(3.0)(3.0) == 9.0
    assert len(seen) == 2
