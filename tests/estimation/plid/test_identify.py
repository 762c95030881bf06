"""PLID against the theorem of the thesis, filterpy, its equations in full matrices, the Riccati equation, and its uncompiled kernel."""

from __future__ import annotations

import zlib
from typing import Any

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from scipy.linalg import solve_discrete_are

from flightbed.estimation.plid import factored, identify
from flightbed.estimation.plid.identify import CONVENTIONAL, Form, Plid, PlidConfig, Tracking
from flightbed.studies.kemp import plants, printed
from flightbed.studies.kemp.methods import estimates
from flightbed.studies.kemp.plants import Record
from flightbed.studies.kemp.trials import full_rank_at, random_plant

FORMS = pytest.mark.parametrize("form", [CONVENTIONAL, factored.FACTORED], ids=["plain", "factored"])


def _extended(identifier: Plid) -> np.ndarray:
    """Extended state (x, a, b[, b_n])."""
    return np.concatenate([identifier.state, identifier.parameters])


def _response(theta: np.ndarray, u: np.ndarray, feed: float = 0.0) -> np.ndarray:
    """y of eq (2.8), from rest, computed independently."""
    n = len(theta) // 2
    y = np.zeros(len(u))
    for k in range(len(u)):
        y[k] = feed * u[k]
        for i in range(1, min(n, k) + 1):
            y[k] += theta[n - i] * y[k - i] + theta[2 * n - i] * u[k - i]
    return y


def _matrices(n: int, y: float, u: float, u_now: float, *, feed: bool) -> tuple[np.ndarray, np.ndarray]:
    """F and H of eq (2.14)."""
    size = 3 * n + feed
    F, H = np.eye(size), np.zeros((1, size))
    F[:n, :n] = np.eye(n, k=-1)
    F[:n, n : 2 * n], F[:n, 2 * n : 3 * n] = y * np.eye(n), u * np.eye(n)
    H[0, n - 1] = 1.0
    if feed:
        H[0, -1] = u_now
    return F, H


@FORMS
@pytest.mark.parametrize("plant", "ABCD")
def test_a_plant_without_noise_is_known_after_3n_samples_and_not_before(plant: str, form: Form) -> None:
    record = plants.record(plant, 0.0, 0.0, 40, 0)
    error = np.max(np.abs(estimates(Plid(PlidConfig(3), form), record) - record.theta), axis=1)
    assert error[printed.DEADBEAT - 1] > 0.1
    assert error[printed.DEADBEAT] < 1e-9
    assert np.max(error[printed.DEADBEAT :]) < 1e-6 if form is CONVENTIONAL else error[20] < 1e-9


def _condition(n: int, record: Record, k: int) -> float:
    """Condition of the observability matrix (2.27) to sample k, its columns of like size."""
    rows = np.zeros((k + 1, 3 * n))
    for i in range(k + 1):
        rows[i, :n] = np.arange(n) == n - 1 - i
        for j in range(n):
            if i - n + j >= 0:
                rows[i, n + j], rows[i, 2 * n + j] = record.y[i - n + j], record.u[i - n + j]
    return float(np.linalg.cond(rows / np.linalg.norm(rows, axis=0)))


@pytest.mark.parametrize("idle", [0, 1, 3, 7])
@pytest.mark.parametrize("order", [2, 3, 4, 5])
def test_deadbeat_comes_when_the_extended_state_is_observable_and_no_sooner(order: int, idle: int) -> None:
    """An input that starts late delays it by a predictable number of samples: idle samples determine the n states only.

    Its precision then depends on the draw, through the condition of the observed data.
    """
    exact = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        theta = random_plant(rng, order)
        u = np.concatenate([np.zeros(idle), rng.standard_normal(4 * order)])
        record = Record(np.tile(theta, (len(u), 1)), u, _response(theta, u))
        error = np.max(np.abs(estimates(Plid(PlidConfig(order), factored.FACTORED), record) - theta), axis=1)
        predicted = idle + 3 * order - min(idle + 1, order)
        assert full_rank_at(record) == predicted, seed
        condition = _condition(order, record, predicted)
        assert error[predicted] < 1e-14 * condition**2, (seed, condition)
        if condition < 1e4:
            assert error[predicted] < 1e-6, seed
            assert np.min(error[:predicted]) > 1e3 * error[predicted], seed
            exact += 1
    assert exact >= 5


@FORMS
@pytest.mark.parametrize("order", [1, 2, 3])
def test_feedthrough_takes_one_sample_more(order: int, form: Form, rng: np.random.Generator) -> None:
    theta, feed = random_plant(rng, order), 0.7
    u = rng.standard_normal(5 * order)
    y = _response(theta, u, feed)
    identifier = Plid(PlidConfig(order, feedthrough=True), form)
    # With b_n the state form has b_i + a_i b_n, eq (2.9), but the extended one b_i of the transfer function, eq (2.12).
    for k in range(3 * order + 1):
        assert k < 3 * order or np.max(np.abs(identifier.parameters - [*theta, feed])) > 1e-3
        identifier.update(float(y[k]), float(u[k - 1]) if k else 0.0, float(u[k]))
    assert identifier.parameters == pytest.approx([*theta, feed], abs=1e-7)


def _written_out(config: PlidConfig, record: Record) -> tuple[np.ndarray, np.ndarray]:
    """Eqs (2.23), (4.1)-(4.3) in full matrices; estimates (N, size) and the last P."""
    n, t, size = config.order, config.tracking, config.size
    s, P = np.zeros(size), np.diag(np.broadcast_to(config.prior_var, (size,))).astype(float)
    found = []
    for k in range(len(record.y)):
        before = (record.y[k - 1], record.u[k - 1]) if k else (0.0, 0.0)
        F, H = _matrices(n, *before, record.u[k], feed=config.feedthrough)
        if k:
            s = F @ s
            P = t.whole_fade * F @ P @ F.T
            P[:n, :n] += config.process_var * np.eye(n)
            P[n:, n:] += t.pseudonoise_var * np.eye(size - n)
            P[n:, n:] *= t.block_fade
        gain = P @ H[0] / (H[0] @ P @ H[0] + config.output_var)
        s = s + gain * (record.y[k] - H[0] @ s)
        P = (np.eye(size) - np.outer(gain, H[0])) @ P
        P = 0.5 * (P + P.T)
        if (t.reset_every and (k + 1) % t.reset_every == 0) or (
            k and t.reset_below and np.linalg.norm(gain[n:]) < t.reset_below
        ):
            P = np.diag(np.broadcast_to(config.prior_var, (size,))).astype(float)
        found.append(s)
    return np.array(found), P


TRACKINGS = [
    Tracking(), Tracking(block_fade=1.01), Tracking(whole_fade=1.02), Tracking(pseudonoise_var=1e-3), Tracking(reset_every=15),
    Tracking(reset_below=0.02), Tracking(1.01, 1.02, 1e-3, 25, 0.01),
]  # fmt: skip


@FORMS
@pytest.mark.parametrize("feedthrough", [False, True])
@pytest.mark.parametrize("tracking", TRACKINGS, ids=lambda t: "-".join(f"{v:g}" for v in vars(t).values()))
def test_every_way_of_tracking_is_its_equation(tracking: Tracking, feedthrough: bool, form: Form) -> None:
    config = PlidConfig(3, feedthrough, 0.01, 0.02, prior_var=20.0, tracking=tracking)
    record = plants.record("C", 0.02, 0.01, 80, 3)
    identifier, found = Plid(config, form), []
    for k in range(80):
        identifier.update(float(record.y[k]), float(record.u[k - 1]) if k else 0.0, float(record.u[k]))
        found.append(_extended(identifier))
    wanted, P = _written_out(config, record)
    assert np.array(found) == pytest.approx(wanted, abs=1e-8)
    assert identifier.covariance == pytest.approx(P, abs=1e-8)
    plain, _ = _written_out(PlidConfig(3, feedthrough, 0.01, 0.02, prior_var=20.0), record)
    assert (np.max(np.abs(wanted - plain)) > 1e-4) == (tracking != Tracking())  # each has an effect


@FORMS
def test_it_is_the_kalman_filter_of_filterpy(form: Form) -> None:
    record = plants.record("A", 0.01, 0.02, 60, 1)
    identifier = Plid(PlidConfig(3, process_var=0.02, output_var=0.01), form)
    theirs = KalmanFilter(dim_x=9, dim_z=1)
    theirs.P, theirs.R = 200.0 * np.eye(9), np.array([[0.01]])
    Q = np.diag([0.02] * 3 + [0.0] * 6)
    for k in range(60):
        before = (record.y[k - 1], record.u[k - 1]) if k else (0.0, 0.0)
        F, H = _matrices(3, *before, 0.0, feed=False)
        if k:
            theirs.predict(F=F, Q=Q)
        theirs.update(record.y[k], H=H)
        identifier.update(float(record.y[k]), before[1])
        assert identifier.innovation == pytest.approx(float(theirs.y[0, 0]), abs=1e-9)
        assert identifier.innovation_var == pytest.approx(float(theirs.S[0, 0]), rel=1e-9)
        assert identifier.gain == pytest.approx(theirs.K[:, 0], abs=1e-9)
    assert _extended(identifier) == pytest.approx(theirs.x[:, 0], abs=1e-8)
    assert identifier.covariance == pytest.approx(theirs.P, abs=1e-9)


@FORMS
def test_with_known_parameters_it_is_the_state_filter_of_the_riccati_equation(form: Form) -> None:
    """Kemp S 3.5: once the parameters have converged the states are those of the ordinary Kalman filter."""
    theta, q, r = plants.parameters("C"), 0.02, 0.01
    A, c = np.eye(3, k=-1), np.array([0.0, 0.0, 1.0])
    A[:, 2] += theta[:3]
    # PLID does not model the noise of y in F: it runs the filter for J, with a y as an input.
    predicted = solve_discrete_are(np.eye(3, k=-1).T, c[:, None], q * np.eye(3), np.array([[r]]))
    config = PlidConfig(
        3, process_var=q, output_var=r, prior=(0.0,) * 3 + tuple(theta), prior_var=(200.0,) * 3 + (0.0,) * 6
    )
    identifier = Plid(config, form)
    record = plants.record("C", r, q, 100, 0)
    estimates(identifier, record)
    corrected = predicted - np.outer(predicted @ c, c @ predicted) / (c @ predicted @ c + r)
    assert identifier.covariance[:3, :3] == pytest.approx(corrected, abs=1e-10)
    assert identifier.parameters == pytest.approx(theta, abs=0.0)
    # Without noise of the readings both are the same filter.
    right = solve_discrete_are(A.T, c[:, None], q * np.eye(3), np.array([[1e-9]]))
    assumed = solve_discrete_are(np.eye(3, k=-1).T, c[:, None], q * np.eye(3), np.array([[1e-9]]))
    assert assumed == pytest.approx(right, abs=1e-6)


def test_single_precision_is_single_throughout() -> None:
    record = plants.record("A", 0.01, 0.01, 100, 0)
    for form in (CONVENTIONAL, factored.FACTORED):
        single, double = (
            Plid(PlidConfig(3, process_var=0.01, output_var=0.01, dtype=dtype), form)
            for dtype in ("float32", "float64")
        )
        difference = np.max(np.abs(estimates(single, record) - estimates(double, record)))
        assert 1e-8 < difference < 1e-2
        assert np.all(_extended(single) == _extended(single).astype(np.float32))
        assert not np.all(_extended(double) == _extended(double).astype(np.float32))


@pytest.mark.parametrize("kernel", [identify.step, factored.step], ids=["plain", "factored"])
def test_compiled_and_plain_agree(kernel: Any) -> None:
    seed = zlib.crc32(b"compiled and plain")
    record = plants.record("C", 0.02, 0.01, 30, seed)
    settings = np.array([0.02, 0.01, 1.0, 1.01, 0.0, np.finfo(np.float64).tiny])
    results = []
    for function in (kernel, kernel.py_func):
        s, P, gain = np.zeros(10), 20.0 * np.eye(10), np.zeros(10)
        for k in range(30):
            before = (record.y[k - 1], record.u[k - 1]) if k else (0.0, 0.0)
            returned = function(
                s, P, gain, settings, *map(float, before), float(record.y[k]), float(record.u[k]), k == 0
            )
        results.append((s, P, gain, returned))
    for ours, theirs in zip(*results, strict=True):
        assert ours == pytest.approx(theirs, rel=1e-12, abs=1e-13)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: PlidConfig(0), "order must be at least 1"),
        (lambda: PlidConfig(2, output_var=-1.0), "must not be negative"),
        (lambda: PlidConfig(2, prior=(0.0,) * 5), "prior needs 6 values"),
        (lambda: PlidConfig(2, True, prior_var=(1.0,) * 6), "prior_var needs 7 values"),
        (lambda: Tracking(0.9), "at least 1"),
        (lambda: Tracking(pseudonoise_var=-1.0), "must not be negative"),
    ],
)
def test_settings_that_make_no_sense_are_refused(make: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make()
