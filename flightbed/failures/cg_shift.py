"""Failures of the airframe; see base.py."""

from __future__ import annotations

from functools import lru_cache
from typing import Annotated, Literal

from flightbed.config.kinds import FailureSettings
from flightbed.config.table import between, example
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


class CgShift(FailureSettings):
    """A shift of the c.g.: fuel, stores or cargo move."""

    kind: Literal["cg-shift"] = "cg-shift"
    shift_cbar: Annotated[float, between(-0.5, 0.5), example(0.02)]
    """Shift from the position at take-off, in mean chords, aft positive."""

    @property
    def moves_cg(self) -> bool:
        """Whether the c.g. moves in flight."""
        return True

    def build(self, before: HealthHistory, control_hz: int) -> HealthHistory:
        """Return the health as a function of the tick."""
        return cg_shift(before, shift_cbar=self.shift_cbar, at_tick=failure_tick(self, control_hz))

    def in_words(self) -> str:
        """Return what happens at ``at_s``."""
        where = "aft" if self.shift_cbar >= 0.0 else "ahead"
        return f"the c.g. moves to {abs(self.shift_cbar):.1%} of the chord {where} of its position at take-off"
