"""A failure is a function of the tick that wraps the previous failure and passes its health unchanged before its own start.

A failure changes its own fields of Health only: a failure of the elevator keeps the c.g. shift of an earlier failure, and vice versa.
Where two failures set the same field, the later one replaces the earlier one.
"""

from __future__ import annotations

from collections.abc import Callable
from math import ceil

from flightbed.config.kinds import FailureSettings
from flightbed.core.signals import HEALTHY, Health

HealthHistory = Callable[[int], Health]


def healthy(_tick: int) -> Health:
    """Return the health of the aircraft as built."""
    return HEALTHY


def failure_tick(settings: FailureSettings, control_hz: int) -> int:
    """Return the first tick at or after the failure's time; round-off in at_s * control_hz does not delay it."""
    return ceil(settings.at_s * control_hz - 1e-6)
