"""Document -> one self-contained HTML page: no scripts, no network access, suitable for printing."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from html import escape

from flightbed.document.document import Cell, Claim, Document, Listing, Picture, Section, Table

_STYLE = """
:root { color-scheme: light; }
body { font: 15px/1.5 system-ui, sans-serif; color: #1b1f24; background: #fff; max-width: 62rem; margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.7rem; } h2 { margin-top: 2.4rem; border-bottom: 1px solid #ccd; padding-bottom: .2rem; font-size: 1.25rem; }
nav { columns: 2; font-size: .92rem; } nav a { color: #0b5394; text-decoration: none; }
table { border-collapse: collapse; margin: .8rem 0 1.4rem; font-variant-numeric: tabular-nums; font-size: .9rem; }
caption { text-align: left; font-weight: 600; padding-bottom: .3rem; }
th, td { padding: .2rem .7rem .2rem 0; border-bottom: 1px solid #e3e6ec; text-align: left; vertical-align: top; }
th { color: #555; font-weight: 600; }
.wide { overflow-x: auto; } .n { white-space: nowrap; }
.dense { font-size: .76rem; } .dense th, .dense td { padding-right: .45rem; }
figure { margin: 1.4rem 0 1.8rem; break-inside: avoid; } figure svg { width: 100%; height: auto; }
figcaption { font-size: .92rem; } figcaption b { display: block; }
.facts { color: #444; } .note { color: #555; font-size: .9rem; margin-top: -1rem; }
.claim { border-left: 4px solid; padding: .2rem .8rem; margin: .8rem 0; break-inside: avoid; }
.yes { border-color: #009e73; } .no { border-color: #d55e00; }
.open { border-color: #999; }
.lead p:first-child { font-size: 1.12rem; margin-top: 0; } .lead { border-bottom: 1px solid #ccd; margin-bottom: 1rem; }
.lead td:first-child { white-space: nowrap; }
.listing { font-weight: 600; margin: 1rem 0 .3rem; font-size: .9rem; }
pre { background: #f6f7f9; padding: .6rem .8rem; font: .78rem/1.45 ui-monospace, monospace; }
pre { white-space: pre-wrap; overflow-wrap: anywhere; }
pre.long { columns: 2; }
@media print { pre { background: none; border: 1px solid #ccd; } }
@media print { body { max-width: none; margin: 0; font-size: 11px; } nav { display: none; } }
"""


def render(document: Document) -> str:
    """Return the HTML page of a document."""
    contents = "".join(
        f'<a href="#s{i}">{escape(section.heading)}</a><br>' for i, section in enumerate(document.sections)
    )
    body = "".join(_section(i, section) for i, section in enumerate(document.sections))
    facts = "".join(f"<tr><th>{escape(k)}</th><td>{escape(_fact(v))}</td></tr>" for k, v in document.facts.items())
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width">'
        f'<link rel="icon" href="data:,"><title>{escape(document.title)}</title><style>{_STYLE}</style></head>\n'
        f"<body><h1>{escape(document.title)}</h1>{_lead(document.lead)}<nav>{contents}</nav>{body}"
        f"<h2>How it was made</h2><table>{facts}</table></body></html>\n"
    )


def _fact(value: object) -> str:
    return ", ".join(f"{k} {v}" for k, v in value.items()) if isinstance(value, Mapping) else str(value)


def _section(number: int, section: Section) -> str:
    return f'<h2 id="s{number}">{escape(section.heading)}</h2>{_inside(section)}\n'


def _lead(section: Section) -> str:
    inside = _inside(section)
    return f'<div class="lead">{inside}</div>' if inside else ""


def _inside(section: Section) -> str:
    text = "".join(f"<p>{escape(paragraph)}</p>" for paragraph in section.text)
    return text + "".join(_DRAW[type(item)](item) for item in section.items)


def _table(table: Table) -> str:
    head = "".join(f"<th>{escape(c)}</th>" for c in table.columns)
    rows = "".join("<tr>" + "".join(map(_cell, row, table.cell_texts(row))) + "</tr>" for row in table.rows)
    note = f'<p class="note">{escape(table.note)}</p>' if table.note else ""
    kind = ' class="dense"' if len(table.columns) > _MANY else ""
    return f'<div class="wide"><table{kind}><caption>{escape(table.title)}</caption><tr>{head}</tr>{rows}</table></div>{note}'


def _cell(value: Cell, text: str) -> str:
    return f"<td{'' if isinstance(value, str) else ' class=n'}>{escape(text)}</td>"


_VERDICTS = {
    True: ("yes", "The computation agrees."),
    False: ("no", "The computation disagrees."),
    None: ("open", "These runs do not decide."),
}


def _claim(claim: Claim) -> str:
    i = claim.interval
    kind, verdict = _VERDICTS[claim.holds]
    return (
        f'<div class="claim {kind}"><b>{escape(claim.text)}</b> {verdict}<br>'
        f"{escape(claim.measured)}: {i.estimate:.3g} (95 % interval {i.low:.3g} to {i.high:.3g}, {i.runs} runs)</div>"
    )


def _picture(picture: Picture) -> str:
    facts = f'<span class="facts"> {escape(picture.facts)}</span>' if picture.facts else ""
    return (
        f'<figure id="{escape(picture.key)}">{picture.svg}<figcaption><b>{escape(picture.title)}</b>'
        f"{escape(picture.parameters)}{facts}</figcaption></figure>"
    )


def _listing(listing: Listing) -> str:
    kind = ' class="long"' if listing.text.count("\n") > _LONG else ""
    return f'<p class="listing">{escape(listing.title)}</p><pre{kind}>{escape(listing.text)}</pre>'


_MANY = 7  # a table with more columns is set in a small font
_LONG = 40  # a listing with more lines is set in two columns
_DRAW: dict[type, Callable[..., str]] = {Table: _table, Claim: _claim, Picture: _picture, Listing: _listing}
