"""Content of reports: cells as text and as JSON."""

from __future__ import annotations

import json
from math import inf, nan

import numpy as np
import pytest

from flightbed.document.document import Cell, Claim, Document, Picture, Section, Table, show
from flightbed.statistics.intervals import Interval, Spread, outcome

TABLE = Table("t", "A table", ("name", "K"), [["a", 0.12345], ["b", Spread(4, 1, 0.5, nan, inf)]], {"K": ".2f"})
OPEN = Claim("o", "It may be so.", "a share", Interval(0.5, 0.2, 0.8, 5), holds=None)
CLAIM = Claim("c", "It is so.", "a difference", Interval(-0.5, -inf, -0.1, 20), holds=True)
PICTURE = Picture("p", "A figure", "<svg></svg>", "K_1 = 0.2", "largest 3")
DOCUMENT = Document(
    "A report",
    [Section("One", ["text"], [TABLE, PICTURE]), Section("Two", (), [CLAIM, OPEN])],
    {"seeds": 20, "by": {"a": 1}},
)


@pytest.mark.parametrize(
    ("cell", "spec", "shown"),
    [
        (None, ".4g", "-"),
        (nan, ".4g", "-"),
        (float("nan"), ".1f", "-"),
        (np.float64(nan), ".1f", "-"),
        ("K-hat", ".4g", "K-hat"),
        (3, ".2f", "3"),
        (0, ".4g", "0"),
        (0.0, ".4g", "0"),
        (2 / 3, ".4g", "0.6667"),
        (2 / 3, "+.1f", "+0.7"),
        (np.float64(0.25), ".1%", "25.0%"),
        (-inf, ".3g", "-inf"),
        (Spread(20, 0, 0.5, 0.25, 1.0), ".2f", "0.50 [0.25, 1.00]"),
        (Spread(20, 3, 0.5, 0.25, 1.0), ".4g", "0.5 [0.25, 1], never in 3 of 20"),
        (Spread(20, 20, nan, nan, nan), ".4g", "never"),
        (Interval(0.5, 0.25, 1.0, 20), ".3f", "0.500 (0.250 to 1.000)"),
        (outcome([0.25, 0.5, 0.75], [None] * 3), ".3f", "0.500 [0.275, 0.725]"),
        (outcome([0.25, 9.0, 0.75], [None, 7.125, None]), ".1f", "0.5 [0.3, 0.7]; 1 of 3 gone at 7.12 s [7.12, 7.12]"),
        (outcome([9.0, None], [7.0, 8.0]), ".1f", "2 of 2 gone at 7.50 s [7.05, 7.95]"),
        (outcome([1.0, None, None], [None, 7.0, None]), ".1f", "1.0 [1.0, 1.0], never in 1 of 2; 1 of 3 gone at 7.00 s [7.00, 7.00]"),
        (outcome([None, 9.0], [None, 7.0]), ".1f", "never; 1 of 2 gone at 7.00 s [7.00, 7.00]"),
        (outcome([], []), ".1f", ""),
    ],
)  # fmt: skip
def test_each_kind_of_cell_as_text(cell: Cell, spec: str, shown: str) -> None:
    assert show(cell, spec) == shown


def test_a_table_shows_its_numbers_as_each_column_says() -> None:
    table = Table("t", "", ("plain", "K"), [], {"K": ".2f"})
    assert table.cell_texts([0.123456, 0.123456]) == ["0.1235", "0.12"]
    with pytest.raises(ValueError, match="shorter"):
        table.cell_texts([1.0])


def test_parts_are_found_in_order() -> None:
    more = Document("", [*DOCUMENT.sections, Section("Three", (), [TABLE, CLAIM, TABLE])], {})
    assert more.tables() == [TABLE, TABLE, TABLE]
    assert more.claims() == [CLAIM, OPEN, CLAIM]
    assert more.pictures() == [PICTURE]


def test_an_outcome_as_json_is_its_two_spreads() -> None:
    table = Table("t", "", ("RMS",), [[outcome([0.5, 9.0], [None, None])], [outcome([None], [7.0])]])
    written = json.loads(json.dumps(Document("", [Section("", (), [table])], {}).to_dict(), allow_nan=False))
    one, other = (row["RMS"] for row in written["tables"]["t"])
    assert one["gone_s"] == {"runs": 2, "missing": 2, "median": None, "low": None, "high": None}
    assert one["stayed"]["median"] == 4.75
    assert other["stayed"]["median"] is None
    assert other["gone_s"] == {"runs": 1, "missing": 0, "median": 7.0, "low": 7.0, "high": 7.0}


def test_as_json_every_number_is_there_and_none_is_nan_or_infinite() -> None:
    written = json.loads(json.dumps(DOCUMENT.to_dict(), allow_nan=False))
    assert written == {
        "seeds": 20,
        "by": {"a": 1},
        "tables": {
            "t": [
                {"name": "a", "K": 0.12345},
                {"name": "b", "K": {"runs": 4, "missing": 1, "median": 0.5, "low": None, "high": None}},
            ]
        },
        "claims": {
            "c": {
                "claim": "It is so.",
                "measured": "a difference",
                "interval": {"estimate": -0.5, "low": None, "high": -0.1, "runs": 20},
                "holds": True,
            },
            "o": {
                "claim": "It may be so.",
                "measured": "a share",
                "interval": {"estimate": 0.5, "low": 0.2, "high": 0.8, "runs": 5},
                "holds": None,
            },
        },
        "figures": {"p": {"title": "A figure", "parameters": "K_1 = 0.2", "facts": "largest 3"}},
    }
