"""Failures of the airframe compose with those of the elevator, in either order."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from flightbed.core.signals import HEALTHY, Health
from flightbed.failures.base import healthy
from flightbed.failures.cg_shift import cg_shift
from flightbed.failures.surface import effectiveness_loss


@given(at=st.integers(0, 1000), shift=st.floats(-0.5, 0.5), tick=st.integers(0, 2000))
def test_identity_before_and_constant_after(at: int, shift: float, tick: int) -> None:
    expected = Health(cg_shift_cbar=shift) if tick >= at else HEALTHY
    assert cg_shift(healthy, shift_cbar=shift, at_tick=at)(tick) == expected


@given(elevator=st.integers(0, 100), cg=st.integers(0, 100), tick=st.integers(0, 200))
def test_elevator_and_cg_do_not_replace_each_other(elevator: int, cg: int, tick: int) -> None:
    one = cg_shift(effectiveness_loss(healthy, to=0.3, at_tick=elevator), shift_cbar=0.04, at_tick=cg)
    other = effectiveness_loss(cg_shift(healthy, shift_cbar=0.04, at_tick=cg), to=0.3, at_tick=elevator)
    K = 0.3 if tick >= elevator else 1.0
    assert one(tick) == other(tick) == Health(K, K, 0.04 if tick >= cg else 0.0)


def test_a_second_shift_counts_from_take_off_too() -> None:
    two = cg_shift(cg_shift(healthy, shift_cbar=0.02, at_tick=10), shift_cbar=-0.01, at_tick=20)
    assert [two(k).cg_shift_cbar for k in (9, 10, 19, 20)] == [0.0, 0.02, 0.02, -0.01]
