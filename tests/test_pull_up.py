"""How a pull-up went, of records made by hand."""

from __future__ import annotations

import numpy as np
import pytest

from flightbed.pull_up import high_passed, pull_up

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
def test_overshoot_undershoot_and_what_was_before(sign: float) -> None:
    command, answer = _pulse(sign)
    found = pull_up(_columns(answer, command), control_hz=HZ, ticks=1000)
    assert found.overshoot == pytest.approx(0.15)
    assert found.undershoot == pytest.approx(0.05)
    assert found.disturbance_g == pytest.approx(0.05)
    assert found.tracking_rms_g == pytest.approx(np.sqrt((0.3**2 + 0.1**2) / 500))
    assert not found.lost


def test_a_flight_is_lost_that_ends_early_goes_wild_or_does_not_follow() -> None:
    command, answer = _pulse()
    assert pull_up(_columns(answer[:900], command[:900]), control_hz=HZ, ticks=1000).lost
    assert pull_up(_columns(answer[:200], command[:200]), control_hz=HZ, ticks=1000).lost
    assert pull_up(_columns(np.where(np.arange(1000) == 900, 8.1, answer), command), control_hz=HZ, ticks=1000).lost
    assert pull_up(_columns(0.4 * answer, command), control_hz=HZ, ticks=1000).lost
    with pytest.raises(ValueError, match="no pull-up"):
        pull_up(_columns(answer, np.zeros(1000)), control_hz=HZ, ticks=1000)


def test_flutter_is_what_lies_above_five_hertz_away_from_the_edges() -> None:
    t = np.linspace(0.0, 10.0, 1000)  # both ends at zero
    command, answer = _pulse()
    slow, fast = 5.0 * np.sin(2 * np.pi * t), 0.7 * np.sin(2 * np.pi * 10.0 * t)
    edges = np.where((np.arange(1000) >= 300) & (np.arange(1000) < 320), 3.0 * np.cos(2 * np.pi * 20.0 * t), 0.0)
    whole = np.arange(1000) / HZ  # ten whole seconds hold whole periods of both
    assert high_passed(np.sin(2 * np.pi * whole), control_hz=HZ)[50:-50] == pytest.approx(0.0, abs=0.05)
    assert high_passed(fast, control_hz=HZ)[50:-50] == pytest.approx(fast[50:-50], abs=0.05)
    found = pull_up(_columns(answer, command, slow + fast), control_hz=HZ, ticks=1000)
    assert found.flutter_deg == pytest.approx(0.7 / np.sqrt(2.0), rel=0.02)
    assert pull_up(_columns(answer, command, slow + edges), control_hz=HZ, ticks=1000).flutter_deg < 0.3
