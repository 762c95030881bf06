"""The page of a report: well-formed, self-contained, escaped, the same bytes every time."""

from __future__ import annotations

import re
from collections import Counter
from html import escape
from html.parser import HTMLParser

import pytest

from flightbed.document.document import Claim, Document, Listing, Picture, Section, Table
from flightbed.document.drawing import distinct
from flightbed.document.html import render
from flightbed.statistics.intervals import Interval, Spread, outcome
from tests.document.test_drawing import draw

VOID = {"meta", "link", "br", "img", "input", "hr", "base", "source", "embed"}
NASTY = """<script>alert("x & 'y'")</script>"""


class _Page(HTMLParser):
    """Elements with their attributes, text, and what is wrong with the nesting."""

    def __init__(self, page: str) -> None:
        super().__init__(convert_charrefs=True)
        self.open: list[str] = []
        self.wrong: list[str] = []
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.text: list[str] = []
        self.feed(page)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        if len(dict(attrs)) != len(attrs):
            self.wrong.append(f"<{tag}> has an attribute twice")
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        if not self.open or self.open.pop() != tag:
            self.wrong.append(f"</{tag}>")

    def handle_data(self, data: str) -> None:
        self.text.append(data)


def _document(text: str = "plain", key: str = "3-1") -> Document:
    cells = 0.5, Spread(9, 2, 0.5, 0.1, 0.9), Interval(0.5, 0.25, 1.0, 9), outcome([1.0, None], [None, 3.0]), 7, None
    table = Table("t", text, (text, "K"), [[text, cell] for cell in cells], {"K": ".2f"}, note=text)
    claims = [Claim(f"c{h}", text, text, Interval(-0.5, -0.9, -0.1, 20), holds=h) for h in (True, False, None)]
    pictures = [Picture(k, text, distinct(draw(text), f"f{n}"), text, text) for n, k in enumerate((key, "3-2"))]
    sections = [Section(text, [text, text], [table, *claims]), Section("Figures", [], pictures)]
    return Document(text, sections, {text: text, "versions": {"numpy": "2", text: text}})


@pytest.fixture(scope="module")
def page() -> str:
    return render(_document())


def test_tags_balance(page: str) -> None:
    found = _Page(page)
    assert found.wrong == []
    assert found.open == []
    assert Counter(tag for tag, _ in found.elements)["svg"] == 2


def test_a_tag_that_is_not_closed_would_be_seen() -> None:
    assert _Page("<p><b>x</p></b>").wrong == ["</p>", "</b>"]
    assert _Page("<p><b>x</b>").open == ["p"]


def assert_self_contained(page: str) -> None:
    """Every address is inside the page or data; the only http: are names of XML namespaces and metadata."""
    elements = _Page(page).elements
    assert {tag for tag, _ in elements}.isdisjoint({"script", "iframe", "img", "image", "object", "embed", "base"})
    for tag, attributes in elements:
        for name, value in attributes.items():
            if name.rpartition(":")[2] in {"href", "src", "srcset", "action", "data", "poster"}:
                assert str(value).startswith(("#", "data:")), (tag, name, value)
            assert not name.startswith("on"), (tag, name)
            if re.search("https?:", str(value)):
                assert name.startswith("xmlns") or name == "rdf:resource", (tag, name, value)
    assert "@import" not in page
    assert all(address.startswith("#") for address in re.findall(r"url\(([^)]*)\)", page))


def test_nothing_is_loaded_and_nothing_runs(page: str) -> None:
    assert_self_contained(page)


def assert_sound(page: str) -> None:
    """Tags balance, ids are distinct, and every reference finds one."""
    found = _Page(page)
    assert (found.wrong, found.open) == ([], [])
    ids = Counter(a["id"] for _, a in found.elements if "id" in a)
    assert [i for i, n in ids.items() if n > 1] == []
    assert set(re.findall(r"url\(#([^)]*)\)", page)) <= set(ids)


def words(page: str) -> str:
    """Return the text of a page, as a reader finds it."""
    return "".join(_Page(page).text)


def test_ids_are_distinct_and_every_reference_finds_one(page: str) -> None:
    elements = _Page(page).elements
    ids = Counter(a["id"] for _, a in elements if "id" in a)
    assert [i for i, n in ids.items() if n > 1] == []
    wanted = re.findall(r"url\(#([^)]*)\)", page)
    wanted += [
        str(v)[1:] for _, a in elements for n, v in a.items() if n.rpartition(":")[2] == "href" and str(v)[0] == "#"
    ]
    assert {"s0", "s1"} < set(wanted)
    assert len(wanted) > 10
    assert set(wanted) <= set(ids)


def test_without_keys_of_their_own_drawings_would_collide() -> None:
    pictures = [Picture(key, "", draw(), "") for key in ("a", "b")]
    elements = _Page(render(Document("", [Section("", (), pictures)], {}))).elements
    assert max(Counter(a["id"] for _, a in elements if "id" in a).values()) == 2


def test_all_that_is_text_stays_text(page: str) -> None:
    nasty = render(_document(NASTY, key='"><b>'))
    assert "<script" not in nasty
    found, plain = _Page(nasty), _Page(page)
    assert found.wrong == []
    assert [tag for tag, _ in found.elements] == [tag for tag, _ in plain.elements]
    # Title, heading, contents, paragraphs, table, claims, captions, facts: as often as the plain text.
    assert "".join(found.text).count(NASTY) == "".join(plain.text).count("plain") > 20


def test_what_the_reader_sees(page: str) -> None:
    text = "".join(_Page(page).text)
    assert "0.50 [0.10, 0.90], never in 2 of 9" in text
    assert "1.00 [1.00, 1.00]; 1 of 2 gone at 3.00 s [3.00, 3.00]" in text
    verdicts = ["The computation agrees.", "The computation disagrees.", "These runs do not decide."]
    assert [text.count(verdict) for verdict in verdicts] == [1, 1, 1]
    assert sorted(verdicts, key=text.index) == verdicts
    claims = [str(a["class"]) for _, a in _Page(page).elements if str(a.get("class")).startswith("claim")]
    assert claims == ["claim yes", "claim no", "claim open"]
    assert "-0.5 (95 % interval -0.9 to -0.1, 20 runs)" in text
    assert "versionsnumpy 2, plain plain" in text


def test_what_is_not_there_takes_no_room() -> None:
    """A note and facts only where there are some; cells that do not break are those that are numbers."""

    def classes(note: str, facts: str) -> Counter[str]:
        items = [
            Table("t", "", ("a", "b"), [["text", 1.5], [None, 2]], note=note),
            Picture("p", "", "<svg/>", "", facts),
        ]
        elements = _Page(render(Document("", [Section("", (), items)], {}))).elements
        return Counter(str(a["class"]) for _, a in elements if "class" in a)

    assert classes("", "") == {"wide": 1, "n": 3}
    assert classes("a note", "facts") == {"wide": 1, "n": 3, "note": 1, "facts": 1}


def test_a_listing_keeps_its_lines_and_a_long_one_has_two_columns() -> None:
    short, long = "a = 1\n\nb = '<c>'", "x\n" * 60
    page = render(Document("", [Section("", (), [Listing("file", short), Listing("long", long)])], {}))
    assert f"<pre>a = 1\n\nb = {escape(chr(39))}&lt;c&gt;{escape(chr(39))}</pre>" in page
    assert f'<pre class="long">{long}</pre>' in page


def test_the_lead_comes_before_the_contents() -> None:
    lead = Section("not shown", ["the gist"], [Table("key", "", ("K",), [[0.25]])])
    document = Document("title", [Section("One")], {}, lead)
    page = render(document)
    assert page.index("<h1>title") < page.index("the gist") < page.index("0.25") < page.index("<nav>")
    assert "not shown" not in page
    assert document.to_dict()["tables"] == {"key": [{"K": 0.25}]}
    assert 'class="lead"' not in render(Document("title", [], {}))


def test_the_same_document_is_the_same_bytes(page: str) -> None:
    assert render(_document()) == page
    assert render(_document("other")) != page
