"""Failures of the airframe; see base.py."""

from __future__ import annotations

from functools import lru_cache

from flightbed.config import kinds
from flightbed.core.signals import Health
from flightbed.failures.base import HealthHistory, failure_tick


def cg_shift(before: HealthHistory, *, shift_cbar: float, at_tick: int) -> HealthHistory:
    """Move the c.g. to ``shift_cbar`` mean chords aft of its take-off position, from ``at_tick`` on."""

    def health(tick: int) -> Health:
        was = before(tick)
        return _moved(was, shift_cbar) if tick >= at_tick else was

    return health


@lru_cache(maxsize=64)  # a flight requests the same value at every tick
def _moved(was: Health, shift_cbar: float) -> Health:
    """Return the health with another c.g. shift."""
    return was._replace(cg_shift_cbar=shift_cbar)


def build(settings: kinds.Failure, before: HealthHistory, control_hz: int) -> HealthHistory:
    """Move the c.g. to shift_cbar mean chords aft of its take-off position, from at_s on."""
    return cg_shift(before, shift_cbar=settings.shift_cbar, at_tick=failure_tick(settings, control_hz))
