"""Excitation: against its definition, and its sigma of K against the Cramer-Rao bound of a double integrator."""

from __future__ import annotations

import numpy as np
import pytest

from flightbed.analysis.excitation import excitation_deg_s2


def test_it_is_the_rms_of_the_last_window(rng: np.random.Generator) -> None:
    deflection = rng.normal(size=200)
    found = excitation_deg_s2(deflection, m_delta=-13.0, control_hz=100)
    for k in (0, 5, 29, 30, 120, 199):
        window = deflection[max(0, k - 29) : k + 1]
        assert found[k] == pytest.approx(13.0 * np.sqrt(np.mean(window**2)), rel=1e-12)


def test_it_does_not_depend_on_the_control_rate() -> None:
    t = np.arange(0.0, 3.0, 1 / 400)
    fine = excitation_deg_s2(np.sin(t), m_delta=10.0, control_hz=400)
    coarse = excitation_deg_s2(np.sin(t[::4]), m_delta=10.0, control_hz=100)
    np.testing.assert_allclose(coarse[60:], fine[::4][60:], atol=0.05)  # their samples are 3.75 ms apart on average


def test_the_excitation_without_motion_is_zero() -> None:
    np.testing.assert_array_equal(excitation_deg_s2(np.zeros(40), m_delta=5.0, control_hz=100), 0.0)


def test_sigma_of_k_agrees_with_the_docstring() -> None:
    """q' = K e: readings of q over N ticks from a known start give sigma of K = sigma_q / (e T sqrt(N/3))."""
    sigma_q, e, hz, n = 0.1, 40.0, 1000, 300
    t = np.arange(1, n + 1) / hz
    information = np.sum((e * t) ** 2) / sigma_q**2
    assert 1 / np.sqrt(information) == pytest.approx(sigma_q / (e * n / hz * np.sqrt(n / 3)), rel=0.01)
