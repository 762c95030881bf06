"""The schedule against its aircraft and against the linear model, and its cache."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from flightbed.aircraft.overlay import Aircraft
from flightbed.avionics import pitch_kernels
from flightbed.avionics.schedule import Schedule
from flightbed.avionics.short_period import ShortPeriod, zero_order_hold
from flightbed.core.atmosphere import air, standard_air
from flightbed.core.units import DEG, FT
from flightbed.models.tabulate import build_schedule, load_schedule
from flightbed.models.trim import trim
from flightbed.plant.airframe import JsbsimAirframe
from flightbed.plant.base import Controls, Motion
from flightbed.runs.run import run
from flightbed.scenario.reading import load_scenario

THROTTLE = 0.34


@pytest.fixture(scope="module")
def airframe(f16: Aircraft) -> JsbsimAirframe:
    return JsbsimAirframe(f16, mach=0.8, altitude_m=20000 * FT)


@pytest.fixture(scope="module")
def schedule(airframe: JsbsimAirframe) -> Schedule:
    return build_schedule(airframe, throttle=THROTTLE)


def test_air_is_the_standard_atmosphere() -> None:
    """ISO 2533 at 0, 11,000 and 15,000 geopotential m; the compiled copy agrees."""
    for height, pressure, sound in (
        (0.0, 101325.0, 340.294),
        (11000.0, 22632.06, 295.069),
        (15000.0, 12044.6, 295.069),
    ):
        geometric = 6356766.0 * height / (6356766.0 - height)
        expected = standard_air(geometric)
        assert expected.pressure_pa == pytest.approx(pressure, rel=2e-5)
        assert expected.sound_m_s == pytest.approx(sound, rel=1e-5)
        assert air(geometric) == pytest.approx((expected.pressure_pa, expected.sound_m_s), rel=1e-12)


def test_residual_map_against_the_aircraft(rng: np.random.Generator, schedule: Schedule, f16: Aircraft) -> None:
    """600 random motions at altitudes other than the tabulated one; alpha' and q' of JSBSim's own equations of motion."""
    packed, out = schedule.packed(), np.zeros((2, 4))
    wrong = []
    for altitude in (3000.0, 9000.0):
        other = JsbsimAirframe(f16, mach=0.7, altitude_m=altitude)
        sound = other.airspeed_m_s / other.mach
        for _ in range(300):
            mach, alpha, q, d = rng.uniform(0.5, 1.1), rng.uniform(-5, 20), rng.uniform(-20, 20), rng.uniform(-20, 20)
            theta, phi = rng.uniform(-0.5, 0.5, 2)
            motion = Motion(mach * sound, alpha * DEG, theta, q * DEG, altitude, phi_rad=phi)
            rates = other.respond(motion, Controls(d * DEG, THROTTLE)).rates
            pitch_kernels.rates(packed, out, alpha * DEG, q * DEG, d * DEG, mach, altitude, theta, phi)
            wrong.append([abs(rates.alpha - out[0, 0]) / DEG, abs(rates.q - out[1, 0]) / DEG])
    median, worst = np.median(wrong, axis=0), np.max(wrong, axis=0)
    assert median[0] < 0.02  # deg/s
    assert median[1] < 0.05  # deg/s^2; a lost tenth of the trim deflection makes 1.4
    assert worst[0] < 0.3
    assert worst[1] < 2.0
    assert schedule.packed().nbytes < 300_000


def test_at_trim_it_is_the_short_period_model(airframe: JsbsimAirframe, design: ShortPeriod) -> None:
    """The compiled local model against linearize() and scipy's matrix exponential, an independent derivation."""
    point = trim(airframe)
    packed = build_schedule(airframe, throttle=point.throttle_norm).packed()
    model = np.zeros((2, 4))
    damping = pitch_kernels.local_model(
        packed,
        model,
        np.empty((2, 4)),
        1.0,
        0.01,
        point.alpha_rad,
        0.0,
        point.elevator_rad,
        0.8,
        20000 * FT,
        point.theta_rad,
        0.0,
        0.0,
    )
    held = zero_order_hold(design.A, design.b, 0.01)
    assert model[:, :2] == pytest.approx(held.A, rel=0.02, abs=8e-4)  # M_alpha to 0.08 1/s^2
    assert model[1, 2] == pytest.approx(held.b[1], rel=0.01)
    assert damping == pytest.approx(design.A[1, 1], rel=0.02)
    x = np.array([point.alpha_rad, 0.0])
    stays = model[:, :2] @ x + model[:, 2] * point.elevator_rad + model[:, 3]
    assert stays == pytest.approx(x, abs=1e-5)  # trim is an equilibrium of the model


def test_half_the_effect_is_half_the_deflection(schedule: Schedule, airframe: JsbsimAirframe) -> None:
    point, one, two = trim(airframe), np.zeros((2, 4)), np.zeros((2, 4))
    where = (0.01, point.alpha_rad, 0.0)
    pitch_kernels.local_model(
        schedule.packed(), one, np.empty((2, 4)), 0.5, *where, 8 * DEG, 0.8, 6096.0, 0.02, 0.0, 0.0
    )
    pitch_kernels.local_model(
        schedule.packed(), two, np.empty((2, 4)), 1.0, *where, 4 * DEG, 0.8, 6096.0, 0.02, 0.0, 0.0
    )
    x = np.array(where[1:])
    acts_one = one[:, :2] @ x + one[:, 2] * 0.5 * 8 * DEG + one[:, 3]
    acts_two = two[:, :2] @ x + two[:, 2] * 4 * DEG + two[:, 3]
    assert acts_one == pytest.approx(acts_two, abs=1e-12)


def test_an_error_of_the_model_is_the_one_that_is_asked_for(schedule: Schedule) -> None:
    right, wrong = np.zeros((2, 4)), np.zeros((2, 4))
    where = (2 * DEG, 3 * DEG, -4 * DEG, 0.8, 6096.0, 0.0, 0.0)
    pitch_kernels.rates(schedule.packed(), right, *where)
    pitch_kernels.rates(schedule.scaled(cm_delta=1.2, cm_q=0.8).packed(), wrong, *where)
    assert wrong[1, 3] == pytest.approx(1.2 * right[1, 3], rel=1e-12)
    assert wrong[1, 2] == pytest.approx(0.8 * right[1, 2], rel=1e-12)
    assert wrong[0] == pytest.approx(right[0], rel=1e-12)
    pitch_kernels.rates(schedule.scaled(cm_alpha=1.2, about_rad=2 * DEG).packed(), wrong, *where)
    assert wrong[1, 0] == pytest.approx(right[1, 0], rel=1e-9)  # about here it is the slope alone that is wrong
    assert wrong[1, 1] != pytest.approx(right[1, 1], rel=0.01)


def test_the_cache_gives_the_same_tables_and_heals(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, airframe: JsbsimAirframe, schedule: Schedule
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    fresh = load_schedule(airframe, throttle=THROTTLE, fingerprint=("a",), standard=lambda: airframe)
    (file,) = (tmp_path / "flightbed").glob("*.npz")
    again = load_schedule(airframe, throttle=THROTTLE, fingerprint=("a",), standard=lambda: airframe)

    def same(found: Schedule) -> bool:  # an FDM that is used again is not bit-identical
        return np.allclose(found.packed(), schedule.packed(), rtol=1e-7, atol=1e-10)

    assert same(fresh)
    assert same(again)
    assert np.array_equal(fresh.coefficients, again.coefficients)
    file.write_bytes(file.read_bytes()[:100])
    assert same(load_schedule(airframe, throttle=THROTTLE, fingerprint=("a",), standard=lambda: airframe))
    load_schedule(airframe, throttle=THROTTLE, fingerprint=("b",), standard=lambda: airframe)
    assert len(list((tmp_path / "flightbed").iterdir())) == 2
    (tmp_path / "no").write_text("a file, not a folder")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "no"))
    assert same(load_schedule(airframe, throttle=THROTTLE, fingerprint=("a",), standard=lambda: airframe))


def test_earlier_flights_do_not_change_a_flight(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The tables that the first flight writes into the cache depend on the aircraft, not on that flight's condition."""
    scenario = load_scenario("elevator-loss", ["duration_s=2", "failures.0.at_s=1"])
    traces = []
    for name, before in (("alone", ()), ("after", ("transonic-loss", "climbing-loss"))):
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / name))
        for other in before:
            run(load_scenario(other, ["duration_s=0.1", "failures.0.at_s=0.05"]))
        traces += [run(scenario).trace, run(scenario).trace]  # without tables in the cache, and with them
    for trace in traces[1:]:
        for column in trace.columns:
            np.testing.assert_array_equal(trace[column], traces[0][column], err_msg=column)
