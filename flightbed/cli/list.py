"""The command `flightbed list`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

from rich.console import RenderableType
from rich.markup import escape

from flightbed.cli.screen import print_lines

Family = Literal["aircraft", "scenarios", "campaigns", "estimators", "laws", "failures", "commands", "studies"]


def list_(family: Family | None = None, /) -> None:
    """List aircraft, scenarios, campaigns, estimators, laws, failures, commands and studies, one per line.

    Args:
        family: The family to list. Default: all.

    """
    print_lines(list_lines(family))


def list_lines(family: Family | None) -> Iterator[RenderableType]:
    """Yield name and description of each member of a family, or of all families under headings if None."""
    from flightbed.config import families

    for one in [family] if family else ["aircraft", "scenarios", "campaigns", *families.FAMILIES]:
        if not family:
            yield f"[bold]{one}[/bold]"
        members = _members(one)
        width = max((len(name) for name, _ in members), default=0)
        for name, text in members:
            yield f"{'' if family else '  '}{name:<{width}}  {escape(text)}"


def _members(family: str) -> list[tuple[str, str]]:
    """Return name and description of each member of a family."""
    from flightbed.config import families
    from flightbed.config.reading import read_toml
    from flightbed.core import data
    from flightbed.models.linear_aircraft import load_flyable
    from flightbed.scenario.reading import load_scenario

    if family == "aircraft":
        return [(name, load_flyable(name).description) for name in data.names("aircraft")]
    if family == "scenarios":
        return [(name, load_scenario(name).description) for name in data.names("scenario")]
    if family == "campaigns":
        return [(name, str(read_toml(data.find_flights(name))["description"])) for name in data.names("campaign")]
    return [(name, families.summary(family, name)) for name in families.names(family)]
