"""The chirp against scipy's, with repeated sweeps and at its end."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import chirp as scipys

from flightbed.command.chirp import chirp

T = np.arange(3000) / 100


def test_one_sweep_equals_scipys() -> None:
    ours = chirp(amplitude_rad_s=0.3, low_hz=0.2, high_hz=2.0, period_s=20.0, count=1, start_s=1.0)(
        T
    )  # 22 whole cycles
    assert not ours[:101].any()
    np.testing.assert_allclose(ours[100:2100], 0.3 * scipys(T[:2000], 0.2, 20.0, 2.0, phi=-90), atol=1e-12)
    assert not ours[2100:].any()


@pytest.mark.parametrize(("low_hz", "high_hz", "period_s", "count"), [(0.2, 2.0, 4.5, 3), (0.13, 1.71, 3.3, 4), (0.0, 1.0, 5.1, 1), (0.7, 0.7, 2.3, 2)])  # fmt: skip
def test_no_jump_anywhere_and_zero_at_both_ends(low_hz: float, high_hz: float, period_s: float, count: int) -> None:
    """No step of the finely sampled command exceeds the steepest slope, 2 pi high_hz; sweeps of 4.95 or 3.036 cycles do not end at zero."""
    fine = np.arange(0.0, count * period_s + 1.0, 1e-4)
    q = chirp(amplitude_rad_s=1.0, low_hz=low_hz, high_hz=high_hz, period_s=period_s, count=count)(fine)
    assert q[0] == 0.0
    assert np.max(np.abs(np.diff(q))) <= 2 * np.pi * high_hz * 1e-4
    assert np.max(np.abs(q)) == pytest.approx(1.0, abs=1e-6)
    last = fine[np.flatnonzero(q)[-1]]
    assert (
        count * period_s - 0.5 / high_hz - 0.01 <= last <= count * period_s
    )  # at most the last half cycle is left out


def test_each_sweep_begins_at_the_low_frequency_again() -> None:
    """Zero crossings count half cycles: 4.95 cycles a sweep, of which the first half holds 0.2 to 1.1 Hz, 1.4625 cycles."""
    fine = np.arange(0.0, 9.0, 1e-4)
    q = chirp(amplitude_rad_s=1.0, low_hz=0.2, high_hz=2.0, period_s=4.5, count=2)(fine)
    crossings = fine[np.flatnonzero(np.diff(np.sign(q)))]
    before = [int(np.sum((crossings > 1e-3) & (crossings < t))) for t in (2.25, 4.5, 6.75)]
    assert before == [2, 9, 12]  # floor of twice 1.4625, 4.95, 4.95 + 1.4625


def test_count_zero_flies_nothing() -> None:
    assert not chirp(amplitude_rad_s=1.0, low_hz=0.2, high_hz=2.0, period_s=4.5, count=0)(T).any()
