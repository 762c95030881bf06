"""Compile the kernels that the shipped scenarios need, into the user's cache folder."""

from __future__ import annotations

from collections.abc import Callable

from flightbed.core import data
from flightbed.runs.run import run
from flightbed.scenario.reading import load_scenario


def compile_shipped(progress: Callable[[int, int], None]) -> int:
    """Fly every shipped scenario, without a folder: the kernels that the cache lacks are compiled, for later processes too.

    Args:
        progress: called with the numbers of flown and of all scenarios, after each.

    Returns: number of scenarios.

    """
    names = list(data.names("scenario"))
    for done, name in enumerate(names, start=1):
        run(load_scenario(name), rerun=False, report=False)
        progress(done, len(names))
    return len(names)
