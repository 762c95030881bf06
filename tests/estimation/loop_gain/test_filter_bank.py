"""The kernels of a window against the general filter: bit-identical."""

from __future__ import annotations

import numpy as np
import pytest

from flightbed.estimation.loop_gain import filter_bank
from flightbed.studies.methods import joint

BEGIN = {"fixed": filter_bank.FIXED, "anchored": filter_bank.ANCHORED, "corrected": filter_bank.CORRECTED}


def _bank(rng: np.random.Generator, filters: int) -> np.ndarray:
    bank = filter_bank.new_bank(filters)
    root = 0.1 * rng.standard_normal((filters, 3, 3))
    bank[0:3] = 0.1 * rng.standard_normal((3, filters))
    # Products summed in another order are not symmetric to the last bit, as the filters' covariances are.
    covariance = np.einsum("wij,wkj->ikw", root, root)
    bank[3:12] = (0.5 * (covariance + covariance.transpose(1, 0, 2))).reshape(9, filters)
    return bank


@pytest.mark.parametrize("filters", [1, 2, 30])
@pytest.mark.parametrize("inflation", [1.0, 1.0 / 0.97])
def test_a_step_is_a_prediction_and_a_correction(rng: np.random.Generator, filters: int, inflation: float) -> None:
    for _ in range(20):
        ours = _bank(rng, filters)
        theirs = ours.copy()
        model, u = rng.standard_normal((2, 4)), float(rng.standard_normal())
        q, r, z = np.diag(rng.uniform(1e-5, 1e-3, 2)), rng.uniform(1e-5, 1e-3, 2), rng.standard_normal(2)
        q[0, 1] = q[1, 0] = 1e-6
        X, P, T = theirs[0:3], theirs[3:12].reshape((3, 3, -1)), np.zeros((4, 3, filters))
        joint.predict(X, P, T, model, u, q, inflation)
        innovations = [z[0] - X[0], z[1] - X[1], P[0, 0] + r[0], P[1, 1] + r[1]]
        joint.correct(X, P, T, np.eye(2), r, (float(z[0]), float(z[1])))
        filter_bank.step(ours, model, u, q[0, 0], q[0, 1], q[1, 1], inflation, r[0], r[1], float(z[0]), float(z[1]))
        np.testing.assert_array_equal(ours[:12], theirs[:12])
        np.testing.assert_array_equal(ours[21], T[3, 0])
        np.testing.assert_array_equal(ours[43:47], innovations)


@pytest.mark.parametrize("begin", BEGIN)
def test_a_filter_starts_from_its_prior(rng: np.random.Generator, begin: str) -> None:
    x0, r, z = rng.standard_normal(3), rng.uniform(1e-4, 1e-2, 2), rng.standard_normal(2)
    root = rng.standard_normal((3, 3))
    P0 = 0.5 * (root @ root.T + (root @ root.T).T)
    settings = filter_bank.pack_settings(
        Q=np.zeros((2, 2)), x0=x0, P0=P0, inflation=1.0, begin=BEGIN[begin], keep=0.9, bounds=(0.0, 1.0), r=r, model=np.zeros((2, 4))
    )  # fmt: skip
    bank = filter_bank.new_bank(3)
    filter_bank.start(bank, settings, 1, float(z[0]), float(z[1]))
    X, P = x0[:, None].copy(), P0[:, :, None].copy()
    if begin == "anchored":
        X[:2, 0] = z
        P[:2], P[:, :2] = 0.0, 0.0
        P[0, 0], P[1, 1] = r[0], r[1]
    elif begin == "corrected":
        joint.correct(X, P, np.zeros((4, 3, 1)), np.eye(2), r, (float(z[0]), float(z[1])))
    np.testing.assert_array_equal(bank[0:3, 1], X[:, 0])
    np.testing.assert_array_equal(bank[3:12, 1].reshape(3, 3), P[:, :, 0])
    np.testing.assert_array_equal(bank[:, [0, 2]], 0.0)  # the other filters are unchanged
