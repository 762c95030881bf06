"""Commands and the prefilter."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import cont2discrete, dlsim

from flightbed.command.base import energy, profile, relative_peak_factor
from flightbed.command.constant import constant, none
from flightbed.command.doublet import doublet
from flightbed.command.random import inverse_repeat, prbs
from flightbed.command.three_two_one_one import three_two_one_one

T = np.arange(1650) / 100


def test_doublets_switch_on_the_tick() -> None:
    """3 doublets of period 4.5 s at 100 Hz: up at 0, down at tick 225, up again at 450, off at 1350."""
    q = doublet(amplitude_rad_s=2.0, period_s=4.5, count=3)(T)
    changes = np.flatnonzero(np.diff(q)) + 1
    assert changes.tolist() == [225, 450, 675, 900, 1125, 1350]
    assert (q[0], q[225], q[450], q[1350]) == (2.0, -2.0, 2.0, 0.0)
    assert q.sum() == 0.0


def test_3_2_1_1_switches_on_the_tick_and_leaves_a_seventh() -> None:
    """Two sequences of 7 units of 0.3 s from 1 s on: 3 up, 2 down, 1 up, 1 down; 0.3 is no binary fraction."""
    q = three_two_one_one(amplitude_rad_s=2.0, period_s=2.1, count=2, start_s=1.0)(T)
    edges = [100, 190, 250, 280, 310, 400, 460, 490, 520]
    assert (np.flatnonzero(np.diff(q)) + 1).tolist() == edges
    assert q[edges].tolist() == [2.0, -2.0, 2.0, -2.0, 2.0, -2.0, 2.0, -2.0, 0.0]
    assert q.sum() / 100 == pytest.approx(2 * 2.0 * 2.1 / 7)  # pitch attitude commanded by two sequences, rad


@pytest.mark.parametrize("bits", [2, 4, 7, 12])
def test_inverse_repeat_has_no_mean_and_level_odd_lines(bits: int) -> None:
    """By |M|^2 = L + 1 of a maximum-length sequence: |U|^2 = 4 (L + 1) on odd lines, 4 on line L, nothing on even ones."""
    signs, length = inverse_repeat(bits), 2**bits - 1
    assert set(signs) == {-1.0, 1.0}
    assert len(signs) == 2 * length
    assert signs.sum() == 0.0
    assert signs[length:].tolist() == (-signs[:length]).tolist()
    power = np.abs(np.fft.fft(signs)) ** 2
    expected = np.where(np.arange(2 * length) % 2, 4.0 * (length + 1), 0.0)
    expected[length] = 4.0
    np.testing.assert_allclose(power, expected, atol=1e-7)


def test_random_switches_on_the_tick_and_every_seed_is_another() -> None:
    flown = [
        prbs(amplitude_rad_s=0.1, switch_s=0.3, register_bits=4, seed=seed, count=1, start_s=1.0)(T)
        for seed in range(31)
    ]
    for q in flown:
        assert not q[:100].any()
        assert not q[1000:].any()  # 30 bits of 0.3 s
        assert set(np.abs(q[100:1000])) == {0.1}
        assert set((np.flatnonzero(np.diff(q[100:1000])) + 1) % 30) == {0}
        assert abs(q.sum()) < 1e-12
    assert len({q.tobytes() for q in flown[:30]}) == 30
    assert flown[30].tobytes() == flown[0].tobytes()  # seeds count modulo 2 (2^4 - 1)


def test_energy_and_peak_factor_of_known_signals() -> None:
    q = doublet(amplitude_rad_s=0.1, period_s=4.5, count=3)(T)
    assert energy(q, control_hz=100) == pytest.approx(0.1**2 * 13.5)
    assert relative_peak_factor(q[:1350]) == pytest.approx(1 / np.sqrt(2))
    sine = 3.0 * np.sin(2 * np.pi * np.arange(400) / 100)
    assert energy(sine, control_hz=100) == pytest.approx(3.0**2 * 4.0 / 2)
    assert relative_peak_factor(sine) == pytest.approx(1.0)
    for silent in (np.zeros(5), np.zeros(0)):
        with pytest.raises(ValueError, match="empty or zero throughout"):
            relative_peak_factor(silent)


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
