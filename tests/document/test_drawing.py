"""Figures: the same bytes every time, and ids that do not collide on a page."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections import Counter

import matplotlib as mpl
import numpy as np
import pytest

from flightbed.document import drawing

COLOURS = re.compile(r"#[0-9a-f]{6}\b")
REFERENCES = re.compile(r'url\(#([^)]*)\)|href="#([^"]*)"')


def draw(label: str = "a < b & c", rows: int = 2) -> str:
    with drawing.canvas(rows) as (axes, svg):
        for axis in axes:
            axis.plot([0.0, 1.0, 2.0], [0.0, 1.0, 0.5], marker="o", label=label)
            axis.fill_between([0.0, 1.0], [0.0, 0.1], [0.2, 0.3], color=drawing.ACTUAL, alpha=0.25)
            axis.plot([0.0, 1.0], [1.0, 1.0], color="#ffffff")
            drawing.mark(axis, 1.0)
            drawing.mark(axis, None)
        drawing.legend(axes[0])
        return svg()


def ids(svg: str) -> list[str]:
    return [i for e in ET.fromstring(svg).iter() if (i := e.get("id")) is not None]


def references(svg: str) -> list[str]:
    return [one or other for one, other in REFERENCES.findall(svg)]


def test_the_same_drawing_is_the_same_bytes_whatever_was_drawn_before() -> None:
    first = draw()
    draw("another", rows=1)
    assert draw() == first
    assert draw("another") != first


def test_it_is_one_svg_element_with_readable_text() -> None:
    """No declaration and no doctype, so that a page can embed the SVG; text remains text, escaped."""
    svg = draw()
    assert svg.startswith("<svg")
    root = ET.fromstring(svg)
    assert root.tag == "{http://www.w3.org/2000/svg}svg"
    assert "a < b & c" in [e.text for e in root.iter("{http://www.w3.org/2000/svg}text")]


def test_settings_end_with_the_canvas() -> None:
    def ours() -> list[object]:
        return [mpl.rcParams[name] for name in drawing._RC]

    before = ours()
    with drawing.canvas():
        assert mpl.rcParams["svg.hashsalt"] == "flightbed"
        assert ours() != before
    assert ours() == before


@pytest.mark.parametrize("key", ["3-11", "history-linear-25"])
def test_distinct_prefixes_every_id_and_every_reference_to_one(key: str) -> None:
    svg = draw()
    ours = drawing.distinct(svg, key)
    assert ids(ours) == [f"{key}-{i}" for i in ids(svg)]
    assert references(ours) == [f"{key}-{r}" for r in references(svg)]
    assert len(references(svg)) > 5  # clip paths and markers
    assert set(references(ours)) <= set(ids(ours))


def test_distinct_leaves_colours_and_all_else_alone() -> None:
    svg = draw()
    ours = drawing.distinct(svg, "3-11")
    colours = Counter(COLOURS.findall(svg))
    assert {"#ffffff", drawing.ACTUAL, drawing.FAILURE} <= set(colours)
    assert Counter(COLOURS.findall(ours)) == colours
    taken_out = ours.replace('id="3-11-', 'id="').replace("url(#3-11-", "url(#").replace('href="#3-11-', 'href="#')
    assert taken_out == svg


@pytest.mark.parametrize("n", [1, 7, 1000, 1001, 60000])
def test_a_thinned_history_keeps_what_can_be_seen(n: int, rng: np.random.Generator) -> None:
    t, values = np.arange(n) / 100.0, rng.standard_normal(n)
    values[rng.integers(n)] = 50.0
    values[n // 2] = np.inf
    at, kept = drawing.thin(t, values)
    finite = values[np.isfinite(values)]
    assert len(at) == len(kept) <= 2 * drawing.BUCKETS
    assert np.all(np.diff(at) > 0.0)
    assert not np.isinf(kept).any()
    if finite.size:
        assert (np.nanmin(kept), np.nanmax(kept)) == (finite.min(), finite.max())
    if n <= 2 * drawing.BUCKETS:
        assert np.array_equal(at, t)
    at, below, above = drawing.envelope(t, values - 1.0, values + 1.0)
    assert len(at) == len(below) == len(above) <= drawing.BUCKETS or n <= drawing.BUCKETS
    if finite.size:
        assert (np.nanmin(below), np.nanmax(above)) == (finite.min() - 1.0, finite.max() + 1.0)


def test_a_failure_that_is_not_is_not_drawn() -> None:
    with drawing.canvas() as ((axis,), _):
        drawing.mark(axis, None)
        assert len(axis.lines) == 0
        drawing.mark(axis, 4.5)
        assert [line.get_xdata() for line in axis.lines] == [[4.5, 4.5]]
