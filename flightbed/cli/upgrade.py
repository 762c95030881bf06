"""The command `flightbed upgrade`."""

from __future__ import annotations

from pathlib import Path

from rich.text import Text

from flightbed.cli.screen import print_lines


def upgrade(file: Path, /) -> None:
    """Rewrite a scenario file of version 0.1: remove the keys without effect, and print them.

    Campaign files and aircraft have the same format in both versions and stay as they are.

    Args:
        file: The TOML file.

    """
    from flightbed.config.reading import parse_toml, read_toml
    from flightbed.core.files import write_atomic
    from flightbed.scenario.upgrade import upgraded

    raw = read_toml(file)
    if "base" in raw or "axes" in raw or "stock" in raw or file.name == "aircraft.toml":
        print_lines([Text(f"{file}: nothing to change")])
        return
    text, dropped = upgraded(file.read_text(encoding="utf-8"), str(file))
    parse_toml(text, str(file))  # before the file is replaced
    if dropped:
        write_atomic(file, text.encode(), option="upgrade")
    print_lines(Text(f"{file}: {key} = {value} removed: no effect with {why}") for key, value, why in dropped)
    if not dropped:
        print_lines([Text(f"{file}: nothing to change")])
