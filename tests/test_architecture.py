"""The rules of the source layout: imports go down, libraries stay in their package, truth never reaches the controller."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "flightbed"

# Lowest level first. A package imports from lower levels and from itself.
LEVELS: tuple[tuple[str, ...], ...] = (
    ("core", "statistics"),
    ("config", "document", "parallel", "fdm", "aircraft", "avionics"),
    ("command", "failures", "estimation", "plant", "scenario"),
    ("control", "models"),
    ("flight",),
    ("analysis", "testing"),
    ("report", "telemetry", "studies"),
    ("runs", "campaigns"),
    ("cli",),
)
LEVEL = {package: number for number, level in enumerate(LEVELS, start=1) for package in level}
LONG = Path("long")  # folder of tests of `make test-long`; it mirrors no package
# Modules beside the packages: the door, and names that programs outside rely on. Nothing inside imports them.
DOORS = ("__init__", "__main__", "ensemble", "units")

LIBRARIES = {
    "jsbsim": "fdm",
    "rerun": "telemetry",
    "rerun_bindings": "telemetry",
    "pydantic": "config",
    "pydantic_core": "config",
    "distributed": "parallel",
    "cyclopts": "cli",
}


class Import(NamedTuple):
    """One import of flightbed's own: from a module, to a module, in a line."""

    source: str
    target: str
    line: int

    def __str__(self) -> str:
        return f"{self.source}:{self.line} imports {self.target}"


def name_of(path: Path, root: Path) -> str:
    """Return the dotted name of a module below a folder."""
    parts = path.relative_to(root).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def modules(root: Path = ROOT) -> dict[str, ast.Module]:
    """Return every module of flightbed by its dotted name."""
    return {name_of(p, root): ast.parse(p.read_text()) for p in sorted((root / "flightbed").rglob("*.py"))}


def imports(trees: Mapping[str, ast.Module]) -> Iterator[Import]:
    """Yield every import of flightbed's own modules, also those in functions and under TYPE_CHECKING."""
    for source, tree in trees.items():
        for node in ast.walk(tree):
            if isinstance(node, ast.Import):
                for alias in node.names:
                    if alias.name.split(".")[0] == "flightbed":
                        yield Import(source, alias.name, node.lineno)
            elif isinstance(node, ast.ImportFrom):
                assert node.level == 0, f"{source}:{node.lineno}: relative import"
                if str(node.module).split(".")[0] == "flightbed":
                    for alias in node.names:
                        inner = f"{node.module}.{alias.name}"
                        yield Import(source, inner if inner in trees else str(node.module), node.lineno)


def package_of(module: str) -> str:
    """Return the package of a module, or the name of a module beside the packages."""
    parts = module.split(".")
    return parts[1] if len(parts) > 1 else "__init__"


def upward(trees: Mapping[str, ast.Module]) -> list[str]:
    """Return the imports that do not go to a lower level or stay in their package."""
    found = []
    for each in imports(trees):
        source, target = package_of(each.source), package_of(each.target)
        if source in DOORS or source == target:
            continue
        if target in DOORS or LEVEL[target] >= LEVEL[source]:
            found.append(str(each))
    return found


def cycles(trees: Mapping[str, ast.Module]) -> list[list[str]]:
    """Return the groups of modules that import each other in a ring (Tarjan's strongly connected components)."""
    below: dict[str, set[str]] = {name: set() for name in trees}
    for each in imports(trees):
        if each.target in trees and each.target != each.source:
            below[each.source].add(each.target)
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found: list[list[str]] = []

    def visit(name: str) -> None:
        index[name] = low[name] = len(index)
        stack.append(name)
        for target in below[name]:
            if target not in index:
                visit(target)
                low[name] = min(low[name], low[target])
            elif target in stack:
                low[name] = min(low[name], index[target])
        if low[name] == index[name]:
            ring = stack[stack.index(name) :]
            del stack[stack.index(name) :]
            if len(ring) > 1:
                found.append(sorted(ring))

    for name in below:
        if name not in index:
            visit(name)
    return found


TREES = modules()


def test_every_package_has_a_level_and_every_level_a_package() -> None:
    packages = {p.name for p in PACKAGE.iterdir() if (p / "__init__.py").is_file()}
    assert packages == set(LEVEL)
    assert len(LEVELS) <= 10


def test_imports_go_down() -> None:
    assert upward(TREES) == []


def test_no_modules_import_each_other_in_a_ring() -> None:
    assert cycles(TREES) == []


@pytest.mark.parametrize(
    "line",
    [
        "from flightbed.flight.loop import fly",
        "def f():\n    from flightbed.flight import loop",
        "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from flightbed.flight.loop import Flight",
        "import flightbed.plant.base",
        "from flightbed import units",
        "from flightbed import load_scenario",
    ],
)
def test_an_import_that_goes_up_is_found(line: str) -> None:
    planted = {**TREES, "flightbed.estimation.planted": ast.parse(line)}
    (found,) = upward(planted)
    assert found.startswith("flightbed.estimation.planted:")


def test_a_ring_is_found() -> None:
    trees = {
        "flightbed.core.a": ast.parse("from flightbed.core import b"),
        "flightbed.core.b": ast.parse("def f():\n    from flightbed.core.c import x"),
        "flightbed.core.c": ast.parse("from flightbed.core.a import x"),
    }
    assert cycles(trees) == [["flightbed.core.a", "flightbed.core.b", "flightbed.core.c"]]


def test_a_newcomer_finds_at_most_thirty_names() -> None:
    names = {p.name for p in PACKAGE.iterdir() if not p.name.endswith("_data") and p.name != "__pycache__"}
    assert len(names) <= 30, sorted(names)
    beside = {p.stem for p in PACKAGE.glob("*.py")}
    assert beside == set(DOORS)


def _libraries(tree: ast.Module) -> set[str]:
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found.add(str(node.module).split(".")[0])
    return found


@pytest.mark.parametrize(("library", "home"), LIBRARIES.items())
def test_each_library_is_imported_by_one_package(library: str, home: str) -> None:
    importers = {name for name, tree in TREES.items() if library in _libraries(tree)}
    assert {package_of(name) for name in importers} <= {home}, importers


def test_the_packages_of_single_libraries_exist() -> None:
    used = {library for tree in TREES.values() for library in _libraries(tree)}
    assert {"jsbsim", "rerun", "pydantic", "distributed", "cyclopts"} <= used


@pytest.mark.parametrize("package", ["control", "estimation", "avionics"])
def test_truth_never_reaches_the_controller(package: str) -> None:
    below: dict[str, set[str]] = {}
    for each in imports(TREES):
        below.setdefault(each.source, set()).add(each.target)
    for name, tree in TREES.items():
        if package_of(name) != package:
            continue
        names = {n.id for n in ast.walk(tree) if isinstance(n, ast.Name)}
        names |= {n.attr for n in ast.walk(tree) if isinstance(n, ast.Attribute)}
        names |= {a.name for n in ast.walk(tree) if isinstance(n, ast.ImportFrom) for a in n.names}
        assert not {"Truth", "truth", "Sample"} & names, name
        reached, queue = set[str](), [name]
        while queue:
            for target in below.get(queue.pop(), ()):
                if target not in reached:
                    reached.add(target)
                    queue.append(target)
        assert not {m for m in reached if package_of(m) in ("plant", "fdm")}, name


def test_units_and_errors_import_nothing_of_flightbed() -> None:
    assert not [each for each in imports(TREES) if each.source in ("flightbed.core.units", "flightbed.core.errors")]


def test_only_the_command_line_prints() -> None:
    for name, tree in TREES.items():
        calls = {n.func.id for n in ast.walk(tree) if isinstance(n, ast.Call) and isinstance(n.func, ast.Name)}
        assert package_of(name) in ("cli", "__main__") or "print" not in calls, name


def test_no_function_rebinds_a_module_level_name() -> None:
    for name, tree in TREES.items():
        assert not any(isinstance(n, ast.Global) for n in ast.walk(tree)), name


def test_public_names_are_what_they_should_be_after_every_module_is_imported() -> None:
    """A subpackage with the name of a public function would take its place once it is imported."""
    code = """
import importlib, inspect, pkgutil
import flightbed
modules = [m.name for m in pkgutil.walk_packages(flightbed.__path__, "flightbed.")]
for name in modules:
    if not name.endswith("__main__"):
        importlib.import_module(name)
assert len(modules) > 100, modules
for name in flightbed.__all__:
    found = getattr(flightbed, name)
    assert not inspect.ismodule(found), name
    assert inspect.isclass(found) if name[0].isupper() else inspect.isfunction(found), (name, found)
    assert found.__name__ == name, (name, found)
from flightbed.testing import check_estimator
from flightbed.ensemble import Flown, Job, fly_jobs, histories, processes
from flightbed.units import DEG, FT, unit_of
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, cwd=ROOT)
    assert done.returncode == 0, done.stderr


def test_one_function_advances_the_plant() -> None:
    """Rule 5: every flight is flown by the same loop."""
    found = {
        name
        for name, tree in TREES.items()
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute) and node.attr == "advance" and ast.unparse(node.value).endswith("plant")
    }
    assert found == {"flightbed.flight.loop"}


# Arrays that compiled functions may index by integer literals: matrices and vectors of a model, whose subscripts are those of the algebra.
MATRICES = {
    "flightbed.avionics.pitch_kernels": {
        "out",
        "work",
        "model",
    },  # (2, 4): value and derivatives of the rates, or [A | b | c]
    "flightbed.avionics.lateral_kernels": {"A", "B", "G", "S", "work", "pitch"},  # of (alpha, q, beta, p, r)
    "flightbed.estimation.differentiated_rls": {"here", "there"},  # (2, 4), as in pitch_kernels
    "flightbed.estimation.loop_gain.filter_bank": {"model"},  # (2, 4), [A | b | c]
    "flightbed.estimation.loop_gain.scheduled": {"model"},
    "flightbed.estimation.two_stage.estimator": {"u", "z", "compensated", "innovation", "S", "model", "work"},
    "flightbed.estimation.reconstruction.regression_kernels": {
        "noise",
        "memory.noise",
        "response",
        "before",
        "Q",
        "B",
        "z",
    },
    "flightbed.estimation.reconstruction.retrospective_kernels": {
        "best",
        "wide",
        "performance",
        "applied",
        "R1",
        "R2",
    },  # 1 x 1
    "flightbed.estimation.reconstruction.observers": {
        *("A", "B", "F", "G", "U", "rows", "model", "corrected", "gain", "ahead", "given", "theta"),
        *("sigma", "y", "first", "inputs", "process", "more", "state", "innovation"),  # of (alpha, q[, gust])
    },
}
# First and last value of a queue or of a history, and the first of several regressions, surfaces or axes.
SEQUENCES = {
    "flightbed.estimation.reconstruction.observers": {"queue", "H"},
    "flightbed.estimation.reconstruction.retrospective_kernels": {"history", "lags"},
    "flightbed.estimation.reconstruction.regression_kernels": {"memory.sums", "memory.spread"},
    "flightbed.estimation.two_stage.estimator": {"state.smoothed"},
    "flightbed.flight.computer": {"corrections", "laws"},
}
KERNELS = ("avionics", "control", "estimation", "flight")


def _is_literal(index: ast.expr) -> bool:
    """Return whether an index contains an integer literal as a whole subscript or as the bound of a slice."""
    if isinstance(index, ast.UnaryOp):
        return _is_literal(index.operand)
    if isinstance(index, ast.BinOp):  # 3 + i, but not 2 * n + i
        return isinstance(index.op, ast.Add) and isinstance(index.left, ast.Constant)
    if isinstance(index, ast.Tuple):
        return any(map(_is_literal, index.elts))
    if isinstance(index, ast.Slice):
        return any(_is_literal(bound) for bound in (index.lower, index.upper) if bound is not None)
    return isinstance(index, ast.Constant) and type(index.value) is int


def literal_indices(trees: Mapping[str, ast.Module]) -> dict[tuple[str, str], list[int]]:
    """Return (module, array) -> lines in which a compiled function indexes an array by an integer literal.

    The sizes of arrays, ``array.shape[0]``, and the results of calls, ``records(store, RECORD)[0]``, do not count.
    """
    found: dict[tuple[str, str], list[int]] = {}
    for module, tree in trees.items():
        for function in ast.walk(tree):
            if not isinstance(function, ast.FunctionDef):
                continue
            if "compiled" not in {ast.unparse(d) for d in function.decorator_list}:
                continue
            for node in ast.walk(function):
                if not isinstance(node, ast.Subscript) or not isinstance(node.value, ast.Name | ast.Attribute):
                    continue
                array = ast.unparse(node.value)
                if not array.endswith(".shape") and _is_literal(node.slice):
                    found.setdefault((module, array), []).append(node.lineno)
    return found


def test_no_integer_literal_indexes_state_settings_or_rows_of_a_kernel() -> None:
    """Rule 6: records have names."""
    permitted = {(m, a) for arrays in (MATRICES, SEQUENCES) for m, names in arrays.items() for a in names}
    found = literal_indices({name: tree for name, tree in TREES.items() if package_of(name) in KERNELS})
    assert {place: lines for place, lines in found.items() if place not in permitted} == {}
    assert permitted <= set(found), f"no longer indexed by a literal: {sorted(permitted - set(found))}"


@pytest.mark.parametrize("index", ["3", "-1", "3, w", "w, 0", "3:7", "3 + i", ":2"])
def test_an_integer_literal_as_an_index_is_found(index: str) -> None:
    planted = ast.parse(f"@compiled\ndef f(state, w, i):\n    return state[{index}]")
    assert literal_indices({"flightbed.estimation.planted": planted}) == {
        ("flightbed.estimation.planted", "state"): [3]
    }


@pytest.mark.parametrize("code", ["state[GAIN, w]", "state.shape[0]", "records(state, HEAD)[0]", "state[at + 1]"])
def test_other_indices_are_not(code: str) -> None:
    planted = ast.parse(f"@compiled\ndef f(state, w, at):\n    return {code}")
    assert literal_indices({"flightbed.estimation.planted": planted}) == {}


def test_tests_mirror_the_packages() -> None:
    tests = ROOT / "tests"
    folders = {p.relative_to(tests) for p in tests.rglob("*") if p.is_dir() and list(p.glob("test_*.py"))}
    packages = {p.parent.relative_to(PACKAGE) for p in PACKAGE.rglob("__init__.py")}
    assert folders <= packages | {Path(), LONG}, folders - packages


def test_the_tests_of_the_long_suite_have_its_marker() -> None:
    files = sorted((ROOT / "tests" / LONG).glob("test_*.py"))
    assert files
    for path in files:
        assigned = [node for node in ast.parse(path.read_text()).body if isinstance(node, ast.Assign)]
        (mark,) = (node.value for node in assigned if ast.unparse(node.targets[0]) == "pytestmark")
        assert "pytest.mark.long" in ast.unparse(mark), path.name
