"""Digests of sources: which files count, and equal digests of equal sources."""

from __future__ import annotations

from pathlib import Path

import pytest

from flightbed.core.sources import PACKAGE, Imported, closure_sha256, digest, imports, own_closure, quick_imports
from tests.test_architecture import TREES


def test_the_quick_reader_of_imports_finds_those_of_every_source() -> None:
    for name in TREES:
        path = PACKAGE.parent.joinpath(*name.split("."))
        path = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
        source = path.read_text()
        of_flightbed = {one for one in imports(source) if one.name.startswith("flightbed")}
        assert of_flightbed <= set(quick_imports(source)), path


def test_imports_of_all_forms() -> None:
    source = "import a.b as c, d\nfrom . import e\ndef f():\n    if True: from ..g.h import (i, # )\n j as k)\n"
    assert set(imports(source)) == {
        Imported("a.b"), Imported("d"), Imported("", 1), Imported("e", 1), Imported("g.h", 2), Imported("g.h.i", 2), Imported("g.h.j", 2),
    }  # fmt: skip
    assert set(quick_imports("from a import b as c, d  # e\nimport f.g, h\n    from i import (\n    j,  # k\n    l,\n)\n")) == {
        Imported("a"), Imported("a.b"), Imported("a.d"), Imported("f.g"), Imported("h"), Imported("i"), Imported("i.j"), Imported("i.l"),
    }  # fmt: skip


def test_a_digest_tells_names_and_contents_apart() -> None:
    found = [digest(files) for files in ({"a": b"bc"}, {"ab": b"c"}, {"a": b"b", "c": b""}, {"a": b"bd"}, {})]
    assert len(set(found)) == len(found)
    assert digest({"a": b"1", "b": b"2"}) == digest({"b": b"2", "a": b"1"})


def test_a_module_without_source_has_no_digest() -> None:
    with pytest.raises(OSError, match=r"no sources of flightbed\.no_such_module below"):
        closure_sha256("flightbed.no_such_module")


def test_the_imports_of_own_code_from_its_own_folder(tmp_path: Path) -> None:
    package, beside = tmp_path / "mine", tmp_path / "beside"
    for folder in (package / "inner", beside):
        folder.mkdir(parents=True)
    files = {
        package / "__init__.py": "",
        package
        / "filter.py": "import numpy\nfrom . import constants\nfrom .inner import table\nfrom flightbed import units\n",
        package / "constants.py": "import filter_math\n",
        package / "inner" / "__init__.py": "",
        package / "inner" / "table.py": "from mine.gains import X\nfrom mine import filter\n",
        package / "gains.py": "X = 1",
        package / "unused.py": "",
        tmp_path / "filter_math.py": "this is no Python",
        beside / "filter_math.py": "",
        tmp_path / "numpy_like.py": "",
    }
    for path, text in files.items():
        path.write_text(text)
    start = package / "filter.py"

    def found(*roots: Path, only: str | None = None) -> set[str]:
        return {
            path.relative_to(tmp_path).as_posix() for path in own_closure(start, start.read_bytes(), roots, only=only)
        }

    mine = {
        "mine/filter.py",
        "mine/__init__.py",
        "mine/constants.py",
        "mine/inner/__init__.py",
        "mine/inner/table.py",
        "mine/gains.py",
    }
    assert found(tmp_path, only="mine") == mine
    assert found(tmp_path) == mine | {"filter_math.py"}
    assert found(beside, tmp_path) == mine | {"beside/filter_math.py"}
