"""Verdicts on the claims of a paper, from the position of the interval of a median or a share.

A claim holds (True) if the whole interval meets its condition, fails (False) if no part does, and is open (None) otherwise.
"""

from __future__ import annotations

from collections.abc import Sequence

from flightbed.document.document import Claim
from flightbed.statistics.intervals import Interval, median_interval, share

MOST = 0.95  # share of the runs that is counted as all runs


def below(key: str, text: str, measured: str, values: Sequence[float], limit: float = 0.0) -> Claim:
    """Judge the claim that the median of the values is below a limit, from the 95 % interval of the median."""
    interval = median_interval(values)
    return Claim(
        key, text, measured, interval, True if interval.high < limit else False if interval.low >= limit else None
    )


def above(key: str, text: str, measured: str, values: Sequence[float], limit: float = 0.0) -> Claim:
    """Judge the claim that the median of the values is above a limit, from the 95 % interval of the median."""
    interval = median_interval(values)
    return Claim(
        key, text, measured, interval, True if interval.low > limit else False if interval.high <= limit else None
    )


def between(key: str, text: str, measured: str, interval: Interval, low: float, high: float) -> Claim:
    """Judge the claim that a value lies between two limits, from its interval."""
    inside, outside = low <= interval.low and interval.high <= high, interval.high < low or interval.low > high
    return Claim(key, text, measured, interval, True if inside else False if outside else None)


def beyond(key: str, text: str, measured: str, interval: Interval, limit: float) -> Claim:
    """Judge the claim that the magnitude of a value exceeds a limit, from its interval."""
    away, near = interval.low > limit or interval.high < -limit, -limit <= interval.low and interval.high <= limit
    return Claim(key, text, measured, interval, True if away else False if near else None)


def mostly(key: str, text: str, measured: str, happened: Sequence[bool]) -> Claim:
    """Judge the claim that an event happens in at least the share ``MOST`` of the runs."""
    return between(key, text, measured, share(sum(happened), len(happened)), MOST, 1.0)


def rarely(key: str, text: str, measured: str, happened: Sequence[bool]) -> Claim:
    """Judge the claim that an event happens in at most the share ``1 - MOST`` of the runs."""
    return between(key, text, measured, share(sum(happened), len(happened)), 0.0, 1.0 - MOST)


def computed(key: str, text: str, measured: str, value: float, *, holds: bool) -> Claim:
    """Return a claim with the verdict ``holds``, from one deterministic value."""
    return Claim(key, text, measured, Interval(value, value, value, 1), holds)
