"""Transfer functions from phasors, against scipy.signal's simulation and frequency response."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

from flightbed.studies.methods.sinusoids import phasor, second_order, transfer_function


def test_the_second_order_example_from_a_simulated_test() -> None:
    """Sillence S 2.2.1: drive the plant by a sinusoid, read the phasor, solve for omega_n and zeta."""
    omega_n, zeta, omega = 2.3, 0.35, 1.7
    plant = signal.lti([omega_n**2], [1.0, 2 * zeta * omega_n, omega_n**2])
    t = np.linspace(0.0, 60.0, 60001)
    _, y, _ = signal.lsim(plant, np.sin(omega * t), t)
    settled = t > 30.0
    found = second_order(omega, phasor(omega, t[settled], y[settled]))
    assert found == pytest.approx((omega_n, zeta), rel=1e-5)


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_2n_parameters_from_n_sinusoids(rng: np.random.Generator, order: int) -> None:
    poles = -rng.uniform(0.5, 5.0, order)
    a = -np.poly(poles)[1:]
    b = rng.normal(size=order)
    omega = np.sort(rng.uniform(0.3, 6.0, order))
    _, response = signal.freqs(b, np.append(1.0, -a), worN=omega)
    found = transfer_function(omega, response, order=order)
    assert found.a == pytest.approx(a, rel=1e-6)
    assert found.b == pytest.approx(b, rel=1e-6, abs=1e-8)
    assert found.response(omega) == pytest.approx(response)


def test_over_modelling_is_ill_conditioned_and_too_few_sinusoids_are_refused() -> None:
    """S 2.1 warns of more parameters than the plant has: an error of 1e-6 puts the surplus pole anywhere, here into the right half plane."""
    omega = np.array([0.5, 1.0, 2.0])
    _, response = signal.freqs([4.0], [1.0, 1.4, 4.0], worN=omega)
    disturbed = response * (1 + 1e-6 * np.array([1, -1, 1]))
    right, over = (transfer_function(omega[:n], disturbed[:n], order=n) for n in (2, 3))
    assert right.a == pytest.approx([-1.4, -4.0], rel=1e-4)
    assert np.roots(np.append(1.0, -over.a)).real.max() > 1.0
    with pytest.raises(ValueError, match="order 3 needs 3 different"):
        transfer_function(np.array([1.0, 1.0, 2.0]), response, order=3)


def test_a_response_that_no_such_plant_has_is_refused() -> None:
    with pytest.raises(ValueError, match="no stable second-order"):
        second_order(1.0, 0.5 + 0.1j)
