"""Failures of a control effector; see base.py."""

from __future__ import annotations

from functools import lru_cache

from flightbed.failures.base import Failing
from flightbed.signals import Health


def weakened(before: Failing, *, to: float, at_tick: int) -> Failing:
    """Keep the share ``to`` of all that the deflection does, moment and force, from ``at_tick`` on."""
    return damaged(before, to=to, force_to=to, at_tick=at_tick)


def damaged(before: Failing, *, to: float, force_to: float, at_tick: int) -> Failing:
    """Keep the share ``to`` of the elevator's pitching moment and ``force_to`` of its lift and drag, from ``at_tick`` on.

    The control vector b = (Z_delta, M_delta) then changes its direction, not only its length.
    """

    def health(tick: int) -> Health:
        was = before(tick)
        return _acting(was, to, force_to) if tick >= at_tick else was

    return health


def ramped(before: Failing, *, to: float, at_tick: int, ticks: int) -> Failing:
    """Go straight from what it is just before ``at_tick`` to ``to`` in so many ticks, moment and force, and stay there."""
    left = before(at_tick - 1)

    def health(tick: int) -> Health:
        was = before(tick)
        if tick < at_tick:
            return was
        gone = min(1.0, (tick - at_tick + 1) / ticks)
        return _acting(
            was,
            left.effectiveness + (to - left.effectiveness) * gone,
            left.elevator_force + (to - left.elevator_force) * gone,
        )

    return health


@lru_cache(maxsize=64)  # a flight asks for the same value at every tick
def _acting(was: Health, effectiveness: float, force: float) -> Health:
    """Return what was, with other shares of the elevator."""
    return was._replace(effectiveness=effectiveness, elevator_force=force)
