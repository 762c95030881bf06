"""Failures of a control effector: it does less, or its actuator does not do as it is told; see base.py."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache
from types import MappingProxyType
from typing import Any

from flightbed.failures.base import Failing
from flightbed.signals import HEALTHY, SURFACES, Health

# Surface -> the fields of Health that are shares of what it does.
_SHARES: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {"elevator": ("effectiveness", "elevator_force"), "aileron": ("aileron",), "rudder": ("rudder",)}
)


def weakened(before: Failing, *, to: float, at_tick: int, surface: str = "elevator") -> Failing:
    """Keep the share ``to`` of all that a deflection does, moments and forces, from ``at_tick`` on."""
    return _from(before, at_tick, lambda was: _shared(was, _SHARES[surface], (to,) * len(_SHARES[surface])))


def damaged(before: Failing, *, to: float, force_to: float, at_tick: int) -> Failing:
    """Keep the share ``to`` of the elevator's pitching moment and ``force_to`` of its lift and drag, from ``at_tick`` on.

    The control vector b = (Z_delta, M_delta) then changes its direction, not only its length.
    """
    return _from(before, at_tick, lambda was: _shared(was, _SHARES["elevator"], (to, force_to)))


def ramped(before: Failing, *, to: float, at_tick: int, ticks: int, surface: str = "elevator") -> Failing:
    """Go straight from what it is just before ``at_tick`` to ``to`` in so many ticks, moments and forces, and stay there."""
    fields = _SHARES[surface]
    left = [getattr(before(at_tick - 1), field) for field in fields]

    def health(tick: int) -> Health:
        was = before(tick)
        if tick < at_tick:
            return was
        gone = min(1.0, (tick - at_tick + 1) / ticks)
        return _shared(was, fields, tuple(share + (to - share) * gone for share in left))

    return health


def stuck(before: Failing, *, surface: str, at_tick: int) -> Failing:
    """Leave the actuator where it is at ``at_tick``."""
    return _faulty(before, surface, at_tick, stuck=True)


def driven(before: Failing, *, surface: str, to_rad: float, at_tick: int) -> Failing:
    """Let the actuator run to a position and stay there, from ``at_tick`` on: a hardover, if that is a stop."""
    return _faulty(before, surface, at_tick, driven_to_rad=to_rad)


def biased(before: Failing, *, surface: str, by_rad: float, at_tick: int) -> Failing:
    """Add to what acts a deflection that the position feedback does not show, from ``at_tick`` on."""
    return _faulty(before, surface, at_tick, bias_rad=by_rad)


def slowed(before: Failing, *, surface: str, to: float, at_tick: int) -> Failing:
    """Leave the share ``to`` of the actuator's rate limit from ``at_tick`` on."""
    return _faulty(before, surface, at_tick, rate_share=to)


def floating(before: Failing, *, surface: str, at_tick: int) -> Failing:
    """Let the surface come off its actuator at ``at_tick`` and trail in the stream: nothing of the actuator's position acts."""
    return weakened(_faulty(before, surface, at_tick, floats=True), to=0.0, at_tick=at_tick, surface=surface)


def _from(before: Failing, at_tick: int, change: Callable[[Health], Health]) -> Failing:
    seen, made = (
        HEALTHY,
        change(HEALTHY),
    )  # what was made last: a flight asks at every tick, and the answer seldom changes

    def health(tick: int) -> Health:
        nonlocal seen, made
        was = before(tick)
        if tick < at_tick:
            return was
        if was is not seen:
            seen, made = was, change(was)
        return made

    return health


def _faulty(before: Failing, surface: str, at_tick: int, **wrong: Any) -> Failing:
    return _from(before, at_tick, lambda was: _wrong(was, SURFACES.index(surface), tuple(wrong.items())))


# A flight asks for the same value at every tick, and plants tell by identity that nothing has changed.
@lru_cache(maxsize=64)
def _shared(was: Health, fields: tuple[str, ...], shares: tuple[float, ...]) -> Health:
    """Return what was, with other shares."""
    changed: dict[str, Any] = dict(zip(fields, shares, strict=True))
    return was._replace(**changed)


@lru_cache(maxsize=64)
def _wrong(was: Health, number: int, wrong: tuple[tuple[str, Any], ...]) -> Health:
    """Return what was, with more wrong with one actuator."""
    elevator, aileron, rudder = (
        fault._replace(**dict(wrong)) if i == number else fault for i, fault in enumerate(was.faults)
    )
    return was._replace(faults=(elevator, aileron, rudder))
