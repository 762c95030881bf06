"""Failures of a control surface: reduced effectiveness, or an actuator that does not follow its command; see base.py."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache
from math import inf
from types import MappingProxyType
from typing import Any

from flightbed.config import kinds
from flightbed.core.signals import HEALTHY, SURFACES, Health
from flightbed.core.units import DEG
from flightbed.failures.base import HealthHistory, failure_tick

# Surface -> the fields of Health that hold its effectiveness.
_SHARES: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {"elevator": ("effectiveness", "elevator_force"), "aileron": ("aileron",), "rudder": ("rudder",)}
)


def effectiveness_loss(before: HealthHistory, *, to: float, at_tick: int, surface: str = "elevator") -> HealthHistory:
    """Scale the moments and forces of a deflection by ``to``, from ``at_tick`` on."""
    return _from(before, at_tick, lambda was: _shared(was, _SHARES[surface], (to,) * len(_SHARES[surface])))


def structural_damage(before: HealthHistory, *, to: float, force_to: float, at_tick: int) -> HealthHistory:
    """Scale the elevator's pitching moment by ``to`` and its lift and drag by ``force_to``, from ``at_tick`` on.

    The control vector b = (Z_delta, M_delta) changes its direction as well as its length.
    """
    return _from(before, at_tick, lambda was: _shared(was, _SHARES["elevator"], (to, force_to)))


def ramp(before: HealthHistory, *, to: float, at_tick: int, ticks: int, surface: str = "elevator") -> HealthHistory:
    """Reduce moments and forces linearly over ``ticks`` ticks, from their share just before ``at_tick`` to ``to``."""
    fields = _SHARES[surface]
    left = [getattr(before(at_tick - 1), field) for field in fields]

    def health(tick: int) -> Health:
        was = before(tick)
        if tick < at_tick:
            return was
        gone = min(1.0, (tick - at_tick + 1) / ticks)
        return _shared(was, fields, tuple(share + (to - share) * gone for share in left))

    return health


def stuck(before: HealthHistory, *, surface: str, at_tick: int) -> HealthHistory:
    """Jam the actuator at its position at ``at_tick``."""
    return _faulty(before, surface, at_tick, stuck=True)


def hardover(before: HealthHistory, *, surface: str, to_rad: float, at_tick: int) -> HealthHistory:
    """Drive the actuator to a position, limited by the stops, and hold it there, from ``at_tick`` on."""
    return _faulty(before, surface, at_tick, hardover_rad=to_rad)


def bias(before: HealthHistory, *, surface: str, by_rad: float, at_tick: int) -> HealthHistory:
    """Add a deflection that acts but is absent from the position feedback, from ``at_tick`` on."""
    return _faulty(before, surface, at_tick, bias_rad=by_rad)


def rate_limited(before: HealthHistory, *, surface: str, to: float, at_tick: int) -> HealthHistory:
    """Scale the actuator's rate limit by ``to``, from ``at_tick`` on."""
    return _faulty(before, surface, at_tick, rate_share=to)


def floating(before: HealthHistory, *, surface: str, at_tick: int) -> HealthHistory:
    """Detach the surface from its actuator at ``at_tick``: it floats in the airstream, and the actuator's position has no effect."""
    return effectiveness_loss(_faulty(before, surface, at_tick, floats=True), to=0.0, at_tick=at_tick, surface=surface)


def _from(before: HealthHistory, at_tick: int, change: Callable[[Health], Health]) -> HealthHistory:
    seen, made = (
        HEALTHY,
        change(HEALTHY),
    )  # last result: a flight calls at every tick, and the result seldom changes

    def health(tick: int) -> Health:
        nonlocal seen, made
        was = before(tick)
        if tick < at_tick:
            return was
        if was is not seen:
            seen, made = was, change(was)
        return made

    return health


def _faulty(before: HealthHistory, surface: str, at_tick: int, **wrong: Any) -> HealthHistory:
    return _from(before, at_tick, lambda was: _wrong(was, SURFACES.index(surface), tuple(wrong.items())))


# A flight requests the same value at every tick, and plants detect a change by object identity.
@lru_cache(maxsize=64)
def _shared(was: Health, fields: tuple[str, ...], shares: tuple[float, ...]) -> Health:
    """Return the health with other shares in some fields."""
    changed: dict[str, Any] = dict(zip(fields, shares, strict=True))
    return was._replace(**changed)


@lru_cache(maxsize=64)
def _wrong(was: Health, number: int, wrong: tuple[tuple[str, Any], ...]) -> Health:
    """Return the health with further faults in one actuator."""
    elevator, aileron, rudder = (
        fault._replace(**dict(wrong)) if i == number else fault for i, fault in enumerate(was.faults)
    )
    return was._replace(faults=(elevator, aileron, rudder))


def build_effectiveness(settings: kinds.Failure, before: HealthHistory, control_hz: int) -> HealthHistory:
    """Scale the effect of the deflection by `to`, from the first tick at or after at_s."""
    return effectiveness_loss(
        before, surface=settings.surface, to=settings.to, at_tick=failure_tick(settings, control_hz)
    )


def build_structural(settings: kinds.Failure, before: HealthHistory, control_hz: int) -> HealthHistory:
    """Scale the elevator's pitching moment by `to` and its lift and drag by `force_to`, from at_s on."""
    return structural_damage(
        before, to=settings.to, force_to=settings.force_to, at_tick=failure_tick(settings, control_hz)
    )


def build_ramp(settings: kinds.Failure, before: HealthHistory, control_hz: int) -> HealthHistory:
    """Reduce the build_effectiveness linearly from its value at at_s to `to`, over over_s seconds."""
    at_tick = failure_tick(settings, control_hz)
    ticks = max(1, round(settings.over_s * control_hz))
    return ramp(before, surface=settings.surface, to=settings.to, at_tick=at_tick, ticks=ticks)


def build_stuck(settings: kinds.Failure, before: HealthHistory, control_hz: int) -> HealthHistory:
    """Jam the actuator at its position at at_s."""
    return stuck(before, surface=settings.surface, at_tick=failure_tick(settings, control_hz))


def build_floating(settings: kinds.Failure, before: HealthHistory, control_hz: int) -> HealthHistory:
    """Detach the surface from its actuator at at_s; it floats in the airstream."""
    return floating(before, surface=settings.surface, at_tick=failure_tick(settings, control_hz))


def build_hardover(settings: kinds.Failure, before: HealthHistory, control_hz: int) -> HealthHistory:
    """Run the actuator to the stop on the side low or high from at_s on, at its rate limit."""
    to_rad = inf if settings.side == "high" else -inf
    return hardover(before, surface=settings.surface, to_rad=to_rad, at_tick=failure_tick(settings, control_hz))


def build_rate_limit(settings: kinds.Failure, before: HealthHistory, control_hz: int) -> HealthHistory:
    """Scale the actuator's rate limit by `to`, from at_s on."""
    return rate_limited(before, surface=settings.surface, to=settings.to, at_tick=failure_tick(settings, control_hz))


def build_bias(settings: kinds.Failure, before: HealthHistory, control_hz: int) -> HealthHistory:
    """Add bias_deg to the acting deflection, absent from the position feedback, from at_s on."""
    return bias(
        before, surface=settings.surface, by_rad=settings.bias_deg * DEG, at_tick=failure_tick(settings, control_hz)
    )
