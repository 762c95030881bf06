"""Harmonics of a period within a band. No slow import here: reading any scenario needs this module."""

from __future__ import annotations

from math import ceil, floor

MOST_HARMONICS = 100  # the phase search takes seconds at this number


def harmonics(*, low_hz: float, high_hz: float, period_s: float) -> range:
    """Return the numbers of the harmonics of 1 / period_s from low_hz to high_hz, both included; empty if there is none."""
    return range(max(1, ceil(low_hz * period_s - 1e-9)), floor(high_hz * period_s + 1e-9) + 1)
