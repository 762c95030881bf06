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
