"""Failures of the airframe; see base.py."""

from __future__ import annotations

from functools import lru_cache

from flightbed.failures.base import Failing
from flightbed.signals import Health


def cg_moved(before: Failing, *, shift_cbar: float, at_tick: int) -> Failing:
    """Put the c.g. ``shift_cbar`` mean chords aft of where it was at take-off, from ``at_tick`` on."""

    def health(tick: int) -> Health:
        was = before(tick)
        return _moved(was, shift_cbar) if tick >= at_tick else was

    return health


@lru_cache(maxsize=64)  # a flight asks for the same value at every tick
def _moved(was: Health, shift_cbar: float) -> Health:
    """Return what was, with the c.g. elsewhere."""
    return was._replace(cg_shift_cbar=shift_cbar)
