"""Standard atmosphere of the air data computer: pressure and speed of sound from geometric altitude."""

from __future__ import annotations

from math import exp, sqrt
from typing import NamedTuple

from flightbed.core.compiled import compiled

_EARTH_M = 6356766.0  # ISO 2533: between geometric and geopotential altitude
_G0_OVER_R = 9.80665 / 287.05287  # K/m
_LAPSE_K_M = 0.0065
_TROPOPAUSE_M, _T0, _P0 = 11000.0, 288.15, 101325.0


class Air(NamedTuple):
    """Static pressure, Pa, and speed of sound, m/s."""

    pressure_pa: float
    sound_m_s: float


def standard_air(altitude_m: float) -> Air:
    """Return the standard atmosphere (ISO 2533:1975) at a geometric altitude, up to 20 km."""
    height = _EARTH_M * altitude_m / (_EARTH_M + altitude_m)
    low = min(height, _TROPOPAUSE_M)
    temperature = _T0 - _LAPSE_K_M * low
    pressure = _P0 * (temperature / _T0) ** (_G0_OVER_R / _LAPSE_K_M)
    pressure *= exp(-_G0_OVER_R * (height - low) / temperature)
    return Air(pressure, sqrt(1.4 * 287.05287 * temperature))


@compiled
def air(altitude_m: float) -> tuple[float, float]:
    """Return standard pressure, Pa, and speed of sound, m/s; as ``flightbed.core.atmosphere``, compiled."""
    height = 6356766.0 * altitude_m / (6356766.0 + altitude_m)
    low = min(height, 11000.0)
    temperature = 288.15 - 0.0065 * low
    pressure = 101325.0 * (temperature / 288.15) ** (9.80665 / 287.05287 / 0.0065)
    return pressure * exp(-9.80665 / 287.05287 * (height - low) / temperature), sqrt(1.4 * 287.05287 * temperature)
