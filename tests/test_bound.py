"""The Cramer-Rao bound against a batch least-squares covariance that is computed another way."""

from __future__ import annotations

import numpy as np

from flightbed import load_scenario, run
from flightbed.assembly import sensor_noise
from flightbed.bound import _bounds, bound, schedule_models


def test_against_the_covariance_of_batch_least_squares(rng: np.random.Generator) -> None:
    """Sensitivities by differences of whole simulated records, covariance by numpy's pseudo-inverse."""
    T, r = 40, np.array([2.7e-7, 3.7e-6])
    models = np.zeros((T, 2, 4))
    for model in models:
        model[:, :2] = [[0.99, 0.0095], [0.02 + 0.01 * rng.standard_normal(), 0.99]]
        model[:, 2] = [5e-4, -0.14]
    u = 0.05 * rng.standard_normal(T) + 0.03

    def record(p: np.ndarray, first: int, last: int) -> np.ndarray:
        x, out = p[:2].copy(), [p[:2].copy()]
        for j in range(first + 1, last + 1):
            x = models[j, :, :2] @ x + models[j, :, 2] * u[j] * p[2] + models[j, :, 3]
            out.append(x.copy())
        return (np.array(out) / np.sqrt(r)).ravel()

    first = np.maximum(0, np.arange(T) - 20).astype(float)
    found = _bounds(models, u, first, r)
    p = np.array([0.01, 0.02, 0.6])
    for k in (3, 10, 25, 39):
        H = np.column_stack(
            [(record(p + h, int(first[k]), k) - record(p - h, int(first[k]), k)) / 2 for h in np.eye(3)]
        )
        expected = np.sqrt(np.linalg.pinv(H.T @ H)[2, 2])
        assert abs(found[k] / expected - 1.0) < 1e-6, k
    assert np.isinf(found[0])


def test_more_data_say_more_and_a_change_begins_anew() -> None:
    result = run(load_scenario("elevator-loss", ["duration_s=8"]))
    assert result.plan.schedule is not None
    noise = sensor_noise(result.plan.scenario)
    models = schedule_models(result.trace, result.plan.schedule, control_hz=100)
    everything = bound(result.trace, models, noise)
    window = bound(result.trace, models, noise, window=30)
    assert np.all(everything <= window * (1 + 1e-9))
    assert np.all(np.diff(everything[455:]) <= 1e-12)
    assert np.isinf(everything[450]) or everything[450] < everything[451]  # at the change the old stretch still counts
    assert everything[452] > 10 * everything[450]
    assert np.array_equal(result.trace["effectiveness_bound"], window)
