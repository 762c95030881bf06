"""Failures are functions that compose, and the identity before their start."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flightbed.failures.effector import healthy, ramped, weakened


@given(at=st.integers(0, 1000), to=st.floats(0, 1), tick=st.integers(0, 2000))
def test_identity_before_and_constant_after(at: int, to: float, tick: int) -> None:
    assert weakened(healthy, to=to, at_tick=at)(tick) == (to if tick >= at else 1.0)


def test_a_second_failure_follows_the_first() -> None:
    two = weakened(weakened(healthy, to=0.6, at_tick=100), to=0.2, at_tick=300)
    assert [two(k) for k in (0, 99, 100, 299, 300)] == [1.0, 1.0, 0.6, 0.6, 0.2]


def test_a_ramp_is_straight_from_what_was_to_what_is_left() -> None:
    half = weakened(healthy, to=0.5, at_tick=10)
    ramp = ramped(half, to=0.1, at_tick=20, ticks=4)
    assert [ramp(k) for k in (0, 9, 10, 19)] == [1.0, 1.0, 0.5, 0.5]
    assert [ramp(k) for k in (20, 21, 22, 23, 24, 99)] == pytest.approx([0.4, 0.3, 0.2, 0.1, 0.1, 0.1])
