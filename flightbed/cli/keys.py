"""The command `flightbed keys`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from rich.markup import escape

from flightbed.cli.screen import print_lines
from flightbed.core.errors import InputError

if TYPE_CHECKING:
    from flightbed.config.catalogue import Key


def keys(pattern: str | None = None, /) -> None:
    """List the keys of a scenario: kinds that have the key, unit, range, default and description.

    Args:
        pattern: Part of a key, a kind or a description. Default: all keys.

    """
    from flightbed.config.catalogue import catalogue
    from flightbed.scenario.tables import Scenario

    wanted = (pattern or "").lower()
    found = [key for key in catalogue(Scenario) if wanted in _searched(key)]
    if not found:
        raise InputError(f"keys {pattern}: no key contains it; flightbed keys lists all")
    print_lines(line for key in found for line in _lines(key))


def _searched(key: Key) -> str:
    """Return the text in which a pattern is searched."""
    return " ".join((key.path, *key.kinds, key.values, key.description)).lower()


def _lines(key: Key) -> Iterator[str]:
    """Yield the line of a key and its description."""
    default = "required" if key.required else f"default {key.default}" if key.default else "no default"
    unit = "" if not key.unit else f" {key.unit}"
    only = f" Only with {key.condition}." if key.condition else ""
    kinds = f" ({', '.join(key.kinds)})" if key.kinds else ""
    yield f"[bold]{key.path}[/bold]  {escape(f'{key.values}{unit}; {default}')}"
    yield escape(f"    {key.description}{only}{kinds}")
