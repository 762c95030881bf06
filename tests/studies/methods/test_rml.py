"""Recursive maximum likelihood: least squares without C, a batch prediction-error fit with it, and C kept stable."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.signal import lfilter

from flightbed.studies.kemp import plants
from flightbed.studies.kemp.methods import estimates
from flightbed.studies.kemp.plants import Record
from flightbed.studies.methods import rml
from flightbed.studies.methods.rml import Rml, RmlConfig, drawn_back, within


def _armax(a: list[float], b: list[float], c: list[float], std: float, samples: int, seed: int) -> Record:
    """A record of A y = B u + C e; theta in the observable-canonical form."""
    rng = np.random.default_rng(seed)
    u, e = rng.standard_normal(samples), std * rng.standard_normal(samples)
    y = lfilter([0.0, *b], [1.0, *a], u) + lfilter([1.0, *c], [1.0, *a], e)
    theta = np.array([*(-np.array(a))[::-1], *b[::-1]])
    return Record(np.tile(theta, (samples, 1)), u, y)


@pytest.mark.parametrize("forgetting", [1.0, 0.97])
def test_without_c_it_is_least_squares_over_the_whole_record(forgetting: float) -> None:
    record = plants.record("C", 0.02, 0.03, 120, 0)
    found = Rml(RmlConfig(3, 50.0, 0.0, forgetting))
    estimates(found, record)
    y, u = np.r_[np.zeros(3), record.y], np.r_[np.zeros(3), record.u]
    H = np.array([[*y[k : k + 3], *u[k : k + 3]] for k in range(1, 120)])  # oldest first: a_0 .., b_0 ..
    weight = forgetting ** np.arange(118, -1, -1.0)
    prior = forgetting**119 / 50.0 * np.eye(6)
    wanted = np.linalg.solve(H.T @ (weight[:, None] * H) + prior, H.T @ (weight * record.y[1:]))
    assert found.parameters == pytest.approx(wanted, abs=1e-9)
    assert np.all(found.noise_parameters == 0.0)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_it_agrees_with_a_batch_prediction_error_fit(seed: int) -> None:
    """A long record of a second-order ARMAX model, fitted by scipy to the same one-step errors: apart by a part of its deviation.

    From a cautious prior: from 200 the first samples throw the estimate so far off that 20,000 do not wash it out to this accuracy.
    """
    record = _armax([-1.5, 0.7], [1.0, 0.5], [0.6, 0.2], 0.5, 20000, seed)
    found = Rml(RmlConfig(2, 1.0, 1.0, root_limit=0.99))
    estimates(found, record)

    def errors(theta: np.ndarray) -> np.ndarray:
        a, b, c = theta[:2], theta[2:4], theta[4:]
        return lfilter([1.0, *a], [1.0, *c], record.y) - lfilter([0.0, *b], [1.0, *c], record.u)

    fit = least_squares(errors, np.zeros(6))
    deviation = np.sqrt(np.diag(np.linalg.inv(fit.jac.T @ fit.jac)) * 2.0 * fit.cost / 20000)
    a, b = fit.x[:2], fit.x[2:4]
    order = [1, 0, 3, 2, 4, 5]
    batch = np.array([*(-a)[::-1], *b[::-1], *fit.x[4:]])
    ours = np.concatenate([found.parameters, found.noise_parameters])
    assert np.all(np.abs(ours - batch) < 0.3 * deviation[order])
    assert np.all(np.abs(batch - [-0.7, 1.5, 0.5, 1.0, 0.6, 0.2]) < 4.0 * deviation[order])
    # Its covariance agrees with that of the batch fit, in units of the errors' variance.
    own = np.sqrt(np.diag(found.covariance) * 0.5**2)
    assert own == pytest.approx(deviation, rel=0.1)


@pytest.mark.parametrize("order", [1, 2, 3, 5])
def test_the_stability_test_agrees_with_the_roots(order: int, rng: np.random.Generator) -> None:
    sides = set()
    for _ in range(300):
        c = rng.uniform(-1.0, 1.0, order) * rng.uniform(0.2, 2.5)
        largest, radius = np.max(np.abs(np.roots([1.0, *c]))), rng.uniform(0.5, 1.0)
        assert within(c, radius) == (largest < radius)
        sides.add(largest < radius)
    assert sides == {True, False}


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_only_roots_beyond_the_limit_are_drawn_back(order: int, rng: np.random.Generator) -> None:
    for _ in range(50):
        c = rng.uniform(-2.0, 2.0, order)
        before, after = (np.sort_complex(np.roots([1.0, *x])) for x in (c, drawn_back(c, 0.9)))
        wanted = np.sort_complex(before / np.maximum(np.abs(before) / 0.9, 1.0))
        assert np.sort(np.abs(after)) == pytest.approx(np.sort(np.abs(wanted)), abs=1e-7)
        assert np.max(np.abs(after)) < 0.9 + 1e-7


def test_for_order_2_it_is_the_listings_trap() -> None:
    for c1, c2 in ((2.5, 1.2), (0.3, 1.7), (-1.9, 0.5), (-0.2, -1.5)):
        roots = np.roots([1.0, c1, c2]).astype(complex)
        trapped = np.where(np.abs(roots) > 1.0, roots / np.abs(roots), roots)
        wanted = [-np.sum(trapped).real, np.prod(trapped).real]
        assert drawn_back(np.array([c1, c2]), 1.0) == pytest.approx(wanted)


def test_c_stays_within_the_limit_in_flight() -> None:
    limited, free = Rml(RmlConfig(3, root_limit=0.9)), Rml(RmlConfig(3))
    record = plants.record("A", 0.0, 0.1, 300, 3)
    u_before = 0.0
    for y, u in zip(record.y.tolist(), record.u.tolist(), strict=True):
        for identifier, limit in ((limited, 0.9), (free, 1.0)):
            identifier.update(y, u_before)
            assert np.max(np.abs(np.roots([1.0, *identifier.noise_parameters]))) < limit + 1e-6
        u_before = u
    assert limited.projections > 0


def test_the_residual_is_that_of_the_refined_estimate() -> None:
    """Epsilon refinement: the regressor's newest residual is y - x theta with the theta that y has corrected."""
    record, identifier = plants.record("C", 0.01, 0.01, 12, 0), Rml(RmlConfig(2))
    u_before = 0.0
    for k, (y, u) in enumerate(zip(record.y.tolist(), record.u.tolist(), strict=True)):
        identifier.update(y, u_before)
        if k > 0:
            assert identifier._residual == pytest.approx(y - identifier._x @ identifier._theta, abs=1e-12)
            assert abs(identifier._residual) < abs(identifier.innovation)
        u_before = u


def test_compiled_and_plain_agree() -> None:
    record = plants.record("C", 0.02, 0.01, 40, 1)
    results = []
    for function in (rml.step, rml.step.py_func):  # type: ignore[attr-defined]
        theta, P, x, phi = np.zeros(9), np.diag([200.0] * 6 + [10.0] * 3), np.zeros(9), np.zeros(9)
        for k in range(1, 40):
            y, u = float(record.y[k - 1]), float(record.u[k - 1])
            returned = function(theta, P, x, phi, 0.99, 1.0, 0.1 * k, y, u, float(record.y[k]))
        results.append((theta, P, x, phi, returned))
    for ours, theirs in zip(*results, strict=True):
        assert ours == pytest.approx(theirs, rel=1e-9, abs=1e-11)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"order": 0}, "order must be at least 1"),
        ({"order": 2, "forgetting": 0.0}, "above 0 and at most 1"),
        ({"order": 2, "root_limit": 1.5}, "above 0 and at most 1"),
        ({"order": 2, "prior_var": -1.0}, "must not be negative"),
    ],
)
def test_settings_that_make_no_sense_are_refused(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        RmlConfig(**settings)


def test_an_overflowed_estimate_is_not_finite() -> None:
    identifier = Rml(RmlConfig(3))
    found = estimates(identifier, plants.record("B", 0.0, 0.01, 1800, 0))
    assert np.all(np.isfinite(found[:60]))
    assert not np.all(np.isfinite(found[-1]))
