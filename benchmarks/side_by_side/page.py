"""Results -> the pieces of text between markers, in a page and in the README."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

from .choice import by_flight, reading
from .measures import Results
from .tables import assumed, courses, definitions, false_alarms, markdown, one_flight, short

_BLOCK = "<!-- estimators.py: {} -->\n.*?<!-- end -->"


def pieces(results: Results) -> dict[str, str]:
    """Return name of a marker -> the text that belongs there."""
    return {
        "assumed": markdown(assumed(results)),
        "flights": f"{markdown(courses(results))}\n\n{definitions(results)}",
        "results": "\n\n".join(markdown(one_flight(results, flight)) for flight in results.flights),
        "alarms": markdown(false_alarms(results)),
        "choice": "\n\n".join(
            [markdown(by_flight(results)), "\n".join(f"- {sentence}" for sentence in reading(results))]
        ),
        "short": f"{markdown(short(results))}\n\n{definitions(results)}",
    }


def between_markers(text: str, name: str) -> str:
    """Return what a page has between the markers of a piece. Raises ValueError if it has none or several."""
    found = re.findall(_BLOCK.format(re.escape(name)), text, flags=re.DOTALL)
    if len(found) != 1:
        raise ValueError(f"there must be one pair of markers '{name}' (got {len(found)})")
    return "\n".join(found[0].split("\n")[1:-1])


def filled(text: str, told: Mapping[str, str], names: tuple[str, ...]) -> str:
    """Return a page with some pieces in place of what is between their markers. Raises ValueError without them."""
    for name in names:
        between_markers(text, name)
        block = f"<!-- estimators.py: {name} -->\n{told[name]}\n<!-- end -->"
        text = re.sub(_BLOCK.format(re.escape(name)), lambda _, block=block: block, text, flags=re.DOTALL)
    return text


def write(told: Mapping[str, str], *, page: Path, readme: Path) -> None:
    """Write the short table into the README, all else into the page."""
    own = tuple(name for name in told if name != "short")
    for path, names in ((page, own), (readme, ("short",))):
        path.write_text(filled(path.read_text(encoding="utf-8"), told, names), encoding="utf-8")
