"""`flightbed reproduce`: the printed study; text in brackets is not markup."""

from __future__ import annotations

import io
from pathlib import Path

import pytest
from rich.console import Console

from flightbed.cli.reproduce import study_lines
from flightbed.document.document import Claim, Document, Picture, Section, Table
from flightbed.statistics.intervals import Interval, spread


def _printed(*verdicts: bool | None, text: str = "plain") -> list[str]:
    first = Table("t", text, (text, "K"), [[text, spread([0.5, 0.5])], [None, 0.125]], {"K": ".2f"}, note=text)
    claims = [Claim(f"c{i}", text, "share", Interval(0.5, 0.25, 0.75, 9), holds) for i, holds in enumerate(verdicts)]
    other = Table("u", "", ("not printed",), [])
    sections = [Section("", (), [first, *claims]), Section("", (), [other, Picture("p", "", "<svg/>", "")])]
    document = Document(text, sections, {"flights": 1234, "wall_time_s": 5.6})
    out = io.StringIO()
    console = Console(file=out, width=200, highlight=False)
    for line in study_lines(document, Path(f"studies/{text}")):
        console.print(line)
    return [" ".join(line.split()) for line in out.getvalue().splitlines()]


def test_a_study_prints_its_first_table_its_claims_and_its_folder() -> None:
    assert [line for line in _printed(True, False, None, True) if line] == [
        "plain",
        "plain K",
        "plain 0.50 [0.50, 0.50]",
        "- 0.12",
        "plain",
        "holds plain share: 0.5 (0.25 to 0.75)",
        "no plain share: 0.5 (0.25 to 0.75)",
        "open plain share: 0.5 (0.25 to 0.75)",
        "holds plain share: 0.5 (0.25 to 0.75)",
        "2 of 4 claims hold; 1234 runs in 6 s; 1 figures; written to studies/plain",
    ]


@pytest.mark.parametrize("text", ["[red]K[/red]", "[/]", "[link=x]", "+-5 [deg/s]"])
def test_text_in_brackets_is_not_markup(text: str) -> None:
    assert _printed(True, text=text) == [line.replace("plain", text) for line in _printed(True)]
