"""How the claims of a paper are judged: by where the interval of a median, a mean or a share lies."""

from __future__ import annotations

from collections.abc import Sequence

from flightbed.document import Claim
from flightbed.statistics import Interval, median_interval, share

MOST = 0.95  # share of the runs that counts as all


def below(key: str, text: str, measured: str, values: Sequence[float], limit: float = 0.0) -> Claim:
    """Judge that the median of the values is below a limit."""
    interval = median_interval(values)
    return Claim(
        key, text, measured, interval, True if interval.high < limit else False if interval.low >= limit else None
    )


def above(key: str, text: str, measured: str, values: Sequence[float], limit: float = 0.0) -> Claim:
    """Judge that the median of the values is above a limit."""
    interval = median_interval(values)
    return Claim(
        key, text, measured, interval, True if interval.low > limit else False if interval.high <= limit else None
    )


def between(key: str, text: str, measured: str, interval: Interval, low: float, high: float) -> Claim:
    """Judge that a value lies between two limits, from its interval."""
    inside, outside = low <= interval.low and interval.high <= high, interval.high < low or interval.low > high
    return Claim(key, text, measured, interval, True if inside else False if outside else None)


def beyond(key: str, text: str, measured: str, interval: Interval, limit: float) -> Claim:
    """Judge that a value is away from 0 by more than a limit, to either side, from its interval."""
    away, near = interval.low > limit or interval.high < -limit, -limit <= interval.low and interval.high <= limit
    return Claim(key, text, measured, interval, True if away else False if near else None)


def mostly(key: str, text: str, measured: str, happened: Sequence[bool]) -> Claim:
    """Judge that something happens in ``MOST`` of the runs at least."""
    return between(key, text, measured, share(sum(happened), len(happened)), MOST, 1.0)


def rarely(key: str, text: str, measured: str, happened: Sequence[bool]) -> Claim:
    """Judge that something happens in no more than what ``MOST`` leaves."""
    return between(key, text, measured, share(sum(happened), len(happened)), 0.0, 1.0 - MOST)


def computed(key: str, text: str, measured: str, value: float, *, holds: bool) -> Claim:
    """Judge by a number in which there is no chance."""
    return Claim(key, text, measured, Interval(value, value, value, 1), holds)
