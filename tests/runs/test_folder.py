"""Folders of studies: written atomically, and the user's files are never lost."""

from __future__ import annotations

import json
from math import inf, nan
from pathlib import Path

import pytest

from flightbed.core.errors import OutputError
from flightbed.core.files import check_target
from flightbed.document.document import Claim, Document, Section, Table
from flightbed.document.html import render
from flightbed.runs.folder import RUN
from flightbed.statistics.intervals import Interval
from flightbed.studies.folder import STUDY, write_study


def _document(title: str = "A study", **facts: object) -> Document:
    claim = Claim("c", "It is so.", "difference", Interval(nan, -inf, 1.0, 5), holds=False)
    return Document(title, [Section("One", ["text"], [Table("t", "", ("x",), [[nan], [inf], [1.5]]), claim])], facts)


def _files(folder: Path) -> dict[str, str]:
    return {str(p.relative_to(folder)): p.read_text(encoding="utf-8") for p in folder.rglob("*") if p.is_file()}


def test_a_study_is_its_page_and_its_numbers(tmp_path: Path) -> None:
    document = _document(runs=5)
    target = tmp_path / "studies" / "x"
    assert write_study(document, target, replace=True) == target
    assert {p.name for p in target.iterdir()} == STUDY.files
    assert (target / "report.html").read_text(encoding="utf-8") == render(document)

    def refuse(constant: str) -> None:
        pytest.fail(f"{constant} is no JSON")

    text = (target / "results.json").read_text()
    results = json.loads(text, parse_constant=refuse)
    assert results["runs"] == 5
    assert results["tables"]["t"] == [{"x": None}, {"x": None}, {"x": 1.5}]
    assert results["claims"]["c"]["interval"] == {"estimate": None, "low": None, "high": 1.0, "runs": 5}
    assert [p.name for p in tmp_path.rglob(".*")] == []  # no scratch is left


def test_replaced_or_beside(tmp_path: Path) -> None:
    target = tmp_path / "x"
    write_study(_document("first"), target, replace=True)
    assert write_study(_document("second"), target, replace=False) == tmp_path / "x-2"
    assert write_study(_document("third"), target, replace=False) == tmp_path / "x-3"
    assert write_study(_document("fourth"), target, replace=True) == target
    titles = {p.name: (p / "report.html").read_text().partition("<h1>")[2][:6] for p in tmp_path.iterdir()}
    assert titles == {"x": "fourth", "x-2": "second", "x-3": "third<"}


@pytest.mark.parametrize("replace", [True, False])
def test_a_study_that_cannot_be_written_leaves_what_was_there(tmp_path: Path, replace: bool) -> None:
    target = tmp_path / "x"
    write_study(_document(), target, replace=True)
    before = _files(tmp_path)
    with pytest.raises(TypeError, match="not JSON serializable"):  # after the page has been written
        write_study(_document(secret=object()), target, replace=replace)
    assert _files(tmp_path) == before


def test_only_a_study_is_replaced_by_a_study(tmp_path: Path) -> None:
    target = tmp_path / "x"
    assert check_target(target, STUDY, replace=True) == target
    write_study(_document(), target, replace=True)
    assert check_target(target, STUDY, replace=True) == target
    with pytest.raises(OutputError, match=r"x: holds 'results\.json', which is not from a run; name a new folder"):
        check_target(target, RUN, replace=True)
    (target / "metrics.json").write_text("{}")
    with pytest.raises(OutputError, match=r"x: holds 'metrics\.json', which is not from a study; name a new folder"):
        check_target(target, STUDY, replace=True)
    assert check_target(target, STUDY, replace=False) == target
    assert RUN.files - STUDY.files
    assert STUDY.files - RUN.files


def test_a_target_that_cannot_be_is_refused_before_anything_is_computed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("mine")
    with pytest.raises(OutputError, match="file: is a file; name a folder"):
        check_target(tmp_path / "file", STUDY, replace=True)
    with pytest.raises(OutputError, match="cannot be written"):
        check_target(tmp_path / "file" / "x", STUDY, replace=False)
    with pytest.raises(OutputError, match="cannot be written"):
        check_target(Path("/proc/nowhere/x"), STUDY, replace=False)
    (tmp_path / "deep").mkdir()
    (tmp_path / "link").symlink_to(tmp_path)
    monkeypatch.chdir(tmp_path / "deep")
    for here in (Path(), Path(".."), tmp_path, Path("../deep/../deep"), tmp_path / "link" / "deep"):
        with pytest.raises(OutputError, match="is the folder you are in"):
            check_target(here, STUDY, replace=True)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["deep", "file", "link"]


def test_a_link_to_a_study_is_followed(tmp_path: Path) -> None:
    write_study(_document(), tmp_path / "x", replace=True)
    (tmp_path / "link").symlink_to("x")
    assert check_target(tmp_path / "link", STUDY, replace=True) == (tmp_path / "x").resolve()
