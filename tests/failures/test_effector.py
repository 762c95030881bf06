"""Failures of the elevator compose, and are the identity before their start."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flightbed.failures.airframe import cg_moved
from flightbed.failures.base import healthy
from flightbed.failures.effector import damaged, ramped, weakened
from flightbed.signals import HEALTHY, Health


@given(at=st.integers(0, 1000), to=st.floats(0, 1), tick=st.integers(0, 2000))
def test_identity_before_and_constant_after(at: int, to: float, tick: int) -> None:
    """An ordinary loss takes moment and force alike."""
    assert weakened(healthy, to=to, at_tick=at)(tick) == (Health(to, to) if tick >= at else HEALTHY)


@given(
    at=st.integers(0, 1000),
    to=st.floats(0, 1),
    force_to=st.floats(0, 1),
    tick=st.integers(0, 2000),
    cg=st.floats(-0.1, 0.1),
)
def test_structural_damage_changes_both_shares_and_nothing_else(
    at: int, to: float, force_to: float, tick: int, cg: float
) -> None:
    before = cg_moved(healthy, shift_cbar=cg, at_tick=0)
    expected = Health(to, force_to, cg) if tick >= at else Health(cg_shift_cbar=cg)
    assert damaged(before, to=to, force_to=force_to, at_tick=at)(tick) == expected


def test_a_second_failure_follows_the_first() -> None:
    two = weakened(damaged(healthy, to=0.6, force_to=0.9, at_tick=100), to=0.2, at_tick=300)
    assert [two(k) for k in (0, 99, 100, 299, 300)] == [
        HEALTHY,
        HEALTHY,
        Health(0.6, 0.9),
        Health(0.6, 0.9),
        Health(0.2, 0.2),
    ]


def test_a_ramp_is_straight_from_what_was_to_what_is_left() -> None:
    half = damaged(healthy, to=0.5, force_to=0.9, at_tick=10)
    ramp = ramped(half, to=0.1, at_tick=20, ticks=4)
    assert [ramp(k) for k in (0, 9, 10, 19)] == [HEALTHY, HEALTHY, Health(0.5, 0.9), Health(0.5, 0.9)]
    later = [ramp(k) for k in (20, 21, 22, 23, 24, 99)]
    assert [h.effectiveness for h in later] == pytest.approx([0.4, 0.3, 0.2, 0.1, 0.1, 0.1])
    assert [h.elevator_force for h in later] == pytest.approx([0.7, 0.5, 0.3, 0.1, 0.1, 0.1])


def test_a_ramp_goes_on_while_the_cg_moves() -> None:
    ramp = ramped(cg_moved(healthy, shift_cbar=0.02, at_tick=22), to=0.2, at_tick=20, ticks=4)
    assert [ramp(k).cg_shift_cbar for k in (21, 22, 30)] == [0.0, 0.02, 0.02]
    assert [ramp(k).effectiveness for k in (21, 22, 30)] == pytest.approx([0.6, 0.4, 0.2])


def test_a_flight_is_given_the_same_object_as_long_as_nothing_changes() -> None:
    """The plant writes nothing into JSBSim while it is the same, and the loop makes no value at every tick."""
    both = weakened(cg_moved(healthy, shift_cbar=0.02, at_tick=5), to=0.2, at_tick=10)
    for first, last in ((0, 4), (5, 9), (10, 99)):
        assert all(both(k) is both(first) for k in range(first, last + 1))
