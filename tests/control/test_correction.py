"""The correction: caution, limits of the command, and equivalence of redesigned and scaled gains."""

from __future__ import annotations

import numpy as np
import pytest

from flightbed.avionics.short_period import ShortPeriod
from flightbed.control.correction import Adaptation
from flightbed.control.design import closed_loop, default_poles, design_proportional, peak_deflection
from flightbed.core.units import DEG


def _adaptation(*, caution: float = 0.0, trim_rad: float = 0.0, peak_per_reference: float | None = None) -> Adaptation:
    return Adaptation(
        True, 0, 0.08, "effective", -0.4, 0.4, caution=caution, trim_rad=trim_rad, peak_per_reference=peak_per_reference
    )


def test_cautious_correction_has_the_least_mean_square_error() -> None:
    """Against a search over deflections, K normal about K-hat: E (K u - d)^2 in closed form is not used."""
    mean, std, demand = 0.4, 0.2, 0.05
    K = mean + std * np.random.default_rng(1).standard_normal(200_000)
    u = np.linspace(0.0, 0.3, 3001)
    best = u[np.argmin([np.mean((K * v - demand) ** 2) for v in u])]
    assert demand / _adaptation(caution=1.0).effectiveness_used(mean, std) == pytest.approx(best, rel=0.01)
    assert _adaptation().effectiveness_used(mean, std) == mean
    assert _adaptation(caution=3.0).effectiveness_used(mean, 5.0) == 1.0  # never less than the healthy law's demand
    assert _adaptation(caution=1.0).effectiveness_used(0.01, 0.0) == 0.08


def test_the_reference_is_limited_to_the_remaining_elevator() -> None:
    adaptation = _adaptation(trim_rad=-0.02, peak_per_reference=0.5)
    assert adaptation.reference(0.05, 1.0) == 0.05
    assert adaptation.reference(0.9, 0.1) == pytest.approx((0.04 - 0.02) / 0.5)
    assert adaptation.reference(-0.9, 0.1) == pytest.approx(-(0.04 - 0.02) / 0.5)
    assert adaptation.reference(0.9, 0.04) == 0.0  # not even trim is left
    assert _adaptation().reference(0.9, 0.1) == 0.9


def test_peak_deflection_is_that_of_a_fine_simulation(design: ShortPeriod) -> None:
    """Against scipy's solver of differential equations."""
    from scipy.integrate import solve_ivp

    gains = design_proportional(design)
    A, lag = closed_loop(design, gains), design.actuator_rad_s

    def rates(_t: float, y: np.ndarray) -> np.ndarray:
        return np.append(A @ y[:3] + [0.0, 0.0, lag * gains.reference * y[3]], 3.0 * (1.0 - y[3]))

    found = solve_ivp(rates, (0.0, 5.0), np.zeros(4), rtol=1e-9, atol=1e-12, max_step=0.005)
    assert peak_deflection(design, gains, 3.0) == pytest.approx(float(np.abs(found.y[2]).max()), rel=0.01)


@pytest.mark.parametrize("K", [0.5, 0.2, 0.1])
def test_gains_redesigned_for_the_remaining_elevator_are_the_scaled_ones(design: ShortPeriod, K: float) -> None:
    """Poles placed on (A, K b) give k/K on alpha, q and reference and the same gain on the elevator, like 1/K with K d fed back."""
    healthy = design_proportional(design)
    weak = ShortPeriod(design.A, K * design.b, design.actuator_rad_s)
    redesigned = design_proportional(weak, default_poles(design))
    assert redesigned.alpha == pytest.approx(healthy.alpha / K)
    assert redesigned.q == pytest.approx(healthy.q / K)
    assert redesigned.reference == pytest.approx(healthy.reference / K)
    assert redesigned.elevator == pytest.approx(healthy.elevator)
    demand = healthy.alpha * 0.02 + healthy.q * 0.03 + healthy.reference * 0.05 + healthy.elevator * (K * 4 * DEG)
    assert demand / K == pytest.approx(
        redesigned.alpha * 0.02 + redesigned.q * 0.03 + redesigned.reference * 0.05 + redesigned.elevator * 4 * DEG
    )
