"""The house rules: edges stay at the edge, truth stays away from laws and estimators, modules stay small."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "flightbed"
MODULES = sorted(PACKAGE.rglob("*.py"))
EDGES = {
    "jsbsim": "plant/jsbsim.py",
    "rerun": "telemetry/",
    "pydantic": "settings/",
    "cyclopts": "cli.py",
    "distributed": "engine.py",
}


def _name(path: Path) -> str:
    return path.relative_to(PACKAGE).as_posix()


def _imports(path: Path) -> set[str]:
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{_name(path)}: relative import"
            found |= {f"{node.module}.{alias.name}" for alias in node.names} | {str(node.module)}
    return found


@pytest.mark.parametrize(("library", "home"), EDGES.items())
def test_each_edge_library_is_imported_by_one_module_or_folder(library: str, home: str) -> None:
    importers = {_name(p) for p in MODULES if any(i.split(".")[0] == library for i in _imports(p))}
    assert importers
    assert all(name == home or (home.endswith("/") and name.startswith(home)) for name in importers), importers


def _reach(path: Path) -> set[str]:
    """All flightbed modules that a module imports, directly or through others."""
    seen: set[str] = set()
    queue = [path]
    while queue:
        for name in _imports(queue.pop()):
            file = PACKAGE.parent / (name.replace(".", "/") + ".py")
            if name.startswith("flightbed.") and file.is_file() and name not in seen:
                seen.add(name)
                queue.append(file)
    return seen


@pytest.mark.parametrize("family", ["control", "estimation"])
def test_laws_and_estimators_see_neither_plant_nor_truth(family: str) -> None:
    for path in (PACKAGE / family).glob("*.py"):
        direct = _imports(path)
        assert not any(name.startswith("flightbed.plant") for name in direct), _name(path)
        assert "flightbed.core.signals.Truth" not in direct, _name(path)
        tree = ast.parse(path.read_text())
        names = {n.id for n in ast.walk(tree) if isinstance(n, ast.Name)}
        names |= {n.attr for n in ast.walk(tree) if isinstance(n, ast.Attribute)}
        assert not {"Truth", "truth", "Sample"} & names, _name(path)
        assert "flightbed.core.signals.Sample" not in direct, _name(path)
        assert "flightbed.fdm.jsbsim" not in _reach(path), _name(path)


def test_units_and_errors_import_nothing_of_the_house() -> None:
    assert not any(name.startswith("flightbed") for name in _imports(PACKAGE / "errors.py"))
    assert _imports(PACKAGE / "units.py") == set()


def test_nothing_below_the_command_line_prints() -> None:
    for path in MODULES:
        calls = {
            n.func.id
            for n in ast.walk(ast.parse(path.read_text()))
            if isinstance(n, ast.Call) and isinstance(n.func, ast.Name)
        }
        assert _name(path) in ("cli.py", "__main__.py") or "print" not in calls, _name(path)


def test_no_function_rebinds_a_module_level_name() -> None:
    for path in MODULES:
        tree = ast.parse(path.read_text())
        assert not any(isinstance(n, ast.Global) for n in ast.walk(tree)), _name(path)


def test_modules_stay_small() -> None:
    sizes = {_name(p): len(p.read_text().splitlines()) for p in MODULES}
    assert max(sizes.values()) <= 400, max(sizes, key=lambda n: sizes[n])


WRITERS = {
    "mission",
    "folder",
    "report",
    "comparison",
    "live",
    "telemetry",
    "journal",
    "engine",
    "campaign",
    "campaign_folder",
}


@pytest.mark.parametrize("value", ["run_summary", "flight_result", "campaign_summary", "campaign_result"])
def test_values_know_nothing_of_the_actions_that_fly_and_write(value: str) -> None:
    reached = {name.split(".")[1] for name in _reach(PACKAGE / f"{value}.py")}
    assert not WRITERS & reached, WRITERS & reached


@pytest.mark.parametrize("view", ["report", "lead", "points", "multiples", "ensembles", "folder"])
def test_views_of_a_campaign_do_not_import_the_action(view: str) -> None:
    assert "flightbed.campaigns.run" not in _imports(PACKAGE / f"campaign_{view}.py")
