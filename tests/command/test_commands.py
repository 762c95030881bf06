"""Commands and the prefilter."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import cont2discrete, dlsim

from flightbed.command.base import profile
from flightbed.command.constant import constant, none
from flightbed.command.doublet import doublet

T = np.arange(1650) / 100


def test_doublets_switch_on_the_tick() -> None:
    """3 doublets of period 4.5 s at 100 Hz: up at 0, down at tick 225, up again at 450, off at 1350."""
    q = doublet(amplitude_rad_s=2.0, period_s=4.5, count=3)(T)
    changes = np.flatnonzero(np.diff(q)) + 1
    assert changes.tolist() == [225, 450, 675, 900, 1125, 1350]
    assert (q[0], q[225], q[450], q[1350]) == (2.0, -2.0, 2.0, 0.0)
    assert q.sum() == 0.0


def test_start_time_and_constant_and_none() -> None:
    late = doublet(amplitude_rad_s=1.0, period_s=1.0, count=1, start_s=2.0)(T)
    assert np.flatnonzero(late)[[0, -1]].tolist() == [200, 299]
    held = constant(amplitude_rad_s=0.3, start_s=1.0)(T)
    assert np.flatnonzero(held)[0] == 100
    assert held[-1] == 0.3
    assert not none()(T).any()


def test_prefilter_equals_scipys_zero_order_hold() -> None:
    command = doublet(amplitude_rad_s=0.1, period_s=4.5, count=3)
    ours = profile(command, ticks=1650, control_hz=100, filter_rad_s=3.0)
    system = cont2discrete((np.array([[-3.0]]), np.array([[3.0]]), np.array([[1.0]]), np.array([[0.0]])), 0.01)
    _, theirs, _ = dlsim(system, ours.q_cmd_rad_s[:, None])
    np.testing.assert_allclose(ours.q_ref_rad_s, theirs[:, 0], atol=1e-13)
    assert ours.q_ref_rad_s[0] == 0.0


def test_no_prefilter_passes_the_command() -> None:
    ours = profile(constant(amplitude_rad_s=0.2), ticks=10, control_hz=100, filter_rad_s=0.0)
    assert ours.q_ref_rad_s == pytest.approx(ours.q_cmd_rad_s)
