"""State feedback with integral action on an identified model: poles, safeguards, limits, a start without a bump."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import control
import numpy as np
import pytest

from flightbed.control.load_factor.integral_placement import AckermannConfig, IntegralPlacement, augment
from flightbed.studies.kemp import plants

GOLDEN = tomllib.loads((Path(__file__).parents[2] / "golden" / "kemp.toml").read_text())
F = plants.parameters("F")
PLAIN = AckermannConfig((0.8, 0.8, 0.8), (0.0, 0.0, -0.01), (0, 0, -1))


def _augmented(theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    n = len(theta) // 2
    A, b = np.full((n + 1, n + 1), np.nan), np.full(n + 1, np.nan)
    augment(theta, A, b)
    return A, b


@pytest.mark.parametrize("plant", ["A", "C", "D", "F"])
def test_the_augmented_model_is_plant_and_integrator_in_series(plant: str) -> None:
    theta = plants.parameters(plant)
    A, b = _augmented(theta)
    n = len(b) - 1
    series = control.tf(theta[: n - 1 : -1], [1.0, *-theta[n - 1 :: -1]], 1.0) * control.tf([-1.0], [1.0, -1.0], 1.0)
    ours = control.ss(A, b[:, None], np.eye(n + 1)[n:], 0, 1.0)
    at = np.exp(1j * np.array([0.1, 0.5, 2.0]))
    assert ours(at) == pytest.approx(series(at), rel=1e-9)


@pytest.mark.parametrize("plant", ["A", "C", "D", "F"])
def test_the_loop_has_the_poles_and_no_steady_error(plant: str) -> None:
    theta = plants.parameters(plant)
    n = len(theta) // 2
    poles = (0.5, 0.6 + 0.1j, 0.6 - 0.1j, 0.4)[: n + 1]
    law = IntegralPlacement(AckermannConfig(poles, (0.0,) * n + (-0.01,)))
    assert law.design(theta)
    A, b = _augmented(theta)
    assert np.poly(A - np.outer(b, law.gains)) == pytest.approx(np.poly(poles).real, abs=1e-9)
    x, still = np.zeros(n), np.zeros(n)
    for _ in range(150):
        u = law.demand(x, 1.0 - float(x[-1]))
        plants.advance(x, theta, u, still)
    assert x[-1] == pytest.approx(1.0, abs=1e-9)


def test_the_aircrafts_polynomial_is_that_of_the_printed_poles() -> None:
    poles = np.exp(0.01 * np.array([-4 + 2j, -4 - 2j, -10]))
    assert np.poly(poles).real == pytest.approx(
        GOLDEN["aircraft"]["polynomial"], abs=3e-6
    )  # single precision, by its last digits
    law = IntegralPlacement(AckermannConfig(tuple(poles.tolist()), (0.0, 0.0, -0.05), (1, 1, -1)))
    # The initial model in the listing of subroutine D gives gains of the required signs.
    assert law.design(np.array([-0.9856, 1.953, 0.1416, -0.1025]))


def test_gains_of_the_wrong_sign_and_of_a_singular_model_are_rejected() -> None:
    law = IntegralPlacement(PLAIN)
    assert law.design(F)
    good = law.gains
    assert good[-1] < 0.0
    reversed_ = np.array([*F[:2], *-F[2:]])
    for poor in (reversed_, np.zeros(4), np.array([np.nan, *F[1:]])):
        assert not law.design(poor)
        assert law.gains == pytest.approx(good, abs=0.0)
    # A zero on a pole: the input does not reach that mode.
    cancelled = np.array([-0.4, 1.3, -0.5, 1.0])  # (z - 0.5) over (z - 0.5)(z - 0.8)
    assert not law.design(cancelled)
    assert IntegralPlacement(AckermannConfig((0.8,) * 3, (0.0, 0.0, 0.0))).design(
        reversed_
    )  # without the rule of signs


def test_the_first_gains_come_back_when_patience_ends() -> None:
    law = IntegralPlacement(AckermannConfig((0.8,) * 3, (0.0, 0.0, -0.01), (0, 0, -1), patience=3))
    law.design(F)
    poor = np.array([*F[:2], *-F[2:]])
    law.design(poor)
    law.design(poor)
    law.design(F)
    kept = law.gains
    law.design(poor)
    law.design(poor)
    assert law.gains == pytest.approx(kept, abs=0.0)
    law.design(poor)
    assert law.gains == pytest.approx([0.0, 0.0, -0.01], abs=0.0)


def test_at_a_limit_the_input_is_held_and_the_integrator_too() -> None:
    law = IntegralPlacement(AckermannConfig((0.8,) * 3, (0.0, 0.0, -0.5), (0, 0, -1)))
    x = np.zeros(2)
    assert law.demand(x, 10.0, (-1.0, 1.0)) == 0.0
    assert law.integral == 10.0
    assert law.demand(x, 1.0, (-1.0, 1.0)) == 1.0  # -K_e z = 5
    assert law.integral == 10.0  # the error would push further beyond the limit
    assert law.demand(x, -9.0, (-1.0, 1.0)) == 1.0
    assert law.integral == 1.0  # it brings it back
    assert law.demand(x, -20.0) == 0.5
    assert law.demand(x, -1.0, (-1.0, 1.0)) == -1.0
    assert law.integral == -19.0


def test_a_loop_at_its_limit_recovers_without_windup() -> None:
    """The plant cannot reach the reference within the limits; when the reference is in reach again it is there at once."""
    delays = {}
    for held in (True, False):
        law = IntegralPlacement(PLAIN)
        law.design(F)
        x, still, reached = np.zeros(2), np.zeros(2), None
        for k in range(400):
            r = 50.0 if k < 200 else 0.0
            u = law.demand(x, r - float(x[1]), (-3.0, 3.0) if held else (-np.inf, np.inf))
            if not held:
                u = min(max(u, -3.0), 3.0)  # cut after the law, which does not know
            plants.advance(x, F, u, still)
            if k > 200 and reached is None and abs(x[1]) < 1.0:
                reached = k - 200
        delays[held] = reached if reached is not None else 400
    assert delays[True] < 60
    assert delays[True] < delays[False]


def test_a_start_without_a_bump() -> None:
    law = IntegralPlacement(PLAIN)
    law.design(F)
    x = np.array([0.3, -0.2])
    law.settle(x, 0.7)
    assert law.demand(x, 0.0) == pytest.approx(0.7)
    with pytest.raises(ValueError, match="the integral gain is 0"):
        IntegralPlacement(AckermannConfig((0.8,) * 3, (1.0, 1.0, 0.0))).settle(x, 0.7)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"poles": (0.5, 0.5), "first": (0.0,)}, "one value for each of the 2 poles"),
        ({"poles": (0.5, 0.5), "first": (0.0, -1.0), "signs": (0,)}, "one value for each of the 2 poles"),
        ({"poles": (0.5, 0.5), "first": (0.0, -1.0), "signs": (0, 2)}, "signs must be -1, 0 or"),
        ({"poles": (0.5, 0.5), "first": (0.0, 1.0), "signs": (0, -1)}, "must have the required signs"),
        ({"poles": (0.5 + 0.1j, 0.5), "first": (0.0, -1.0)}, "conjugate pairs"),
        ({"poles": (0.5, 0.5), "first": (0.0, -1.0), "smallest_controllability": 0.0}, "above 0"),
        ({"poles": (0.5, 0.5), "first": (0.0, -1.0), "patience": -1}, "must not be negative"),
    ],
)
def test_settings_that_make_no_sense_are_refused(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        AckermannConfig(**settings)
