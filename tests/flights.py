"""The shipped scenarios, each flown once per test process."""

from __future__ import annotations

from functools import cache

from flightbed.mission import Result, run
from flightbed.scenario import load_scenario


@cache
def flown(name: str) -> Result:
    """Return the flight of a shipped scenario as it stands. Shared between tests: change nothing in it."""
    return run(load_scenario(name), rerun=False)
