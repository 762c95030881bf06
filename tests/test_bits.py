"""The comparison of two source trees, on trees whose flights are written down."""

from __future__ import annotations

import io
import subprocess
import sys
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import numpy as np
import pytest

from tests.bits import compare, difference, main

BITS = Path(__file__).with_name("bits.py")
MODULE = """
import numpy as np
from types import SimpleNamespace

def load_scenario(path):
    return open(path).read()

def run(scenario, *, rerun, report):
    columns = {"t_s": np.arange(5) / 100, "gaps": np.array([np.nan, 1.0, 2.0, np.nan, scenario.count("x")])}
    {change}
    return SimpleNamespace(trace=SimpleNamespace(columns=columns))
"""


def _tree(folder: Path, change: str = "", **scenarios: str) -> Path:
    """Write a source tree with the public functions that a comparison calls."""
    (folder / "flightbed").mkdir(parents=True)
    (folder / "flightbed" / "__init__.py").write_text(MODULE.replace("{change}", change))
    (folder / "scenarios").mkdir()
    for name, text in (scenarios or {"one": "x", "two": "xx"}).items():
        (folder / "scenarios" / f"{name}.toml").write_text(text)
    return folder


def _bits(*arguments: object) -> tuple[int, list[str], list[str]]:
    """Return exit code, lines of stdout and lines of stderr; the trees fly in processes of their own."""
    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        try:
            code: object = main([*map(str, arguments)])
        except SystemExit as ended:
            code = ended.code
    assert isinstance(code, int)
    return code, out.getvalue().splitlines(), err.getvalue().splitlines()


def test_the_script_prints_and_returns_the_same(tmp_path: Path) -> None:
    old, new = _tree(tmp_path / "old"), _tree(tmp_path / "new", two="xxx")
    command = [sys.executable, str(BITS), str(old), str(new)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout.splitlines(), done.stderr.splitlines()) == _bits(old, new)
    assert done.returncode == 1


def test_trees_that_fly_the_same_are_equal(tmp_path: Path) -> None:
    old, new = _tree(tmp_path / "old"), _tree(tmp_path / "new")
    assert _bits(old, new) == (
        0,
        [
            "one: equal (2 columns equal)",
            "two: equal (2 columns equal)",
            "2 scenarios, 4 columns: equal to the last bit",
        ],
        [],
    )
    assert _bits(old, new, "two")[1][-1] == "1 scenarios, 2 columns: equal to the last bit"
    assert sorted(p.name for p in new.rglob("*")) == ["__init__.py", "flightbed", "one.toml", "scenarios", "two.toml"]


def test_one_ulp_and_a_missing_column_are_found(tmp_path: Path) -> None:
    old = _tree(tmp_path / "old")
    ulp = _tree(tmp_path / "ulp", 'columns["gaps"][2] = np.nextafter(2.0, 3.0)')
    code, lines, _ = _bits(old, ulp, "one")
    assert code == 1
    assert lines == [
        "one: 1 columns differ (1 columns equal)",
        "  gaps: up to 4.44e-16; 1 of 5 ticks, from tick 2 on",
        "1 scenarios, 2 columns: 1 differ, 0 are missing in NEW, 0 scenarios not flown",
    ]
    missing = _tree(tmp_path / "missing", 'columns["new"] = columns.pop("gaps")')
    code, lines, _ = _bits(old, missing, "one")
    assert code == 1
    assert lines[1:3] == ["  only in OLD: gaps", "  only in NEW: new"]
    assert lines[-1].endswith("0 differ, 1 are missing in NEW, 0 scenarios not flown; 1 columns only in NEW")


def test_a_column_only_in_new_is_listed_and_no_difference(tmp_path: Path) -> None:
    new = _tree(tmp_path / "new", 'columns["new"] = columns["t_s"]')
    code, lines, _ = _bits(_tree(tmp_path / "old"), new)
    assert code == 0
    assert "  only in NEW: new" in lines
    assert lines[-1] == "2 scenarios, 4 columns: equal to the last bit; 2 columns only in NEW"


def test_both_trees_fly_the_file_of_old_and_new_its_own_where_the_text_differs(tmp_path: Path) -> None:
    old, new = _tree(tmp_path / "old"), _tree(tmp_path / "new", one="x # edited", two="xxx")
    code, lines, _ = _bits(old, new)
    assert code == 1
    assert lines[:4] == [
        "one: equal (2 columns equal)",
        "two: equal (2 columns equal)",
        "one (NEW's own file, its text differs): equal (2 columns equal)",
        "two (NEW's own file, its text differs): 1 columns differ (1 columns equal)",
    ]
    assert lines[4] == "  gaps: up to 1; 1 of 5 ticks, from tick 4 on"


def test_a_file_that_new_refuses_is_no_difference_if_its_own_flies_equal(tmp_path: Path) -> None:
    refuse = """class ScenarioError(Exception): pass
    if "idle" in scenario: raise ScenarioError("idle: has no effect")"""
    old, new = _tree(tmp_path / "old", one="x idle"), _tree(tmp_path / "new", refuse, one="x")
    assert _bits(old, new)[:2] == (
        0,
        [
            "one: NEW refuses the file of OLD (idle: has no effect) and flies its own",
            "one (NEW's own file, its text differs): equal (2 columns equal)",
            "1 scenarios, 2 columns: equal to the last bit; 1 files of OLD refused by NEW, which flies its own",
        ],
    )
    other = _tree(tmp_path / "other", refuse, one="xx")
    assert _bits(old, other)[0] == 1
    failing = _tree(tmp_path / "failing", 'if "idle" in scenario: raise ValueError("bad")', one="x")
    assert _bits(old, failing)[0] == 1


def test_a_flight_that_fails_in_one_tree_is_a_difference(tmp_path: Path) -> None:
    broken = _tree(tmp_path / "broken", 'raise ValueError("no gain")')
    code, lines, _ = _bits(_tree(tmp_path / "old"), broken, "one")
    assert code == 1
    assert lines == [
        "one: not flown (0 columns equal)",
        "  NEW: ValueError: no gain",
        "1 scenarios, 0 columns: 0 differ, 0 are missing in NEW, 1 scenarios not flown",
    ]


def test_what_cannot_be_compared_is_one_line_and_2(tmp_path: Path) -> None:
    old, empty = _tree(tmp_path / "old"), tmp_path / "empty"
    empty.mkdir()
    nowhere = tmp_path / "nowhere"
    for arguments, message in [
        ((old,), "bits.py: the following arguments are required: new, scenario"),
        ((old, nowhere), f"bits.py: {nowhere}: no such folder; give a source tree"),
        ((old, empty), f"bits.py: {empty}: not a source tree of flightbed (needs flightbed/ and scenarios/*.toml)"),
        ((old, old, "one", "three"), f"bits.py: {old}: no scenario three; give one of one, two"),
        ((old, old, "--python-new", nowhere), f"bits.py: {nowhere}: cannot be started: No such file or directory"),
    ]:
        code, lines, errors = _bits(*arguments)
        assert (code, lines) == (2, [])
        assert len(errors) == 1
        assert errors[0].startswith(message) or "required: new" in errors[0]


def test_a_flightbed_from_elsewhere_and_other_versions_are_refused(tmp_path: Path) -> None:
    old = _tree(tmp_path / "old")
    hollow = _tree(tmp_path / "hollow")
    (hollow / "flightbed" / "__init__.py").unlink()  # then the installed one, or that of a path, would fly
    elsewhere = _tree(tmp_path / "elsewhere")
    (hollow / "sitecustomize.py").write_text(f"import sys; sys.path.insert(0, {str(elsewhere)!r})")
    code, lines, errors = _bits(old, hollow)
    assert (code, lines, len(errors)) == (2, [], 1)
    assert f"flightbed was imported from {elsewhere / 'flightbed' / '__init__.py'}" in errors[0]
    other = _tree(tmp_path / "other")
    (other / "jsbsim-0.9.dist-info").mkdir()
    (other / "jsbsim-0.9.dist-info" / "METADATA").write_text("Metadata-Version: 2.1\nName: jsbsim\nVersion: 0.9\n")
    code, lines, errors = _bits(old, other)
    assert (code, lines, len(errors)) == (2, [], 1)
    assert errors[0].endswith("NEW with 0.9; use the same versions")


@pytest.mark.parametrize(
    ("new", "text"),
    [
        ([1.0, np.nan, 3.0], None),
        ([1.0, np.nan], "3 ticks in OLD, 2 in NEW"),
        ([1.0, 2.0, 3.5], "up to 0.5; 1 ticks with a value that is not finite; 2 of 3 ticks, from tick 1 on"),
        ([-1.0, np.nan, 3.0], "up to 2; 1 of 3 ticks, from tick 0 on"),
    ],
)
def test_difference(new: list[float], text: str | None) -> None:
    assert difference(np.array([1.0, np.nan, 3.0]), np.array(new)) == text


def test_types_and_signs_of_zero_count() -> None:
    zero, negative = np.zeros(2), -np.zeros(2)
    assert difference(zero, negative) == "up to 0; 2 of 2 ticks, from tick 0 on"
    assert (
        difference(zero, np.zeros(2, dtype=np.float32)) == "float64 of shape (2,) in OLD, float32 of shape (2,) in NEW"
    )
    assert not compare("a", {"x": zero}, {"x": negative}).same
    assert compare("a", {"x": zero}, {"x": zero}).same
