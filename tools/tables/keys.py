"""The tables of keys in docs/scenario.md, from the settings classes: ``python -m tools.tables.keys`` writes them."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from flightbed.config import families
from flightbed.config.catalogue import Key, catalogue
from flightbed.config.kinds import COMMANDS, ESTIMATORS, FAILURES, GUSTS, LAWS
from flightbed.config.table import inner_table
from flightbed.scenario.tables import Scenario

PAGE = Path(__file__).resolve().parents[2] / "docs" / "scenario.md"
_BLOCK = re.compile("(<!-- keys.py -->\n).*?(<!-- end -->)", flags=re.DOTALL)
_FAMILIES = {
    "command": ("Commands", COMMANDS, "Keys of `command`; `lateral.roll` and `lateral.sideslip` have the same kinds and keys, see below. "
        "[commands.md](commands.md) compares the kinds."),
    "gusts": ("Gusts", GUSTS, "A list, `[[gusts]]`; gusts add up."),
    "failures": (
        "Failures",
        FAILURES,
        "A list, `[[failures]]`. Failures act in order of time; one replaces an earlier one of the same surface and the same "
        "quantity only. See [failures of a surface](#failures-of-a-surface).",
    ),
    "control": ("Laws", LAWS, "Keys of `control`. See [control.md](control.md)."),
    "estimators": (
        "Estimators",
        ESTIMATORS,
        "A list, `[[estimators]]`: several run side by side, at most one corrects the law. See [estimation.md](estimation.md).",
    ),
}  # fmt: skip
_OTHER_COMMANDS = ("lateral.roll", "lateral.sideslip")


def text() -> str:
    """Return the generated part of the page."""
    keys = catalogue(Scenario)
    parts = [*_plain(keys)]
    for place, (title, family, words) in _FAMILIES.items():
        parts += _family(keys, place, title, family, words)
        if place == "command":
            parts += ["#### Roll and sideslip commands", *_rows(_of_other_commands(keys))]
    return "\n\n".join(parts)


def filled(page: str) -> str:
    """Return a page with the generated part between its markers. Raises ValueError without them."""
    if len(_BLOCK.findall(page)) != 1:
        raise ValueError(f"{PAGE.name}: there must be one pair of markers, <!-- keys.py --> and <!-- end -->")
    return _BLOCK.sub(lambda found: f"{found[1]}{text()}\n{found[2]}", page)


def _plain(keys: Sequence[Key]) -> Iterator[str]:
    """Yield the tables without kinds, each with its heading."""
    yield "### The file"
    yield from _rows(key for key in keys if "." not in key.path)
    for name, field in Scenario.model_fields.items():
        table = inner_table(field)
        if table is None or name in _FAMILIES:
            continue
        yield f"### `{name}`"
        yield _paragraphs(table.__doc__)
        mine = (key for key in keys if key.path.startswith(f"{name}."))
        yield from _rows(key for key in mine if not key.path.startswith(_OTHER_COMMANDS))


def _family(keys: Sequence[Key], place: str, title: str, family: object, words: str) -> Iterator[str]:
    """Yield the section of a family: the keys of every kind, and one section per kind."""
    names = families.built_in(family.name)  # type: ignore[attr-defined]
    mine = [key for key in keys if key.path.startswith(f"{place}.")]
    common = [key for key in mine if not key.kinds or len(key.kinds) == len(names)]
    yield f"### {title}"
    yield words
    yield from _rows(common)
    for name in names:
        yield f"#### `{name}`"
        yield _paragraphs(family.of(name).__doc__)  # type: ignore[attr-defined]
        yield from _rows(key for key in mine if name in key.kinds and key not in common)


def _of_other_commands(keys: Sequence[Key]) -> Iterator[Key]:
    """Yield the keys of the roll and sideslip commands that differ from those of the pitch command: their kind and amplitude."""
    for key in keys:
        if key.path.startswith(_OTHER_COMMANDS) and key.path.rpartition(".")[2].startswith(("kind", "amplitude")):
            yield key


def _rows(keys: Iterable[Key]) -> Iterator[str]:
    """Yield one Markdown table; none without keys."""
    rows = [_row(key) for key in keys]
    if rows:
        yield "\n".join(["| key | values | default | meaning |", "|---|---|---|---|", *dict.fromkeys(rows)])


def _row(key: Key) -> str:
    values = f"{key.values}{',' if key.unit and key.values == 'a number' else ''} {key.unit}".strip()
    default = "required" if key.required else f"`{_value(key.default)}`" if key.default else "-"
    only = f" Only with {key.condition}." if key.condition else ""
    return f"| `{key.path}` | {values} | {default} | {key.description}{only} |"


def _value(default: str) -> str:
    """Return a default in short form: 5 instead of 5.0."""
    value = json.loads(default)
    return f"{value:g}" if isinstance(value, float) else default


def _paragraphs(text: str | None) -> str:
    """Return the paragraphs of a docstring, each in one line."""
    return "\n\n".join(" ".join(part.split()) for part in (text or "").replace("``", "`").split("\n\n"))


def main() -> None:
    PAGE.write_text(filled(PAGE.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    main()
