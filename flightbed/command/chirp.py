"""Chirp: a sine whose frequency sweeps from one value to another."""

from __future__ import annotations

from math import floor, pi

import numpy as np

from flightbed.command.base import ROUND_OFF_S, Command, Vector
from flightbed.config import kinds
from flightbed.core.units import DEG


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


def build(settings: kinds.Command) -> Command:
    """Sweep a sine of amplitude_deg_s from low_hz to high_hz in period_s, count times."""
    return chirp(
        amplitude_rad_s=settings.amplitude_deg_s * DEG,
        low_hz=settings.low_hz,
        high_hz=settings.high_hz,
        period_s=settings.period_s,
        count=settings.count,
        start_s=settings.start_s,
    )
