"""Metrics from traces made by hand."""

from __future__ import annotations

import numpy as np
import pytest

from flightbed.analysis.metrics import measure, snr_db
from flightbed.analysis.trace import Trace

T = np.arange(1000) / 100


def _trace(**columns: np.ndarray) -> Trace:
    base = {
        "t_s": T, "alpha_deg": np.full(1000, 2.0), "q_deg_s": np.zeros(1000), "q_ref_deg_s": np.zeros(1000),
        "effectiveness_true": np.where(T < 4, 1.0, 0.5), "a.effectiveness": np.ones(1000),
        "a.effectiveness_smoothed": np.ones(1000), "a.nis": np.full(1000, 2.0),
        "a.alarms": np.zeros(1000), "a.effectiveness_raw": np.ones(1000), "a.effectiveness_std": np.full(1000, 0.5),
    }  # fmt: skip
    return Trace({**base, **columns}, ("a",))


def test_tracking_before_and_from_three_tenths_after_the_failure() -> None:
    q = np.where(T < 4, 1.0, np.where(T < 4.3 - 1e-9, 99.0, 3.0))
    metrics = measure(_trace(q_deg_s=q), alpha_trim_deg=2.0, failed_at_s=4.0)
    assert metrics.tracking_rms_pre_deg_s == pytest.approx(1.0)
    assert metrics.tracking_rms_post_deg_s == pytest.approx(3.0)
    assert not metrics.departed
    assert metrics.departed_at_s is None


def test_estimates_count_from_the_failure() -> None:
    estimate = np.where(T < 4, 1.0, np.maximum(0.45, 1.0 - (T - 4)))  # 0.6 reached at 4.4 s
    estimate[:100] = 0.8
    smoothed = np.where(T < 5, 1.0, 0.55)
    trace = _trace(**{"a.effectiveness": estimate, "a.effectiveness_smoothed": smoothed})
    found = measure(trace, alpha_trim_deg=2.0, failed_at_s=4.0).estimators["a"]
    assert found.first_within_20pct_s == pytest.approx(0.40)
    assert found.first_within_20pct_smoothed_s == pytest.approx(1.0)
    assert found.final == 0.45
    assert found.median_abs_error_post == pytest.approx(0.05)
    post = T >= 4.3 - 1e-9
    assert found.rms_error_smoothed_post == pytest.approx(np.sqrt(np.mean((smoothed[post] - 0.5) ** 2)))
    assert found.std_pre == pytest.approx(np.std(estimate[:400]))
    assert found.nis_mean == 2.0
    assert found.detected_at_s is None


def test_tracking_counts_from_the_first_failure_and_estimates_from_that_of_the_elevator() -> None:
    """The c.g. moves at 2 s, K falls at 4 s: between the two an estimator of K observes a healthy elevator."""
    q = np.where(T < 2, 1.0, np.where(T < 2.3 - 1e-9, 99.0, 3.0))
    estimate = np.where(T < 4, 0.9, 0.5)
    alarms = np.where(T < 3, 0.0, np.where(T < 4.2 - 1e-9, 1.0, 2.0))
    trace = _trace(q_deg_s=q, **{"a.effectiveness": estimate, "a.alarms": alarms})
    metrics = measure(trace, alpha_trim_deg=2.0, failed_at_s=2.0)
    assert metrics.estimators_since_s == 4.0
    assert (metrics.tracking_rms_pre_deg_s, metrics.tracking_rms_post_deg_s) == pytest.approx((1.0, 3.0))
    found = metrics.estimators["a"]
    assert (found.false_alarms, found.detected_at_s) == (1, pytest.approx(0.2))
    assert found.median_abs_error_post == 0.0
    assert found.first_within_20pct_s == 0.0


def test_without_a_failure_of_the_elevator_estimates_count_from_the_first_failure() -> None:
    still = _trace(effectiveness_true=np.ones(1000), **{"a.effectiveness": np.where(T < 2, 1.0, 0.7)})
    metrics = measure(still, alpha_trim_deg=2.0, failed_at_s=2.0)
    assert metrics.estimators_since_s == 2.0
    assert metrics.estimators["a"].median_abs_error_post == pytest.approx(0.3)
    assert measure(still, alpha_trim_deg=2.0, failed_at_s=None).estimators_since_s is None


def test_never_within_the_band_is_null_and_no_failure_is_all_before() -> None:
    found = measure(_trace(), alpha_trim_deg=2.0, failed_at_s=4.0).estimators["a"]
    assert found.first_within_20pct_s is None
    healthy = measure(_trace(effectiveness_true=np.ones(1000)), alpha_trim_deg=2.0, failed_at_s=None)
    assert healthy.tracking_rms_post_deg_s is None
    assert healthy.estimators["a"].median_abs_error_post is None
    assert healthy.estimators["a"].first_within_20pct_s is None
    assert healthy.tracking_rms_pre_deg_s == 0.0


@pytest.mark.parametrize(("alpha", "departed"), [(27.1, True), (-23.1, True), (26.9, False), (np.nan, True)])
def test_departure_is_25_degrees_from_trim_or_not_finite(alpha: float, departed: bool) -> None:
    alphas = np.full(1000, 2.0)
    alphas[-1] = alpha
    metrics = measure(_trace(alpha_deg=alphas), alpha_trim_deg=2.0, failed_at_s=4.0)
    assert metrics.departed == departed
    assert metrics.departed_at_s == (9.99 if departed else None)


def test_signal_to_noise_ratio_of_equation_82() -> None:
    """Sillence Table 1 with his printed poles and amplitudes about 6 deg and 11 deg/s: within 0.2 dB of the printed values."""
    poles = np.array([-0.6737, 0.30691], dtype=complex)  # as printed in S 5.2; the true ones are +0.6737, -3.0691
    printed = {(0.55534, 0.03): 23.29, (0.1108, 0.03): 37.227, (0.0739, 0.0739): 40.0, (0.00739, 0.00739): 60.0}
    for (q_std, alpha_std), decibel in printed.items():
        found = snr_db(alpha_max=6.0, q_max=11.0, alpha_std=alpha_std, q_std=q_std, poles=poles)
        assert found == pytest.approx(decibel, abs=0.2)
    # Scaling both sigmas by 10 costs 20 dB; no signal has no ratio.
    loud = snr_db(alpha_max=6.0, q_max=11.0, alpha_std=0.3, q_std=1.108, poles=poles)
    quiet = snr_db(alpha_max=6.0, q_max=11.0, alpha_std=0.03, q_std=0.1108, poles=poles)
    assert loud is not None
    assert quiet is not None
    assert quiet - loud == pytest.approx(20.0)
    assert snr_db(alpha_max=0.0, q_max=0.0, alpha_std=0.03, q_std=0.1, poles=poles) is None
