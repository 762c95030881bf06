"""Sensors: noise of the stated standard deviation, from independent streams."""

from __future__ import annotations

import numpy as np
import pytest

from flightbed.core.signals import SensorNoise, Truth
from flightbed.plant.sensors import Sensors

TRUTH = Truth(*(0.01 * (i + 1) for i in range(len(Truth._fields))))


def _errors(noise: SensorNoise, seed: int = 1, ticks: int = 20000) -> np.ndarray:
    sensors = Sensors(noise, ticks=ticks, seed=np.random.SeedSequence(seed))
    readings = np.array([sensors.read(k, TRUTH) for k in range(ticks)])
    return readings[:, :4] - [TRUTH.alpha_rad, TRUTH.q_rad_s, TRUTH.elevator_rad, TRUTH.elevator_mean_rad]


def test_noise_is_white_unbiased_and_as_strong_as_stated() -> None:
    errors = _errors(SensorNoise(0.002, 0.003, 0.001))
    n = len(errors)
    for column, std in zip(errors.T, (0.002, 0.003, 0.001, 0.001), strict=True):
        assert abs(column.mean()) < 4 * std / np.sqrt(n)
        assert column.std() == pytest.approx(std, rel=4 / np.sqrt(2 * n))
        assert abs(np.corrcoef(column[1:], column[:-1])[0, 1]) < 4 / np.sqrt(n)
    assert abs(np.corrcoef(errors[:, 0], errors[:, 1])[0, 1]) < 4 / np.sqrt(n)


def test_a_further_sensor_leaves_the_others_as_they_are() -> None:
    without, with_ = _errors(SensorNoise(0.002, 0.003)), _errors(SensorNoise(0.002, 0.003, 0.001))
    assert np.array_equal(without[:, :2], with_[:, :2])
    assert not without[:, 2:].any()
    assert not np.array_equal(without, _errors(SensorNoise(0.002, 0.003), seed=2))
