"""Chirp: a sine whose frequency sweeps from one value to another."""

from __future__ import annotations

from math import floor, pi
from typing import Literal

import numpy as np

from flightbed.command.band import band_conflicts
from flightbed.command.base import ROUND_OFF_S, Command, Count, Vector
from flightbed.config.kinds import ShapedCommand, Surroundings
from flightbed.config.table import NonNegative, Positive


def chirp(
    *, amplitude_rad_s: float, low_hz: float, high_hz: float, period_s: float, count: int, start_s: float = 0.0
) -> Command:
    """Sweep the frequency linearly from low_hz to high_hz in period_s, ``count`` times; zero before and after.

    With tau the time since the start of the sweep and phi the final phase of the previous sweep,

        u = A sin(phi + 2 pi (low tau + (high - low) tau^2 / (2 period)))

    The phase starts at zero and is continuous; the frequency jumps back to low_hz between sweeps. The last sweep stops after its last
    complete half cycle, so the command starts and ends at zero.
    """
    sweep_cycles = 0.5 * (low_hz + high_hz) * period_s
    half_cycles = floor(2.0 * count * sweep_cycles + 1e-9)  # complete half cycles

    def command(t_s: Vector) -> Vector:
        since = t_s - start_s
        sweep = np.clip(np.floor((since + ROUND_OFF_S) / period_s), 0, max(count - 1, 0))
        tau = since - sweep * period_s
        cycles = sweep * sweep_cycles + (low_hz + 0.5 * (high_hz - low_hz) * tau / period_s) * tau
        active = (since >= 0.0) & (since < count * period_s) & (2.0 * cycles < half_cycles)
        return np.where(active, amplitude_rad_s * np.sin(2.0 * pi * cycles), 0.0)

    return command


class Chirp(ShapedCommand):
    """A sine whose frequency sweeps from low_hz to high_hz in period_s, count times."""

    kind: Literal["chirp"] = "chirp"
    period_s: Positive = 4.5
    """Duration of a sweep."""
    count: Count = 3
    """Number of sweeps."""
    start_s: NonNegative = 0.0
    """Start."""
    low_hz: NonNegative = 0.2
    """Frequency at the start of a sweep."""
    high_hz: Positive = 2.0
    """Frequency at the end of a sweep."""

    def build(self, amplitude_rad_s: float) -> Command:
        """Return the command over time."""
        return chirp(
            amplitude_rad_s=amplitude_rad_s,
            low_hz=self.low_hz,
            high_hz=self.high_hz,
            period_s=self.period_s,
            count=self.count,
            start_s=self.start_s,
        )

    def conflicts(self, place: str, surroundings: Surroundings) -> list[str]:
        """Return the problems of the band."""
        return band_conflicts(place, low_hz=self.low_hz, high_hz=self.high_hz, control_hz=surroundings.control_hz)
