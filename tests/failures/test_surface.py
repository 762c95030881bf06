"""Failures of surfaces compose, and are the identity before their start."""

from __future__ import annotations

from collections.abc import Callable
from math import inf
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flightbed.core.signals import HEALTHY, NO_FAULT, SURFACES, Fault, Health
from flightbed.failures.base import HealthHistory, healthy
from flightbed.failures.cg_shift import cg_shift
from flightbed.failures.surface import (
    bias,
    effectiveness_loss,
    floating,
    hardover,
    ramp,
    rate_limited,
    structural_damage,
    stuck,
)


@given(at=st.integers(0, 1000), to=st.floats(0, 1), tick=st.integers(0, 2000))
def test_identity_before_and_constant_after(at: int, to: float, tick: int) -> None:
    """A loss of effectiveness scales moment and force equally."""
    assert effectiveness_loss(healthy, to=to, at_tick=at)(tick) == (Health(to, to) if tick >= at else HEALTHY)


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
    before = cg_shift(healthy, shift_cbar=cg, at_tick=0)
    expected = Health(to, force_to, cg) if tick >= at else Health(cg_shift_cbar=cg)
    assert structural_damage(before, to=to, force_to=force_to, at_tick=at)(tick) == expected


def test_a_second_failure_follows_the_first() -> None:
    two = effectiveness_loss(structural_damage(healthy, to=0.6, force_to=0.9, at_tick=100), to=0.2, at_tick=300)
    assert [two(k) for k in (0, 99, 100, 299, 300)] == [
        HEALTHY,
        HEALTHY,
        Health(0.6, 0.9),
        Health(0.6, 0.9),
        Health(0.2, 0.2),
    ]


def test_a_ramp_is_linear_from_the_previous_share_to_the_remaining_one() -> None:
    half = structural_damage(healthy, to=0.5, force_to=0.9, at_tick=10)
    loss = ramp(half, to=0.1, at_tick=20, ticks=4)
    assert [loss(k) for k in (0, 9, 10, 19)] == [HEALTHY, HEALTHY, Health(0.5, 0.9), Health(0.5, 0.9)]
    later = [loss(k) for k in (20, 21, 22, 23, 24, 99)]
    assert [h.effectiveness for h in later] == pytest.approx([0.4, 0.3, 0.2, 0.1, 0.1, 0.1])
    assert [h.elevator_force for h in later] == pytest.approx([0.7, 0.5, 0.3, 0.1, 0.1, 0.1])


def test_a_ramp_goes_on_while_the_cg_moves() -> None:
    loss = ramp(cg_shift(healthy, shift_cbar=0.02, at_tick=22), to=0.2, at_tick=20, ticks=4)
    assert [loss(k).cg_shift_cbar for k in (21, 22, 30)] == [0.0, 0.02, 0.02]
    assert [loss(k).effectiveness for k in (21, 22, 30)] == pytest.approx([0.6, 0.4, 0.2])


def test_a_flight_is_given_the_same_object_as_long_as_nothing_changes() -> None:
    """The plant writes nothing into JSBSim while it is the same, and the loop makes no value at every tick."""
    both = effectiveness_loss(cg_shift(healthy, shift_cbar=0.02, at_tick=5), to=0.2, at_tick=10)
    for first, last in ((0, 4), (5, 9), (10, 99)):
        assert all(both(k) is both(first) for k in range(first, last + 1))


# Fault that each failure sets in a healthy actuator, and the remaining share.
FAULTS: list[tuple[Callable[..., HealthHistory], dict[str, Any], Fault]] = [
    (stuck, {}, Fault(stuck=True)),
    (hardover, {"to_rad": -inf}, Fault(hardover_rad=-inf)),
    (bias, {"by_rad": 0.03}, Fault(bias_rad=0.03)),
    (rate_limited, {"to": 0.25}, Fault(rate_share=0.25)),
    (floating, {}, Fault(floats=True)),
]
SHARES = {"elevator": ("effectiveness", "elevator_force"), "aileron": ("aileron",), "rudder": ("rudder",)}


def _same(found: Fault, expected: Fault) -> bool:
    """Whether two faults are equal, with nan equal to nan (no hardover)."""
    return str(found) == str(expected)


@pytest.mark.parametrize("surface", SURFACES)
@pytest.mark.parametrize(("make", "how", "fault"), FAULTS)
@given(at=st.integers(0, 1000), tick=st.integers(0, 2000))
def test_a_fault_is_of_its_surface_alone_and_from_its_tick_on(
    make: Callable[..., HealthHistory], how: dict[str, Any], fault: Fault, surface: str, at: int, tick: int
) -> None:
    found = make(healthy, surface=surface, at_tick=at, **how)(tick)
    if tick < at:
        assert found is HEALTHY
        return
    for name, actual in zip(SURFACES, found.faults, strict=True):
        assert _same(actual, fault if name == surface else NO_FAULT), name
    shares = SHARES[surface] if make is floating else ()
    expected = HEALTHY._replace(**dict.fromkeys(shares, 0.0))
    assert found._replace(faults=HEALTHY.faults) == expected


def test_faults_and_losses_add_up_in_any_order() -> None:
    def slow(before: HealthHistory) -> HealthHistory:
        return rate_limited(before, surface="rudder", to=0.5, at_tick=10)

    def off(before: HealthHistory) -> HealthHistory:
        return bias(before, surface="rudder", by_rad=0.02, at_tick=20)

    def weak(before: HealthHistory) -> HealthHistory:
        return effectiveness_loss(before, to=0.3, at_tick=30, surface="aileron")

    def gone(before: HealthHistory) -> HealthHistory:
        return cg_shift(before, shift_cbar=0.01, at_tick=30)

    one, other = weak(gone(off(slow(healthy)))), slow(off(gone(weak(healthy))))
    for tick in (0, 9, 10, 19, 20, 29, 30, 99):
        assert str(one(tick)) == str(other(tick))
    assert one(99).faults[2]._replace(hardover_rad=0.0) == Fault(hardover_rad=0.0, bias_rad=0.02, rate_share=0.5)
    assert (one(99).aileron, one(99).rudder, one(99).effectiveness, one(99).cg_shift_cbar) == (0.3, 1.0, 1.0, 0.01)


def test_a_later_fault_of_the_same_kind_replaces_the_earlier() -> None:
    twice = bias(bias(healthy, surface="aileron", by_rad=0.05, at_tick=5), surface="aileron", by_rad=-0.01, at_tick=9)
    assert [twice(k).faults[1].bias_rad for k in (4, 5, 8, 9)] == [0.0, 0.05, 0.05, -0.01]


@pytest.mark.parametrize("surface", ["aileron", "rudder"])
def test_losses_and_ramps_are_of_their_surface_alone(surface: str) -> None:
    weak = effectiveness_loss(healthy, to=0.4, at_tick=10, surface=surface)
    assert weak(10) == HEALTHY._replace(**{surface: 0.4})
    loss = ramp(weak, to=0.2, at_tick=20, ticks=4, surface=surface)
    assert [getattr(loss(k), surface) for k in (9, 19, 20, 21, 23, 99)] == pytest.approx(
        [1.0, 0.4, 0.35, 0.3, 0.2, 0.2]
    )
    assert loss(99)._replace(**{surface: 1.0}) == HEALTHY


def test_a_flight_is_given_the_same_object_as_long_as_no_fault_changes() -> None:
    both = stuck(hardover(healthy, surface="rudder", to_rad=inf, at_tick=5), surface="aileron", at_tick=10)
    for first, last in ((0, 4), (5, 9), (10, 99)):
        assert all(both(k) is both(first) for k in range(first, last + 1))
