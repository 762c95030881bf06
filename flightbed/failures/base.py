"""What a failure is: a function of the tick that wraps the one before it, the identity before its start.

Each changes its own quantities of the Health and passes the others on: a failure of the elevator leaves the c.g. where an
earlier one has put it, and the other way round. Of the same quantity the later failure replaces the earlier.
"""

from __future__ import annotations

from collections.abc import Callable

from flightbed.signals import HEALTHY, Health

Failing = Callable[[int], Health]


def healthy(_tick: int) -> Health:
    """Everything works."""
    return HEALTHY
