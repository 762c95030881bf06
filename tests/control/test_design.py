"""Gains and closed loops against the printed tables of Sillence (1999)."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import control
import numpy as np
import pytest
from scipy.signal import place_poles

from flightbed.avionics.short_period import ShortPeriod
from flightbed.control.base import Gains
from flightbed.control.design import (
    closed_loop,
    default_poles,
    design_integral,
    design_proportional,
    reference_gain,
)
from flightbed.core.errors import DesignError

GOLDEN = tomllib.loads((Path(__file__).parents[1] / "golden" / "sillence.toml").read_text())


def _plant() -> ShortPeriod:
    p = GOLDEN["plant"]
    A = np.array([[p["Z_alpha"], p["Z_q"]], [p["M_alpha"], p["M_q"]]])
    return ShortPeriod(A, np.array([p["Z_delta"], p["M_delta"]]), p["actuator_rad_s"])


def _gains(*, integral: bool) -> Gains:
    g = GOLDEN["gains"]
    return Gains(g["alpha"], g["q"], g["elevator"], g["reference"], g["integral"] if integral else 0.0)


def _half_unit(text: str) -> float:
    """Half a unit of the last digit of a printed number."""
    return 0.5 * 10.0 ** -len(text.partition(".")[2])


def _assert_printed(matrix: np.ndarray, printed: list[str]) -> None:
    """Every eigenvalue rounds to the digits that are printed for it."""
    found = np.linalg.eigvals(matrix)
    wanted = np.array([complex(text) for text in printed])
    nearest = np.abs(found[:, None] - wanted[None, :]).argmin(axis=1)
    assert sorted(nearest) == list(range(len(wanted))), (found, wanted)
    for value, index in zip(found, nearest, strict=True):
        real, *imag = re.findall(r"[+-]?[0-9.]+", printed[index])
        assert abs(value.real - float(real)) <= _half_unit(real), (value, printed[index])
        assert abs(value.imag - float(imag[0] if imag else 0)) <= (_half_unit(imag[0]) if imag else 0), (
            value,
            printed[index],
        )


def test_open_loop_poles_of_tables_2_and_3() -> None:
    A, _ = _plant().with_actuator()
    _assert_printed(A, GOLDEN["table_3"]["open_loop"])
    _assert_printed(A, GOLDEN["table_2"]["open_loop"])


@pytest.mark.parametrize(("effectiveness", "row"), [(1.0, "closed_loop_K1"), (0.08, "closed_loop_K008")])
@pytest.mark.parametrize("table", ["table_2", "table_3"])
def test_closed_loop_eigenvalues_of_tables_2_and_3(table: str, effectiveness: float, row: str) -> None:
    """Table 2 is the PI law, Table 3 the P law."""
    matrix = closed_loop(_plant(), _gains(integral=table == "table_2"), effectiveness=effectiveness)
    _assert_printed(matrix, GOLDEN[table][row])


def test_reference_gain_is_the_printed_one() -> None:
    gains = _gains(integral=False)
    found = reference_gain(_plant(), [gains.alpha, gains.q, gains.elevator])
    assert found == pytest.approx(GOLDEN["gains"]["reference"], abs=5e-6)


def test_placing_the_printed_poles_gives_the_printed_gains() -> None:
    poles = [complex(p) for p in GOLDEN["table_3"]["closed_loop_K1"]]
    found, printed = design_proportional(_plant(), poles), _gains(integral=False)
    # Poles printed to 1e-4 fix the gains to a few 1e-5; the gains are printed to 1e-3.
    assert (found.alpha, found.q, found.elevator) == pytest.approx(
        (printed.alpha, printed.q, printed.elevator), abs=5e-4
    )
    assert found.reference == pytest.approx(printed.reference, abs=5e-4)


def test_default_design_against_python_control(design: ShortPeriod) -> None:
    gains = design_proportional(design)
    matrix = closed_loop(design, gains)
    assert np.sort_complex(np.linalg.eigvals(matrix)) == pytest.approx(np.sort_complex(np.array(default_poles(design))))
    _, b = design.with_actuator()
    loop = control.ss(matrix, gains.reference * b[:, None], [[0.0, 1.0, 0.0]], 0)
    assert float(np.real(control.dcgain(loop))) == pytest.approx(1.0, abs=1e-9)
    assert max(abs(p) for p in default_poles(design)) < design.actuator_rad_s


def test_integral_design_places_all_four_poles_and_removes_the_steady_error(design: ShortPeriod) -> None:
    gains = design_integral(design, integral_pole=-0.7)
    wanted = np.sort_complex(np.array([*default_poles(design), -0.7]))
    assert np.sort_complex(np.linalg.eigvals(closed_loop(design, gains))) == pytest.approx(wanted)
    # With K = 0.6 the prefilter alone would leave an error; the integral takes it away.
    A = closed_loop(design, gains, effectiveness=0.6)
    b = np.array([0.0, 0.0, design.actuator_rad_s * gains.reference, 1.0])
    steady = -np.linalg.solve(A, b)
    assert steady[1] == pytest.approx(1.0)


def test_exact_correction_restores_the_loop_in_effective_deflection(design: ShortPeriod) -> None:
    """With K-hat = K and K-hat times the position fed back, K times the deflection obeys the healthy loop."""
    gains, K = design_proportional(design), 0.3
    A, b = design.with_actuator(K)
    feedback = np.array([gains.alpha, gains.q, gains.elevator * K]) / K
    corrected = np.linalg.eigvals(A + np.outer(b, feedback))
    assert np.sort_complex(corrected) == pytest.approx(np.sort_complex(np.array(default_poles(design))))


@pytest.mark.parametrize("poles", [(-1.0, -5 + 3j, -5 - 3j), (-0.2, -12.0, -40.0)])
def test_placement_equals_scipys(design: ShortPeriod, poles: tuple[complex, ...]) -> None:
    A, b = design.with_actuator()
    theirs = -place_poles(A, b[:, None], np.array(poles)).gain_matrix[0]
    ours = design_proportional(design, poles)
    assert [ours.alpha, ours.q, ours.elevator] == pytest.approx(theirs, rel=1e-9)


def test_correction_on_the_summed_command_restores_the_poles_when_position_is_not_fed_back(design: ShortPeriod) -> None:
    """Sillence's Figure 1: with no gain on the elevator's position, K times 1/K drops out of the loop."""
    A, _ = design.with_actuator()
    slow = -1.5
    real = (np.trace(A) - slow) / 2  # the open-loop trace: the elevator gain is then zero
    gains = design_proportional(design, [slow, complex(real, 5), complex(real, -5)])
    assert gains.elevator == pytest.approx(0.0, abs=1e-9)
    healthy = np.linalg.eigvals(closed_loop(design, gains))
    corrected = np.linalg.eigvals(closed_loop(design, gains, effectiveness=0.3, correction=1 / 0.3))
    fixed = np.linalg.eigvals(closed_loop(design, gains, effectiveness=0.3))
    assert np.sort_complex(corrected) == pytest.approx(np.sort_complex(healthy))
    assert not np.allclose(np.sort_complex(fixed), np.sort_complex(healthy), atol=0.1)


def test_the_integrators_eigenvalue_that_table_2_prints_as_0() -> None:
    found = np.linalg.eigvals(closed_loop(_plant(), _gains(integral=True)))
    assert max(found.real) == pytest.approx(-1.0e-4, abs=0.05e-4)


def test_unreachable_poles_are_a_design_error() -> None:
    dead = ShortPeriod(np.array([[-1.0, 1.0], [2.0, -1.0]]), np.zeros(2), 20.0)
    with pytest.raises(DesignError, match="does not control"):
        design_proportional(dead)
    with pytest.raises(DesignError, match="conjugate pairs"):
        design_proportional(_plant(), [-1.0, -2 + 1j, -3 + 1j])
    with pytest.raises(DesignError, match="3 states, 2 poles are given"):
        design_proportional(_plant(), [-1.0, -2.0])


@pytest.mark.parametrize("integral", [0.0, -2.5])
@pytest.mark.parametrize(("effectiveness", "correction"), [(1.0, 1.0), (0.3, 1.0), (0.3, 2.5)])
def test_closed_loop_equals_the_loop_that_python_control_closes(
    design: ShortPeriod, integral: float, effectiveness: float, correction: float
) -> None:
    """Blocks wired by name: actuator, airframe, sum of gains, integral of r - q; poles, and the response from r to q."""
    gains = Gains(0.3, 0.8, -0.3, -0.9, integral)
    A, b = design.with_actuator(effectiveness)
    loop = closed_loop(design, gains, effectiveness=effectiveness, correction=correction)
    airframe = control.ss(
        A[:2, :2], effectiveness * design.b[:, None], np.eye(2), 0, inputs="d", outputs=["a", "q"], name="airframe"
    )
    actuator = control.tf([b[2]], [1.0, b[2]], inputs="c", outputs="d", name="actuator")
    law = control.ss(
        [], [], [], correction * np.array([[gains.reference, gains.alpha, gains.q, gains.elevator, integral]]),
        inputs=["r", "a", "q", "d", "i"], outputs="c", name="law",
    )  # fmt: skip
    error = control.ss([], [], [], [[1.0, -1.0]], inputs=["r", "q"], outputs="e", name="error")
    integrator = control.tf([1.0], [1.0, 0.0], inputs="e", outputs="i", name="integrator")
    wired = control.interconnect(
        [airframe, actuator, law, error, integrator], inputs="r", outputs="q", check_unused=False
    )
    poles = np.linalg.eigvals(loop) if integral else [*np.linalg.eigvals(loop), 0.0]  # theirs integrates all the same
    assert np.sort_complex(np.array(poles, dtype=complex)) == pytest.approx(np.sort_complex(wired.poles()), abs=1e-8)
    n = len(loop)
    input_ = np.array([0.0, 0.0, correction * gains.reference * b[2], 1.0])[:n, None]
    ours = control.ss(loop, input_, np.eye(n)[1:2], 0)
    frequencies = [0.1, 1.0, 10.0, 100.0]
    assert ours(1j * np.array(frequencies)) == pytest.approx(wired(1j * np.array(frequencies)), rel=1e-8)


@pytest.mark.parametrize("feedback", [(0.283, 0.876, -0.4), (0.5, 1.2, 0.0), (1.0, 0.1, -2.0)])
def test_reference_gain_is_one_over_python_controls_dc_gain(design: ShortPeriod, feedback: tuple[float, ...]) -> None:
    A, b = design.with_actuator()
    loop = control.feedback(control.ss(A, b[:, None], np.eye(3), 0), control.ss([], [], [], [feedback]), sign=1)
    dc = float(np.real(control.dcgain(loop)[1, 0]))
    assert reference_gain(design, feedback) == pytest.approx(1.0 / dc, rel=1e-9)


def test_an_elevator_without_a_steady_pitch_rate_has_no_reference_gain() -> None:
    """M_alpha Z_delta = Z_alpha M_delta: the steady pitch rate of a deflection is nil."""
    design = ShortPeriod(np.array([[-1.0, 1.0], [-2.0, -1.0]]), np.array([-3.0, -6.0]), 20.0)
    dead = ShortPeriod(design.A, np.array([3.0, 6.0]), 20.0)
    for model in (design, dead):
        with pytest.raises(DesignError, match="no steady effect on pitch rate"):
            reference_gain(model, (0.1, 0.1, 0.0))
