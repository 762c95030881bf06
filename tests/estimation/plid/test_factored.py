"""The factored form: equal to the plain one, to the thesis's block fade written out, and alone in single precision."""

from __future__ import annotations

import numpy as np
import pytest

from flightbed.estimation.plid import factored as udu
from flightbed.estimation.plid.identify import Plid, PlidConfig, Tracking
from flightbed.studies.kemp import plants
from flightbed.studies.kemp.methods import estimates


@pytest.mark.parametrize("plant", ["A", "C", "E", "E stepped", "F"])
@pytest.mark.parametrize("fade", [1.0, 1.001, 1.05])
def test_it_equals_the_plain_form_while_well_conditioned(plant: str, fade: float) -> None:
    record = plants.record(plant, 0.005, 0.01, 400 if plant in "ACF" else 201, 2)
    config = PlidConfig(record.theta.shape[1] // 2, process_var=0.01, output_var=0.005, tracking=Tracking(fade))
    plain, factored = Plid(config), Plid(config, udu.FACTORED)
    difference = estimates(plain, record) - estimates(factored, record)
    assert np.max(np.abs(difference)) < 1e-8
    assert factored.covariance == pytest.approx(plain.covariance, abs=1e-8)
    assert factored.gain == pytest.approx(plain.gain, abs=1e-8)


def _factors(P: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """U and D of P = U diag(D) U', by elimination from the last column: Bierman's factorization."""
    n = len(P)
    P, U, D = P.copy(), np.eye(n), np.zeros(n)
    for j in range(n - 1, -1, -1):
        D[j] = P[j, j]
        U[:j, j] = P[:j, j] / D[j]
        P[:j, :j] -= D[j] * np.outer(U[:j, j], U[:j, j])
    return U, D


def test_the_block_fade_is_7_18_to_7_20(rng: np.random.Generator) -> None:
    n, fade = 2, 1.3
    root = rng.standard_normal((6, 6))
    U, D = _factors(root @ root.T)
    settings = np.array([1e12, 0.0, 1.0, fade, 0.0, np.finfo(np.float64).tiny])  # a reading without information
    stored = np.triu(U, 1) + np.diag(D)
    y, u = 0.7, -1.3
    udu.step(np.zeros(6), stored, np.zeros(6), settings, y, u, 0.0, 0.0, False)

    F = np.eye(6)
    F[:n, :n] = np.eye(n, k=-1)
    F[:n, n : 2 * n], F[:n, 2 * n :] = y * np.eye(n), u * np.eye(n)
    U, D = _factors(F @ (U * D) @ U.T @ F.T)  # result of the time update, eq (7.11)
    U1, S, U2, D1, D2 = U[:n, :n], U[:n, n:], U[n:, n:], D[:n], D[n:]
    inverse = np.linalg.inv(U1)
    D1_faded = np.diag(D1) + inverse @ S @ np.diag(D2 - D2 / fade) @ S.T @ inverse.T  # (7.18c)
    U_, D1_ = _factors(D1_faded)  # (7.19)
    wanted_U = np.block([[U1 @ U_, S / fade], [np.zeros((6 - n, n)), U2]])  # (7.18b), (7.20)
    wanted_D = np.concatenate([D1_, fade * D2])  # (7.18a)
    assert np.diag(stored) == pytest.approx(wanted_D, rel=1e-8)
    assert np.triu(stored, 1) + np.eye(6) == pytest.approx(wanted_U, rel=1e-8, abs=1e-9)


def test_pivots_are_no_eigenvalues() -> None:
    """As Kemp S 7.1 has it; their product is that of the eigenvalues all the same."""
    record = plants.record("C", 0.01, 0.01, 30, 0)
    identifier = Plid(PlidConfig(3, process_var=0.01, output_var=0.01), udu.FACTORED)
    estimates(identifier, record)
    pivots = _factors(identifier.covariance)[1]
    eigenvalues = np.linalg.eigvalsh(identifier.covariance)
    assert np.max(np.abs(np.sort(pivots) / eigenvalues - 1.0)) > 0.1
    assert np.sum(np.log(pivots)) == pytest.approx(np.sum(np.log(eigenvalues)), abs=1e-6)


def test_in_single_precision_the_plain_form_is_lost_and_the_factored_one_is_not() -> None:
    """With readings much more accurate than the prior, the plain form has a negative eigenvalue after a few samples and does not recover."""
    r, q, lost, off = 1e-6, 1e-4, [], []
    for seed in range(10):
        record = plants.record("A", r, q, 301, seed)
        single = PlidConfig(3, process_var=q, output_var=r, dtype="float32")
        plain, factored = Plid(single), Plid(single, udu.FACTORED)
        reference = Plid(PlidConfig(3, process_var=q, output_var=r), udu.FACTORED)
        first, u_before = None, 0.0
        for k, (y, u) in enumerate(zip(record.y.tolist(), record.u.tolist(), strict=True)):
            for form in (plain, factored, reference):
                form.update(y, u_before)
            if first is None and np.linalg.eigvalsh(plain.covariance)[0] < 0.0:
                first = k
            assert np.all(np.diag(factored.stored) > 0.0), (seed, k)
            u_before = u
        lost.append(first)
        off.append([np.max(np.abs(form.parameters - reference.parameters)) for form in (plain, factored)])
    print("first negative eigenvalue at", lost)
    assert all(first is not None and first <= 5 for first in lost)
    plain_off, factored_off = np.median(off, axis=0)
    assert factored_off < 1e-5
    assert plain_off > 1.0


def test_exactly_known_parameters_stay_finite_in_single_precision() -> None:
    """With r = q = 0 the pivots fall below the smallest normal number of single precision."""
    for plant in "AC":
        for seed in range(20):
            record = plants.record(plant, 0.0, 0.0, 60, seed)
            found = estimates(Plid(PlidConfig(3, dtype="float32"), udu.FACTORED), record)
            assert np.all(np.isfinite(found)), (plant, seed)
        assert np.max(np.abs(found[-1] - record.theta[0])) < 0.05
