"""The folder of a comparison: recording, page and numbers, written atomically."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from flightbed.analysis.comparison import Run, to_dict
from flightbed.core.files import FolderKind, to_json, write_folder
from flightbed.document.document import Document
from flightbed.document.html import render
from flightbed.telemetry.comparison import write_comparison as record

COMPARISON = FolderKind("comparison", frozenset({"comparison.rrd", "comparison.json", "report.html"}))


def write_comparison(runs: Sequence[Run], document: Document, target: Path, *, replace: bool) -> Path:
    """Write the folder of a comparison, its recording, its page and its numbers; returns its path."""

    def write(new: Path) -> None:
        (new / "report.html").write_text(render(document), encoding="utf-8")
        (new / "comparison.json").write_text(to_json(to_dict(runs)), encoding="utf-8")
        record(new / "comparison.rrd", runs, tables=document.tables())

    return write_folder(target, write, replace=replace)
