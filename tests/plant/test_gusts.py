"""Gusts: the shape of the standard, symmetry, superposition; calm air before and after."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flightbed.plant.gusts import calm, one_minus_cosine, sine


@given(at=st.floats(0, 20), up=st.floats(-50, 50), rise=st.floats(0.01, 5), hold=st.floats(0, 5))
def test_calm_outside_the_peak_between_and_never_beyond_it(at: float, up: float, rise: float, hold: float) -> None:
    gust = one_minus_cosine(calm, at_s=at, up_m_s=up, rise_s=rise, hold_s=hold)
    end = at + 2.0 * rise + hold
    assert [gust(t) for t in (0.0, at, end + 1e-9, end + 9.0)] == pytest.approx([0.0] * 4, abs=1e-12)
    # Round-off of the times moves the edge of the hold by 1e-15 s: nothing, where the slope is 0.
    assert [gust(at + rise + share * hold) for share in (0.0, 0.5, 1.0)] == pytest.approx([up] * 3)
    inside = np.array([gust(t) for t in np.linspace(at, end, 50)]) * np.sign(up)
    assert np.all((inside >= 0.0) & (inside <= abs(up)))
    assert gust(at + rise / 3.0) == pytest.approx(gust(end - rise / 3.0), abs=1e-9)


@given(x=st.floats(0, 1))
def test_the_rise_is_the_discrete_gust_of_the_standard(x: float) -> None:
    """MIL-F-8785C, 3.7.1.3, with x the share of the gust's length."""
    gust = one_minus_cosine(calm, at_s=2.0, up_m_s=-8.0, rise_s=0.5, hold_s=1.0)
    assert gust(2.0 + 0.5 * x) == pytest.approx(-8.0 / 2.0 * (1.0 - np.cos(np.pi * x)), abs=1e-12)


def test_gusts_add_up() -> None:
    one = one_minus_cosine(calm, at_s=1.0, up_m_s=3.0, rise_s=0.5, hold_s=2.0)
    two = one_minus_cosine(one, at_s=2.0, up_m_s=-5.0, rise_s=0.25, hold_s=0.0)
    assert [two(t) for t in (0.9, 1.5, 2.0, 2.25, 2.5, 3.5, 4.1)] == pytest.approx([0, 3, 3, -2, 3, 3, 0])


@given(at=st.floats(0, 20), up=st.floats(-50, 50), hz=st.floats(0.05, 5), turn=st.floats(0, 30))
def test_a_harmonic_gust_begins_with_a_rise_and_goes_on(at: float, up: float, hz: float, turn: float) -> None:
    gust = sine(calm, at_s=at, up_m_s=up, frequency_hz=hz)
    assert [gust(0.0), gust(at)] == [0.0, 0.0]
    assert gust(at + turn / hz) == pytest.approx(up * np.sin(2.0 * np.pi * turn), abs=1e-9)
    assert gust(at + 0.01 / hz) * up >= 0.0
    assert sine(gust, at_s=at, up_m_s=-up, frequency_hz=hz)(at + turn) == pytest.approx(0.0, abs=1e-12)
