"""Failures of a control surface: reduced effectiveness, or an actuator that does not follow its command; see base.py."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache
from math import inf
from types import MappingProxyType
from typing import Annotated, Any, ClassVar, Literal

from flightbed.config.kinds import SurfaceFailure
from flightbed.config.table import Positive, Share, between, example
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


class EffectivenessLoss(SurfaceFailure):
    """A step of the surface's effectiveness: moments and forces of a deflection fall to a share."""

    kind: Literal["effectiveness"] = "effectiveness"
    to: Annotated[Share, example(0.3)]
    """Remaining share of the moments and forces."""

    def build(self, before: HealthHistory, control_hz: int) -> HealthHistory:
        """Return the health as a function of the tick."""
        return effectiveness_loss(before, surface=self.surface, to=self.to, at_tick=failure_tick(self, control_hz))

    def in_words(self) -> str:
        """Return what happens at ``at_s``."""
        return f"the {self.surface} effectiveness steps to {self.to:.0%}"


class Ramp(SurfaceFailure):
    """A ramp of the surface's effectiveness, from its value at at_s on."""

    kind: Literal["ramp"] = "ramp"
    to: Annotated[Share, example(0.3)]
    """Share of the moments and forces at the end of the ramp."""
    over_s: Positive = 2.0
    """Duration."""

    def build(self, before: HealthHistory, control_hz: int) -> HealthHistory:
        """Return the health as a function of the tick."""
        at_tick = failure_tick(self, control_hz)
        ticks = max(1, round(self.over_s * control_hz))
        return ramp(before, surface=self.surface, to=self.to, at_tick=at_tick, ticks=ticks)

    def in_words(self) -> str:
        """Return what happens from ``at_s`` on."""
        return f"the {self.surface} effectiveness ramps to {self.to:.0%} over {self.over_s:g} s"


class StructuralDamage(SurfaceFailure):
    """Damage of the elevator that reduces its moment and its force by different shares."""

    kind: Literal["structural"] = "structural"
    surface: Literal["elevator"] = "elevator"
    to: Annotated[Share, example(0.3)]
    """Remaining share of the pitching moment."""
    force_to: Annotated[Share, example(0.5)]
    """Remaining share of lift and drag."""

    def build(self, before: HealthHistory, control_hz: int) -> HealthHistory:
        """Return the health as a function of the tick."""
        at_tick = failure_tick(self, control_hz)
        return structural_damage(before, to=self.to, force_to=self.force_to, at_tick=at_tick)

    def in_words(self) -> str:
        """Return what happens at ``at_s``."""
        return f"the {self.surface} moment falls to {self.to:.0%}, its lift and drag to {self.force_to:.0%}"


class ActuatorFault(SurfaceFailure):
    """Base class of the faults of an actuator; each acts through a property that the overlay names, SURFACE_SUFFIX."""

    _SUFFIX: ClassVar[str]

    @property
    def actuator(self) -> str:
        """Surface whose actuator is faulty."""
        return self.surface

    @property
    def actuator_property(self) -> str:
        """Property of the overlay through which the fault acts, such as "elevator_stuck"."""
        return f"{self.surface}_{self._SUFFIX}"


class Stuck(ActuatorFault):
    """An actuator that jams at its position."""

    kind: Literal["stuck"] = "stuck"
    _SUFFIX = "stuck"

    def build(self, before: HealthHistory, control_hz: int) -> HealthHistory:
        """Return the health as a function of the tick."""
        return stuck(before, surface=self.surface, at_tick=failure_tick(self, control_hz))

    def in_words(self) -> str:
        """Return what happens at ``at_s``."""
        return f"the {self.surface} is stuck at its current position"


class Floating(ActuatorFault):
    """A surface that detaches from its actuator and floats in the airstream."""

    kind: Literal["floating"] = "floating"
    _SUFFIX = "offset_rad"

    def build(self, before: HealthHistory, control_hz: int) -> HealthHistory:
        """Return the health as a function of the tick."""
        return floating(before, surface=self.surface, at_tick=failure_tick(self, control_hz))

    def in_words(self) -> str:
        """Return what happens at ``at_s``."""
        return f"the {self.surface} is disconnected from its actuator and floats in the airstream"


class Hardover(ActuatorFault):
    """An actuator that runs to a stop at its rate limit."""

    kind: Literal["hardover"] = "hardover"
    side: Annotated[Literal["low", "high"], example("high")]
    """Stop: of the lowest or of the highest deflection."""
    _SUFFIX = "cmd_rad"

    def build(self, before: HealthHistory, control_hz: int) -> HealthHistory:
        """Return the health as a function of the tick."""
        to_rad = inf if self.side == "high" else -inf
        return hardover(before, surface=self.surface, to_rad=to_rad, at_tick=failure_tick(self, control_hz))

    def in_words(self) -> str:
        """Return what happens at ``at_s``."""
        return f"the {self.surface} runs to its {'highest' if self.side == 'high' else 'lowest'} stop, regardless of the command"


class RateLimit(ActuatorFault):
    """An actuator whose rate limit falls to a share."""

    kind: Literal["rate-limit"] = "rate-limit"
    to: Annotated[Share, example(0.3)]
    """Remaining share of the rate limit."""
    _SUFFIX = "rate_limit_rad_s"

    def build(self, before: HealthHistory, control_hz: int) -> HealthHistory:
        """Return the health as a function of the tick."""
        return rate_limited(before, surface=self.surface, to=self.to, at_tick=failure_tick(self, control_hz))

    def in_words(self) -> str:
        """Return what happens at ``at_s``."""
        return f"the {self.surface} rate limit falls to {self.to:.0%}"


class Bias(ActuatorFault):
    """A deflection in addition to the actuator's, absent from the position feedback."""

    kind: Literal["bias"] = "bias"
    bias_deg: Annotated[float, between(-60, 60), example(3.0)]
    """Additional deflection."""
    _SUFFIX = "offset_rad"

    def build(self, before: HealthHistory, control_hz: int) -> HealthHistory:
        """Return the health as a function of the tick."""
        at_tick = failure_tick(self, control_hz)
        return bias(before, surface=self.surface, by_rad=self.bias_deg * DEG, at_tick=at_tick)

    def in_words(self) -> str:
        """Return what happens at ``at_s``."""
        return f"the {self.surface} has a bias of {self.bias_deg:+g} deg that its position feedback does not show"
