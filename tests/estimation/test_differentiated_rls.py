"""The baseline against batch least squares on signals that scipy filtered."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import bilinear, lfilter

from flightbed.avionics.onboard import OnBoard
from flightbed.avionics.short_period import ShortPeriod
from flightbed.core.signals import Measurement, SensorNoise
from flightbed.core.units import DEG
from flightbed.estimation.differentiated_rls import DifferentiatedRls, RlsConfig

NOISE = SensorNoise(0.03 * DEG, 0.1108 * DEG)


def _readings(design: ShortPeriod, rng: np.random.Generator, K: float, ticks: int) -> list[Measurement]:
    """An exact linear aircraft at rest at trim, then moved by a random elevator, with noise."""
    fine = 20
    step = design.discrete(100 * fine)
    x, out = np.zeros(2), []
    d = design.elevator_trim_rad / K
    for k in range(ticks):
        noise = rng.standard_normal(2) * [NOISE.alpha_rad, NOISE.q_rad_s]
        out.append(Measurement(x[0] + design.alpha_trim_rad + noise[0], x[1] + noise[1], d, d))
        if k > 20:
            d += 0.2 * (design.elevator_trim_rad / K - d) + 0.6 * DEG * float(rng.standard_normal())
        for _ in range(fine):
            x = step.A @ x + step.b * (K * d - design.elevator_trim_rad)
    return out


def test_without_forgetting_it_is_batch_least_squares(rng: np.random.Generator, design: ShortPeriod) -> None:
    config = RlsConfig(scheduled=False, forgetting=1.0, bounds=(-10.0, 10.0))
    estimator = DifferentiatedRls(config, OnBoard(design, NOISE, 100))
    readings = _readings(design, rng, 0.6, 300)
    found = [estimator.update(m) for m in readings][-1]

    w, z = config.filter_rad_s, config.filter_damping
    (low, den), (slope, _) = (bilinear(b, [1.0, 2 * z * w, w * w], fs=100.0) for b in ([w * w], [w * w, 0.0]))
    q = np.array([m.q_rad_s for m in readings])
    own = np.array(
        [
            design.A[1] @ [m.alpha_rad - design.alpha_trim_rad, m.q_rad_s] - design.b[1] * design.elevator_trim_rad
            for m in readings
        ]
    )
    control = np.array([design.b[1] * m.elevator_rad for m in readings])
    # lfilter starts from rest: take the first value off before, and put it back after, where the filter has unit gain.
    target = lfilter(slope, den, q - q[0]) - (lfilter(low, den, own - own[0]) + own[0])
    regressor = lfilter(low, den, control - control[0]) + control[0]
    impulse = lfilter(slope, den, np.eye(1, 400)[0])
    variance = float(np.sum(impulse**2)) * NOISE.q_rad_s**2
    precision = regressor @ regressor / variance + 1.0 / config.prior_effectiveness_var
    expected = (regressor @ target / variance + config.prior_effectiveness / config.prior_effectiveness_var) / precision
    assert found.effectiveness_raw == pytest.approx(expected, rel=1e-9)
    assert found.effectiveness_std == pytest.approx(precision**-0.5, rel=1e-9)


def test_it_follows_a_loss_and_forgetting_makes_it_faster(rng: np.random.Generator, design: ShortPeriod) -> None:
    healthy, failed = _readings(design, rng, 1.0, 300), _readings(design, rng, 0.3, 200)
    errors = {}
    for forgetting in (0.9, 1.0):
        estimator = DifferentiatedRls(RlsConfig(scheduled=False, forgetting=forgetting), OnBoard(design, NOISE, 100))
        assert abs([estimator.update(m) for m in healthy][-1].effectiveness - 1.0) < 0.1
        errors[forgetting] = abs([estimator.update(m) for m in failed][-1].effectiveness - 0.3)
    assert errors[0.9] < 0.06
    assert errors[0.9] < errors[1.0]


def test_a_schedule_that_is_not_there_is_refused(design: ShortPeriod) -> None:
    with pytest.raises(ValueError, match="none on board"):
        DifferentiatedRls(RlsConfig(), OnBoard(design, NOISE, 100))
