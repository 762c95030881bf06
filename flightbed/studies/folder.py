"""The folder of a study: page and numbers, written atomically."""

from __future__ import annotations

from pathlib import Path

from flightbed.core.files import FolderKind, to_json, write_folder
from flightbed.document.document import Document
from flightbed.document.html import render

STUDY = FolderKind("study", frozenset({"report.html", "results.json"}))


def write_study(document: Document, target: Path, *, replace: bool) -> Path:
    """Write the folder of a study, its page and its numbers; returns its path."""

    def write(new: Path) -> None:
        (new / "report.html").write_text(render(document), encoding="utf-8")
        (new / "results.json").write_text(to_json(document.to_dict()), encoding="utf-8")

    return write_folder(target, write, replace=replace)
