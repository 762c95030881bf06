"""Metrics of pull-ups on hand-made records."""

from __future__ import annotations

import numpy as np
import pytest

from flightbed.analysis.pull_up import first_pulse, high_passed, pull_up

HZ = 100


def _columns(answer: np.ndarray, command: np.ndarray, elevator: np.ndarray | None = None) -> dict[str, np.ndarray]:
    n = len(answer)
    theta, phi = np.linspace(0.0, 20.0, n), np.full(n, 3.0)
    level = np.cos(np.radians(theta)) * np.cos(np.radians(phi))
    noisy = theta + 0.05
    measured = np.cos(np.radians(noisy)) * np.cos(np.radians(phi))
    return {
        "t_s": np.arange(n) / HZ, "nz_g": answer + level, "theta_deg": theta, "phi_deg": phi, "nz_cmd_g": command + measured,
        "theta_meas_deg": noisy, "phi_meas_deg": phi, "elevator_cmd_deg": np.zeros(n) if elevator is None else elevator,
    }  # fmt: skip


def _pulse(sign: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    command, answer = np.zeros(1000), np.zeros(1000)
    command[300:500], answer[300:500] = 2.0 * sign, 2.0 * sign
    answer[350], answer[520], answer[250] = 2.3 * sign, -0.1 * sign, 0.05
    return command, answer


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_overshoot_undershoot_and_disturbance(sign: float) -> None:
    command, answer = _pulse(sign)
    found = pull_up(_columns(answer, command), control_hz=HZ, ticks=1000)
    assert found.overshoot == pytest.approx(0.15)
    assert found.undershoot == pytest.approx(0.05)
    assert found.disturbance_g == pytest.approx(0.05)
    assert found.tracking_rms_g == pytest.approx(np.sqrt((0.3**2 + 0.1**2) / 500))
    assert not found.lost


def test_an_early_end_a_large_increment_and_a_missed_command_count_as_lost() -> None:
    command, answer = _pulse()
    assert pull_up(_columns(answer[:900], command[:900]), control_hz=HZ, ticks=1000).lost
    assert pull_up(_columns(answer[:200], command[:200]), control_hz=HZ, ticks=1000).lost
    assert pull_up(_columns(np.where(np.arange(1000) == 900, 8.1, answer), command), control_hz=HZ, ticks=1000).lost
    assert pull_up(_columns(0.4 * answer, command), control_hz=HZ, ticks=1000).lost
    with pytest.raises(ValueError, match="no pull-up"):
        pull_up(_columns(answer, np.zeros(1000)), control_hz=HZ, ticks=1000)


def test_only_a_held_and_released_command_is_a_pulse() -> None:
    command, answer = _pulse()
    assert first_pulse(command, control_hz=HZ) == (300, 500, 2.0)
    assert first_pulse(command[:450], control_hz=HZ) == (300, 450, 2.0)  # up to the end of the record
    doublet = command.copy()
    doublet[500:700] = -2.0
    for none in (doublet, command[:340], np.zeros(1000), np.sin(np.arange(1000) / 50.0)):
        assert first_pulse(none, control_hz=HZ) is None
    twice = command.copy()
    twice[600:800] = -2.0  # a second command, no undershoot of the first
    found = pull_up(_columns(np.where(np.arange(1000) < 600, answer, twice), twice), control_hz=HZ, ticks=1000)
    assert found.undershoot == pytest.approx(0.05)


def _flutter(elevator: np.ndarray) -> float:
    command, answer = _pulse()
    return pull_up(_columns(answer, command, elevator), control_hz=HZ, ticks=1000).flutter_deg


def test_flutter_is_the_motion_above_five_hertz_away_from_the_edges() -> None:
    t = np.arange(1000) / HZ
    slow, fast = 5.0 * np.sin(2 * np.pi * t), 0.7 * np.sin(2 * np.pi * 10.0 * t)
    assert high_passed(np.sin(2 * np.pi * t), control_hz=HZ)[50:-50] == pytest.approx(0.0, abs=0.01)
    assert high_passed(fast, control_hz=HZ)[50:-50] == pytest.approx(fast[50:-50], abs=0.02)
    assert _flutter(slow + fast) == pytest.approx(0.7 / np.sqrt(2.0), rel=0.03)
    before = np.where(t < 3.0, 3.0 * np.cos(2 * np.pi * 20.0 * t), 0.0)  # identification before the pulse
    assert _flutter(before) < 1e-9


def test_steps_of_the_elevator_at_the_edges_are_no_flutter() -> None:
    """The elevator of a law at a step command: a jump of 8 deg that decays with the loop's slow poles."""
    t = np.arange(1000) / HZ
    jumps = sum(
        np.where(t >= at, size * np.exp(-4.0 * (t - at)) * np.cos(2.0 * (t - at)), 0.0)
        for at, size in ((3.0, -8.0), (5.0, 8.0))
    )
    assert _flutter(np.asarray(jumps)) < 0.02
    assert _flutter(np.where(t >= 3.0, 8.0, 0.0)) < 1e-6


def test_a_low_control_rate_has_no_flutter_metric() -> None:
    command, answer = np.zeros(100), np.zeros(100)
    command[30:50] = answer[30:50] = 1.0
    assert np.isnan(pull_up(_columns(answer, command), control_hz=10, ticks=100).flutter_deg)
