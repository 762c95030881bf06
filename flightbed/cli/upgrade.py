"""The command `flightbed upgrade`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from rich.markup import escape

from flightbed.cli.screen import print_lines

if TYPE_CHECKING:
    from flightbed.scenario.upgrade import Dropped


def upgrade(file: Path, /) -> None:
    """Rewrite a scenario file of version 0.1: remove the keys without effect, and print them.

    Campaign files and aircraft have the same format in both versions; they are checked and stay as they are.

    Args:
        file: The TOML file.

    """
    from flightbed.campaigns.file import load_programme
    from flightbed.config.reading import parse_toml, read_toml
    from flightbed.core.files import write_atomic
    from flightbed.models.linear_aircraft import load_flyable
    from flightbed.scenario.upgrade import upgraded

    raw = read_toml(file)
    dropped: list[Dropped] = []
    if file.name == "aircraft.toml":
        load_flyable(str(file.parent))
    elif "base" in raw or "axes" in raw:
        load_programme(file)
    else:
        text, dropped = upgraded(file.read_text(encoding="utf-8"), str(file))
        parse_toml(text, str(file))  # before the file is replaced
        if dropped:
            write_atomic(file, text.encode(), option="upgrade")
    print_lines(escape(f"{file}: {key} = {value} removed: no effect with {why}") for key, value, why in dropped)
    if not dropped:
        print_lines([escape(f"{file}: nothing to change")])
