"""The lowest versions that pyproject.toml permits, as pins for pip: ``python -m tests.lowest_versions [EXTRA ...]``."""

from __future__ import annotations

import re
import sys
import tomllib
from collections.abc import Iterable
from pathlib import Path

PROJECT = Path(__file__).resolve().parents[1] / "pyproject.toml"


def lowest(requirement: str) -> str:
    """Return a requirement pinned to its lowest version: ``numpy>=2.0`` -> ``numpy==2.0``. Raises ValueError without a lower bound."""
    name, bounds = re.fullmatch(r"([A-Za-z0-9._-]+)\s*(.*)", requirement).groups()  # type: ignore[union-attr]
    found = [bound[2:].strip() for bound in bounds.split(",") if bound.strip().startswith((">=", "=="))]
    if len(found) != 1:
        raise ValueError(f"{PROJECT.name}: {requirement!r}: must have one lower bound, >= or ==")
    return f"{name}=={found[0]}"


def pins(extras: Iterable[str] = (), only: Iterable[str] | None = None) -> list[str]:
    """Return the pins of all dependencies and of extras, of the extras only the packages named in ``only`` if it is given."""
    project = tomllib.loads(PROJECT.read_text(encoding="utf-8"))["project"]
    extra = [lowest(r) for name in extras for r in project["optional-dependencies"][name]]
    wanted = None if only is None else set(only)
    extra = [pin for pin in extra if wanted is None or pin.partition("==")[0] in wanted]
    if wanted is not None and (missing := wanted - {pin.partition("==")[0] for pin in extra}):
        raise ValueError(f"{PROJECT.name}: extras have no {', '.join(sorted(missing))}")
    return [lowest(r) for r in project["dependencies"]] + extra


if __name__ == "__main__":
    print("\n".join(pins(sys.argv[1:])))
