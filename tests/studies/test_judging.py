"""Verdicts on claims from the position of an interval."""

from __future__ import annotations

import numpy as np
import pytest

from flightbed.statistics.intervals import Interval
from flightbed.studies.judging import above, below, between, beyond, computed, mostly, rarely


@pytest.mark.parametrize(("shift", "under", "over"), [(-5.0, True, False), (5.0, False, True), (0.0, None, None)])
def test_medians_against_a_limit(shift: float, under: bool | None, over: bool | None) -> None:
    values = [1.0 + shift + 0.1 * i for i in range(-10, 11)]
    assert below("k", "t", "m", values, 1.0).holds is under
    assert above("k", "t", "m", values, 1.0).holds is over
    assert below("k", "t", "m", values, 1.0).interval.estimate == pytest.approx(1.0 + shift)


@pytest.mark.parametrize(
    ("low", "high", "inside", "away"),
    [(-0.5, 0.5, True, False), (1.5, 2.0, False, True), (-2.0, -1.5, False, True), (0.5, 1.5, None, None), (-3.0, 3.0, None, None)],
)  # fmt: skip
def test_a_value_against_two_limits(low: float, high: float, inside: bool | None, away: bool | None) -> None:
    interval = Interval(0.5 * (low + high), low, high, 10)
    assert between("k", "t", "m", interval, -1.0, 1.0).holds is inside
    assert beyond("k", "t", "m", interval, 1.0).holds is away


def test_shares() -> None:
    assert mostly("k", "t", "m", [True] * 100).holds is True
    assert mostly("k", "t", "m", [True] * 50 + [False] * 50).holds is False
    assert mostly("k", "t", "m", [True] * 5).holds is None
    assert rarely("k", "t", "m", [False] * 100).holds is True
    assert rarely("k", "t", "m", [True] * 100).holds is False


def test_deterministic_values() -> None:
    claim = computed("k", "t", "m", 3.0, holds=False)
    assert (claim.holds, claim.interval) == (False, Interval(3.0, 3.0, 3.0, 1))
    assert np.isfinite(claim.interval.low)
