"""Failures of a control effector, as functions of the tick; each is the identity before its start."""

from __future__ import annotations

from collections.abc import Callable

Effectiveness = Callable[[int], float]


def healthy(_tick: int) -> float:
    """Everything works: K = 1."""
    return 1.0


def weakened(before: Effectiveness, *, to: float, at_tick: int) -> Effectiveness:
    """Keep the share ``to`` of the deflection's effect from ``at_tick`` on; before it, whatever was before."""

    def effectiveness(tick: int) -> float:
        return to if tick >= at_tick else before(tick)

    return effectiveness


def ramped(before: Effectiveness, *, to: float, at_tick: int, ticks: int) -> Effectiveness:
    """Go straight from what it is just before ``at_tick`` to ``to`` in so many ticks, and stay there; before it, whatever was before."""
    left = before(at_tick - 1)

    def effectiveness(tick: int) -> float:
        if tick < at_tick:
            return before(tick)
        return left + (to - left) * min(1.0, (tick - at_tick + 1) / ticks)

    return effectiveness
