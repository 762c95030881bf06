"""Trim and short-period model: against JSBSim's own trim and linearizer, and against recorded values."""

from __future__ import annotations

import csv
from pathlib import Path

import jsbsim
import numpy as np
import pytest

from flightbed.aircraft.overlay import Aircraft
from flightbed.avionics.short_period import ShortPeriod, zero_order_hold
from flightbed.core.errors import NoTrimError
from flightbed.core.units import DEG, FT
from flightbed.fdm.jsbsim import Fdm
from flightbed.models.linearize import LinearModel, linearize
from flightbed.models.reduce import short_period
from flightbed.models.trim import TrimPoint, trim
from flightbed.plant.airframe import JsbsimAirframe
from flightbed.plant.base import Controls, Motion

# Level, away from the flap switches at alpha 5 and 15 deg and Mach 0.9, and from breakpoints: Mach 0.6, 0.7, 0.8, 0.9,
# alpha 0 and 10.03 deg, and the engine's altitudes, whole 10,000 ft.
CONDITIONS = [
    (0.32, 500), (0.41, 500), (0.50, 500), (0.62, 500), (0.75, 500), (0.85, 500),
    (0.37, 10500), (0.50, 10500), (0.62, 10500), (0.72, 10500), (0.78, 10500), (0.85, 10500),
    (0.41, 20500), (0.50, 20500), (0.62, 20500), (0.72, 20500), (0.78, 20500), (0.82, 20500), (0.85, 20500), (0.95, 20500),
    (0.47, 30500), (0.50, 30500), (0.62, 30500), (0.72, 30500), (0.78, 30500), (0.82, 30500), (0.85, 30500),
    (0.62, 39500), (0.72, 39500), (0.78, 39500), (0.85, 39500),
]  # fmt: skip


def _model(aircraft: Aircraft, mach: float, altitude_ft: float) -> tuple[TrimPoint, LinearModel]:
    airframe = JsbsimAirframe(aircraft, mach=mach, altitude_m=altitude_ft * FT)
    point = trim(airframe)
    return point, linearize(airframe, point)


def _fdm(aircraft: Aircraft, mach: float, altitude_ft: float) -> jsbsim.FGFDMExec:
    """Return an FDM at a condition, without the lag of the elevator actuator.

    With the lag in, FGLinearization's alpha row of B is wrong: it reads alpha-dot one frame late.
    """
    wrapper = Fdm(aircraft, 0.005)
    wrapper.configure(altitude_m=altitude_ft * FT, cg_shift_cbar=0.0)
    wrapper.exec["fcs/elevator-lag-rad_s"] = 1e9
    wrapper.exec["ic/mach"] = mach
    wrapper.exec.run_ic()
    return wrapper.exec


@pytest.mark.parametrize(("mach", "altitude_ft"), CONDITIONS)
def test_trim_against_jsbsims_own(f16: Aircraft, mach: float, altitude_ft: float) -> None:
    point, _ = _model(f16, mach, altitude_ft)
    fdm = _fdm(f16, mach, altitude_ft)
    fdm.do_trim(jsbsim.TrimMode.LONGITUDINAL)
    assert point.residual < 1e-8
    # JSBSim stops trimming at 1e-3 ft/s^2: a few thousandths of a degree.
    assert point.alpha_rad == pytest.approx(fdm["aero/alpha-rad"], abs=3e-3 * DEG)
    assert point.elevator_rad == pytest.approx(fdm["fcs/elevator-pos-rad"], abs=3e-3 * DEG)
    assert point.throttle_norm == pytest.approx(fdm["fcs/throttle-cmd-norm"], abs=1e-4)


@pytest.mark.parametrize(("mach", "altitude_ft"), CONDITIONS)
def test_model_against_jsbsims_own_linearizer(f16: Aircraft, mach: float, altitude_ft: float) -> None:
    """All of A and B within 1e-4, relative to the size of an entry's row and column: ten states, four inputs."""
    point, model = _model(f16, mach, altitude_ft)
    assert model.step_error < 1e-6
    fdm = _fdm(f16, mach, altitude_ft)
    fdm["ic/alpha-rad"], fdm["ic/gamma-rad"] = point.alpha_rad, 0.0
    fdm["fcs/elevator-cmd-norm"] = point.elevator_rad / f16.actuator.max_rad
    fdm["fcs/throttle-cmd-norm"] = point.throttle_norm
    fdm["fcs/lateral-direct"] = 1.0
    fdm["propulsion/set-running"] = -1
    fdm.set_trim_status(True)
    fdm.run_ic()
    fdm.set_trim_status(False)
    own = jsbsim.FGLinearization(fdm)
    states, inputs = list(own.x_names), list(own.u_names)
    rows = [states.index(name) for name in ("Vt", "Alpha", "Theta", "Q", "Alt", "Beta", "Phi", "P", "R", "Psi")]
    columns = [inputs.index(name) for name in ("DeCmd", "ThtlCmd")]
    si = np.array([FT, 1.0, 1.0, 1.0, FT, *[1.0] * 5])  # JSBSim's speed and altitude are in ft
    A = np.array(own.system_matrix)[np.ix_(rows, rows)] * si[:, None] / si
    B = np.array(own.input_matrix)[np.ix_(rows, columns)] * si[:, None]
    B[:, 0] /= f16.actuator.max_rad  # per rad: full command is the stop
    # Effect of typical motions (5 m/s, 0.02 rad, 0.02 rad, 0.05 rad/s, 100 m; 0.02 rad, 0.05 throttle) on each rate.
    x, u = np.array([5.0, 0.02, 0.02, 0.05, 100.0, 0.02, 0.02, 0.05, 0.05, 0.02]), np.array([0.02, 0.05])
    size = np.max(np.abs(np.hstack([A * x, B * u])), axis=1, keepdims=True) + 1e-12
    np.testing.assert_array_less(np.abs(model.A - A) * x / size, 1e-4)
    np.testing.assert_array_less(np.abs(model.B[:, :2] - B) * u / size, 1e-4)
    # The short period entry by entry.
    short = np.ix_([1, 3], [1, 3])
    np.testing.assert_allclose(model.A[short], A[short], rtol=1e-4, atol=1e-5)
    np.testing.assert_allclose(model.B[[1, 3], 0], B[[1, 3], 0], rtol=1e-4)


@pytest.mark.parametrize(("mach", "altitude_ft"), [(0.5, 10500), (0.78, 20500), (0.85, 30500)])
def test_model_against_a_least_squares_fit(
    rng: np.random.Generator, f16: Aircraft, mach: float, altitude_ft: float
) -> None:
    """An independent method: linear regression over 120 random small motions about the trim point."""
    airframe = JsbsimAirframe(f16, mach=mach, altitude_m=altitude_ft * FT)
    point = trim(airframe)
    model = linearize(airframe, point)
    size = np.array([0.015, 3e-5, 3e-5, 3e-5, 0.6, *[3e-5] * 9])  # small: products of two offsets are noise here
    offsets = size * rng.uniform(-1, 1, (120, 14))
    here = np.array([*point.motion, *point.controls])
    rates = [airframe.respond(Motion(*x[:10]), Controls(*x[10:])).rates for x in here + offsets]
    fit, *_ = np.linalg.lstsq(np.column_stack([offsets / size, np.ones(120)]), np.array(rates), rcond=None)
    J = np.hstack([model.A, model.B]) * size
    np.testing.assert_allclose(fit[:14].T, J, rtol=0, atol=1e-4 * float(np.max(np.abs(J))))
    for block in (slice(0, 5), slice(5, 10)):  # longitudinal and lateral separately
        np.testing.assert_allclose(fit[:14].T[block], J[block], rtol=0, atol=3e-4 * float(np.max(np.abs(J[block]))))


def _envelope() -> list[dict[str, float]]:
    path = Path(__file__).parents[1] / "golden" / "envelope.csv"
    lines = [line for line in path.read_text().splitlines() if not line.startswith("#")]
    return [{key: float(value) for key, value in row.items()} for row in csv.DictReader(lines)]


def test_against_the_recorded_envelope(f16: Aircraft) -> None:
    """94 points, sea level to 40,000 ft, trim to 1e-5 deg and derivatives to 0.01 %."""
    rows = _envelope()
    assert len(rows) == 94
    for row in rows:
        point, model = _model(f16, row["mach"], row["h_ft"])
        where = f"Mach {row['mach']}, {row['h_ft']} ft"
        assert point.alpha_rad / DEG == pytest.approx(row["alpha_deg"], abs=1e-5), where
        assert point.elevator_rad / DEG == pytest.approx(row["elev_deg"], abs=1e-5), where
        assert point.throttle_norm == pytest.approx(row["thr_norm"], abs=1e-6), where
        sp = short_period(model, actuator_rad_s=20.2)
        found = [*sp.A.ravel(), *sp.b]
        assert found == pytest.approx([row[k] for k in ("Za", "Zq", "Ma", "Mq", "Zd", "Md")], rel=1e-4, abs=1e-6), where


def test_the_main_condition_is_open_loop_unstable(f16: Aircraft, design: ShortPeriod) -> None:
    assert max(p.real for p in design.poles) == pytest.approx(0.44, abs=0.005)
    _, model = _model(f16, 0.8, 20000)
    system = model.to_control()
    assert system.state_labels == [*["airspeed", "alpha", "theta", "q", "altitude", "beta", "phi", "p", "r", "psi"]]
    assert system.input_labels == ["elevator", "throttle", "aileron", "rudder"]
    assert np.sort_complex(system.poles()) == pytest.approx(np.sort_complex(model.eigenvalues()))


def test_linear_model_predicts_a_small_motion(f16: Aircraft) -> None:
    """Rates at a point near trim: the model's error decreases with the square of the distance."""
    airframe = JsbsimAirframe(f16, mach=0.66, altitude_m=6200.0)  # away from the breakpoints of the tables
    point = trim(airframe)
    model = linearize(airframe, point)
    errors = []
    for size in (1.0, 0.5):
        dx = size * np.array([0.5, 0.002, 0.002, 0.002, 5.0, *[0.002] * 5])
        du = size * np.array([0.001, 0.002, 0.001, 0.001])
        moved = airframe.respond(
            type(point.motion)(*(np.array(point.motion) + dx)), type(point.controls)(*(np.array(point.controls) + du))
        )
        errors.append(np.abs(np.array(moved.rates) - model.A @ dx - model.B @ du).max())
    assert errors[1] < 0.35 * errors[0]


def test_zero_order_hold_against_python_control(design: ShortPeriod) -> None:
    import control

    theirs = control.c2d(control.ss(design.A, design.b[:, None], np.eye(2), 0), 0.01, method="zoh")
    A, b = zero_order_hold(design.A, design.b, 0.01)
    np.testing.assert_allclose(A, theirs.A, rtol=0, atol=1e-14)
    np.testing.assert_allclose(b, theirs.B[:, 0], rtol=0, atol=1e-14)


@pytest.mark.parametrize(
    ("mach", "altitude_ft", "binding", "equation"),
    [(0.30, 40000, "alpha max", "lift"), (1.5, 0, "throttle max", "speed")],
)
def test_no_trim_says_why(f16: Aircraft, mach: float, altitude_ft: float, binding: str, equation: str) -> None:
    with pytest.raises(NoTrimError, match=f"residual .* in {equation}") as caught:
        trim(JsbsimAirframe(f16, mach=mach, altitude_m=altitude_ft * FT))
    assert binding in caught.value.binding
    assert binding in str(caught.value)
    assert abs(caught.value.residual[equation]) == max(map(abs, caught.value.residual.values())) > 0.01
    assert caught.value.exit_code == 3


def test_a_trim_beyond_a_limit_reports_the_value_needed(f16: Aircraft) -> None:
    """Level flight at Mach 0.35, 40,000 ft needs 27.3 deg: with a limit of 25 deg the message says so."""
    airframe = JsbsimAirframe(f16, mach=0.35, altitude_m=40000 * FT)
    assert trim(airframe).alpha_rad / DEG == pytest.approx(27.3, abs=0.05)
    airframe.alpha_limits_rad = (-10 * DEG, 25 * DEG)
    with pytest.raises(NoTrimError, match=r"needs alpha 27\.3 deg, limit is 25\.0 deg"):
        trim(airframe)


def test_climbing_trim_points_the_flight_path_up(f16: Aircraft) -> None:
    airframe = JsbsimAirframe(f16, mach=0.6, altitude_m=6096.0)
    level, climb = trim(airframe), trim(airframe, gamma_rad=5 * DEG)
    assert climb.theta_rad - climb.alpha_rad == pytest.approx(5 * DEG)
    assert climb.throttle_norm > level.throttle_norm
    assert climb.residual < 1e-8
