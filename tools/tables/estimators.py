"""The tables of docs/estimators.md and the short one of README.md, from the study ``estimators``.

python tools/tables/estimators.py [--runs 80] [--workers N]     # fly, and print the tables
python tools/tables/estimators.py --write                        # also write them into docs/estimators.md and README.md
python tools/tables/estimators.py --quick --runs 1               # short flights, to try the command; their figures have no meaning
"""

from __future__ import annotations

import argparse
import os
import re
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from flightbed.analysis.seeds import processes
from flightbed.document.document import Document, Table
from flightbed.studies.base import reproduce
from flightbed.studies.estimators.comparison import Comparison
from flightbed.studies.estimators.flights import Course
from flightbed.studies.estimators.study import study
from flightbed.studies.estimators.tables import definitions

ROOT = Path(__file__).resolve().parents[2]
RUNS = 80
QUICK = Comparison(course=Course(("duration_s=6.5",)), rounds=1)  # flights end two seconds after their failures
_BLOCK = "<!-- estimators.py: {} -->\n.*?<!-- end -->"


def pieces(document: Document) -> dict[str, str]:
    """Return name of a marker -> the Markdown that stands after it."""
    tables = {table.key: table for table in document.tables()}
    sections = {section.heading: section for section in document.sections}
    definition = definitions(int(document.facts["runs_of_each_case"]))
    results = [item for item in sections["Results"].items if isinstance(item, Table)]
    return {
        "assumed": markdown(tables["assumed"]),
        "flights": f"{markdown(tables['flights'])}\n\n{definition}",
        "results": "\n\n".join(map(markdown, results)),
        "alarms": markdown(tables["alarms"]),
        "choice": "\n\n".join(
            [markdown(tables["choice"]), "\n".join(f"- {line}" for line in sections["Which to choose"].text)]
        ),
        "short": f"{rows(tables['short'])}\n\n{definition}",
    }


def markdown(table: Table) -> str:
    """Return a table in Markdown: title, rows, note."""
    title = f"**{table.title[0].upper()}{table.title[1:]}**\n\n"
    return title + rows(table) + (f"\n\n{table.note}" if table.note else "")


def rows(table: Table) -> str:
    """Return heads and rows of a table in Markdown."""
    return "\n".join(map(_row, [table.columns, ["---"] * len(table.columns), *map(table.cell_texts, table.rows)]))


def _row(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def between_markers(text: str, name: str) -> str:
    """Return the text between the markers of a piece. Raises ValueError if a page has no such pair, or several."""
    found = re.findall(_BLOCK.format(re.escape(name)), text, flags=re.DOTALL)
    if len(found) != 1:
        raise ValueError(f"there must be one pair of markers '{name}' (got {len(found)})")
    return "\n".join(found[0].split("\n")[1:-1])


def filled(text: str, made: Mapping[str, str], names: tuple[str, ...]) -> str:
    """Return a page with new text between the markers of some pieces. Raises ValueError without them."""
    for name in names:
        between_markers(text, name)
        block = f"<!-- estimators.py: {name} -->\n{made[name]}\n<!-- end -->"
        text = re.sub(_BLOCK.format(re.escape(name)), lambda _, block=block: block, text, flags=re.DOTALL)
    return text


def write(made: Mapping[str, str], *, page: Path, readme: Path) -> None:
    """Write the short table into the README, the other pieces into the page."""
    own = tuple(name for name in made if name != "short")
    for path, names in ((page, own), (readme, ("short",))):
        path.write_text(filled(path.read_text(encoding="utf-8"), made, names), encoding="utf-8")


def main(arguments: Sequence[str]) -> int:
    """Fly, print the tables, and write them if requested."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=RUNS, help="seeds of each flight")
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    parser.add_argument("--write", action="store_true", help="into the documents")
    parser.add_argument("--quick", action="store_true", help="short flights: their figures have no meaning")
    given = parser.parse_args(arguments)
    if given.runs < 1:
        parser.error("--runs: must be at least 1")
    if given.quick and given.write:
        parser.error("--write: the figures of --quick mean nothing")
    with processes(given.workers) as executor:
        document = reproduce(study(QUICK if given.quick else Comparison()), given.runs, executor=executor)
    made = pieces(document)
    for name, text in made.items():
        print(f"\n## {name}\n\n{text}")
    if given.write:
        write(made, page=ROOT / "docs" / "estimators.md", readme=ROOT / "README.md")
    print(f"\n{document.facts['wall_time_s']:.0f} s")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
