"""The JSBSim plant: JSBSim's pitfalls listed in its module, repeatability, steady trimmed flight."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from flightbed.aircraft.overlay import Aircraft
from flightbed.core.errors import AircraftError
from flightbed.core.signals import HEALTHY, Health
from flightbed.core.units import DEG, FT, G0, LBF
from flightbed.fdm.jsbsim import Fdm
from flightbed.models.linearize import linearize
from flightbed.models.reduce import short_period
from flightbed.models.trim import TrimPoint, trim
from flightbed.plant.airframe import JsbsimAirframe
from flightbed.plant.base import Controls, Motion
from flightbed.plant.gusts import calm, one_minus_cosine
from flightbed.plant.linear import LinearPlant
from flightbed.plant.nonlinear import JsbsimPlant, Start

ALTITUDE = 20000 * FT


@pytest.fixture(scope="module")
def point(f16: Aircraft) -> TrimPoint:
    return trim(JsbsimAirframe(f16, mach=0.8, altitude_m=ALTITUDE))


def _start(point: TrimPoint, altitude_m: float = ALTITUDE) -> Start:
    return Start(
        altitude_m, point.airspeed_m_s, point.alpha_rad, point.theta_rad, point.elevator_rad, point.throttle_norm
    )


def _plant(aircraft: Aircraft, point: TrimPoint, *, plant_hz: int = 200, **options: object) -> JsbsimPlant:
    return JsbsimPlant(aircraft, _start(point), control_hz=100, plant_hz=plant_hz, **options)  # type: ignore[arg-type]


@pytest.mark.parametrize("plant_hz", [100, 200, 400])
def test_actuator_has_the_lag_and_rate_of_the_overlay_at_every_step(
    f16: Aircraft, point: TrimPoint, plant_hz: int
) -> None:
    """JSBSim copies dt at load: set later, the rate limit would be wrong by the ratio of the steps."""
    plant = _plant(f16, point, plant_hz=plant_hz)
    positions = [plant.sense().elevator_rad]
    for _ in range(60):
        plant.advance(point.elevator_rad + 20 * DEG, HEALTHY, HEALTHY)
        positions.append(plant.sense().elevator_rad)
    rates = np.diff(positions) * 100 / DEG
    assert rates.max() == pytest.approx(60.0, rel=1e-6)
    small = _plant(f16, point, plant_hz=plant_hz)
    for _ in range(5):
        small.advance(point.elevator_rad + 0.2 * DEG, HEALTHY, HEALTHY)
    reached = (small.sense().elevator_rad - point.elevator_rad) / (0.2 * DEG)
    # First order, half a frame late: Tustin's rule averages the step with the frame before it.
    assert reached == pytest.approx(1.0 - np.exp(-20.2 * (0.05 - 0.5 / plant_hz)), abs=0.001)


def test_commands_beyond_the_stop_do_not_wind_up(f16: Aircraft, point: TrimPoint) -> None:
    """JSBSim's rate limiter winds up beyond the stop; the plant's clamp prevents it."""
    plant = _plant(f16, point)
    for _ in range(150):
        plant.advance(3.0, HEALTHY, HEALTHY)
    assert plant.sense().elevator_rad == pytest.approx(25 * DEG)
    plant.advance(0.0, HEALTHY, HEALTHY)
    plant.advance(0.0, HEALTHY, HEALTHY)
    assert plant.sense().elevator_rad < 24.5 * DEG


def test_one_settling_is_exact(f16: Aircraft) -> None:
    """Hidden states settle at once: the same point evaluated after any other gives the same bits."""
    airframe = JsbsimAirframe(f16, mach=0.6, altitude_m=ALTITUDE)
    v = airframe.airspeed_m_s
    here = (Motion(v, 0.05, 0.05, 0.01, ALTITUDE), Controls(-0.02, 0.3))
    first = airframe.respond(*here).rates
    airframe.respond(Motion(v, 0.2, 0.1, -0.1, ALTITUDE), Controls(0.3, 0.9))
    again = airframe.respond(*here).rates
    # The IC object keeps a wind of round-off size between calls: equal to 1e-12, not bit for bit.
    assert again == pytest.approx(first, rel=1e-11, abs=1e-13)
    moved = airframe.respond(here[0], Controls(-0.02 + 1 * DEG, 0.3)).rates
    assert (moved.q - first.q) / DEG == pytest.approx(-7.9, abs=0.3)  # the full M_delta, without lag


def test_engine_runs_from_the_first_step(f16: Aircraft, point: TrimPoint) -> None:
    """At trim with fixed controls, speed, altitude and load factor are constant."""
    plant = _plant(f16, point)
    start = plant.sense()
    # Not 1: at the equator and 20,000 ft gravity is 0.9954 standard g, and the curvature of the path takes a further 0.1 %.
    assert start.nz_g == pytest.approx(1.0, abs=0.006)
    for _ in range(100):
        plant.advance(point.elevator_rad, HEALTHY, HEALTHY)
    now = plant.sense()
    assert now.airspeed_m_s == pytest.approx(start.airspeed_m_s, abs=0.02)
    assert now.altitude_m == pytest.approx(start.altitude_m, abs=0.1)
    assert now.nz_g == pytest.approx(start.nz_g, abs=0.002)
    assert now.alpha_rad == pytest.approx(start.alpha_rad, abs=0.01 * DEG)
    assert np.hypot(now.north_m, now.east_m) == pytest.approx(start.airspeed_m_s, rel=0.01)


def test_sea_level_is_free_air(f16: Aircraft) -> None:
    assert trim(JsbsimAirframe(f16, mach=0.5, altitude_m=0.0)).residual < 1e-8


def test_missing_and_read_only_properties_are_refused(f16: Aircraft) -> None:
    fdm = Fdm(f16, 0.01)
    with pytest.raises(AircraftError, match="no property fcs/elevator-comand-rad"):
        fdm.setter("fcs/elevator-comand-rad")
    with pytest.raises(AircraftError, match="accelerations/Nz is read-only"):
        fdm.setter("accelerations/Nz")


def test_loading_is_silent() -> None:
    code = "from flightbed import load_aircraft, JsbsimAirframe; JsbsimAirframe(load_aircraft('f16'), mach=.8, altitude_m=6e3)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == ""
    assert done.stderr == ""


def _fly(plant: JsbsimPlant, point: TrimPoint, ticks: int = 300) -> np.ndarray:
    rows = []
    for k in range(ticks):
        now, following = (HEALTHY if tick < 100 else Health(0.5, 0.5) for tick in (k, k + 1))
        plant.advance(point.elevator_rad + 0.01 * np.sin(0.1 * k), now, following)
        rows.append(plant.sense())
    return np.array(rows)


@pytest.mark.parametrize("turbulence", ["none", "moderate"])
def test_repeat_flights_are_bit_identical(f16: Aircraft, point: TrimPoint, turbulence: str) -> None:
    """Each flight has a fresh FDM, whether or not another one exists."""
    one = _fly(_plant(f16, point, turbulence=turbulence, seed=5), point)
    keep_alive = _plant(f16, point)
    two = _fly(_plant(f16, point, turbulence=turbulence, seed=5), point)
    assert one.tobytes() == two.tobytes()
    assert keep_alive.sense().elevator_rad == point.elevator_rad


def test_turbulence_is_finite_seeded_and_grows_with_severity(f16: Aircraft, point: TrimPoint) -> None:
    spread = {}
    for severity in ("none", "light", "moderate", "severe"):
        flown = _fly(_plant(f16, point, turbulence=severity, seed=5), point)
        assert np.all(np.isfinite(flown))
        spread[severity] = np.std(np.diff(flown[:, 0]))  # alpha, tick to tick
    assert spread["none"] < spread["light"] < spread["moderate"] < spread["severe"]
    other = _fly(_plant(f16, point, turbulence="light", seed=6), point)
    same = _fly(_plant(f16, point, turbulence="light", seed=5), point)
    assert not np.array_equal(other, same)


def test_mean_deflection_is_what_moved_the_aircraft(f16: Aircraft, point: TrimPoint) -> None:
    """Over one tick the pitch rate changes by M_delta times the mean deflection, including the previous frame."""
    plant = _plant(f16, point, plant_hz=400)
    before = plant.sense()
    plant.advance(point.elevator_rad + 2 * DEG, HEALTHY, HEALTHY)
    after = plant.sense()
    mean = after.elevator_mean_rad - point.elevator_rad
    assert 0.0 < mean < after.elevator_rad - point.elevator_rad
    assert (after.q_rad_s - before.q_rad_s) / 0.01 == pytest.approx(-13.81 * mean, rel=0.02)


@pytest.mark.parametrize("plant_hz", [100, 200, 400])
def test_effectiveness_scales_the_moment_of_the_whole_deflection_from_its_tick_on(
    f16: Aircraft, point: TrimPoint, plant_hz: int
) -> None:
    """Held at trim, K = 0.2 from tick 2: at tick 2 nothing has changed; afterwards 80 % of the trim moment is missing."""
    plant = _plant(f16, point, plant_hz=plant_hz)
    healthy, weak = _plant(f16, point, plant_hz=plant_hz), Health(0.2, 0.2)
    for k in range(5):
        if k <= 2:
            assert plant.sense().q_rad_s == healthy.sense().q_rad_s
        plant.advance(point.elevator_rad, weak if k >= 2 else HEALTHY, weak if k >= 1 else HEALTHY)
        healthy.advance(point.elevator_rad, HEALTHY, HEALTHY)
    flown = plant.sense(weak)
    assert (flown.effectiveness, flown.elevator_force) == (0.2, 0.2)
    # q' = -M_delta (1 - K) delta_trim over 30 ms, less 2 % by pitch damping.
    assert (flown.q_rad_s - healthy.sense().q_rad_s) / 0.03 == pytest.approx(13.81 * 0.8 * point.elevator_rad, rel=0.03)


def test_a_failure_from_the_start_acts_from_the_start(f16: Aircraft, point: TrimPoint) -> None:
    weak = Health(0.2, 0.2)
    plant = _plant(f16, point, plant_hz=100, health=weak)
    plant.advance(point.elevator_rad, weak, weak)
    assert plant.sense().q_rad_s / 0.01 == pytest.approx(13.81 * 0.8 * point.elevator_rad, rel=0.03)


@pytest.mark.parametrize("altitude_ft", [0.0, 500.0, 1500.0, 20000.0])
def test_turbulence_is_felt_at_every_altitude(f16: Aircraft, altitude_ft: float) -> None:
    """Below 2000 ft JSBSim also needs the wind at 20 ft: without it there is no turbulence and no warning."""
    low = trim(JsbsimAirframe(f16, mach=0.5, altitude_m=altitude_ft * FT))

    def alpha(severity: str) -> np.ndarray:
        plant = JsbsimPlant(
            f16, _start(low, altitude_ft * FT), control_hz=100, plant_hz=200, turbulence=severity, seed=5
        )
        return _fly(plant, low)[:, 0]

    calm = alpha("none")
    assert 0.02 * DEG < np.std(alpha("light") - calm) < np.std(alpha("severe") - calm)


def _rates(airframe: JsbsimAirframe, point: TrimPoint) -> tuple[float, float]:
    """Return (alpha', q') at the trim point."""
    motion = Motion(point.airspeed_m_s, point.alpha_rad, point.theta_rad, 0.0, ALTITUDE)
    rates = airframe.respond(motion, point.controls).rates
    return rates.alpha, rates.q


def test_a_cg_shift_in_flight_is_the_shift_of_the_airframe(f16: Aircraft, point: TrimPoint) -> None:
    """From the first tick the flight equals, bit for bit, that of the aircraft configured with this shift; the trim excludes it."""
    shifted = Health(cg_shift_cbar=0.05)
    configured, failed = _plant(f16, point, cg_shift_cbar=0.05), _plant(f16, point, health=shifted)
    for _ in range(200):
        configured.advance(point.elevator_rad, HEALTHY, HEALTHY)
        failed.advance(point.elevator_rad, shifted, shifted)
        assert configured.sense() == failed.sense()
    assert failed.sense(shifted).cg_shift_cbar == 0.05
    assert (
        abs(failed.sense().alpha_rad - point.alpha_rad) > 5 * DEG
    )  # the motion is large, so the comparison is meaningful


@pytest.mark.parametrize("plant_hz", [100, 200, 400])
@pytest.mark.parametrize("health", [Health(cg_shift_cbar=0.05), Health(cg_shift_cbar=-0.02), Health(0.4, 0.8, 0.03)])
def test_damage_acts_exactly_at_its_tick(f16: Aircraft, point: TrimPoint, plant_hz: int, health: Health) -> None:
    """At its tick nothing has changed; one tick later q has the rate of the airframe with the permanent damage at this point."""
    plant, healthy = _plant(f16, point, plant_hz=plant_hz), _plant(f16, point, plant_hz=plant_hz)
    for k in range(3):
        assert plant.sense().q_rad_s == healthy.sense().q_rad_s
        plant.advance(point.elevator_rad, health if k >= 2 else HEALTHY, health if k >= 1 else HEALTHY)
        healthy.advance(point.elevator_rad, HEALTHY, HEALTHY)
    airframe = JsbsimAirframe(f16, mach=0.8, altitude_m=ALTITUDE, cg_shift_cbar=health.cg_shift_cbar)
    airframe._fdm.set(f16.properties["effectiveness"], health.effectiveness)
    airframe._fdm.set(f16.properties["elevator_force"], health.elevator_force)
    rate = (plant.sense().q_rad_s - healthy.sense().q_rad_s) * 100
    # Damping reduces q by up to M_q dt / 2, half a percent.
    assert rate == pytest.approx(_rates(airframe, point)[1], rel=0.006)
    truth = plant.sense(health)
    assert (truth.effectiveness, truth.elevator_force, truth.cg_shift_cbar) == health[:3]
    assert (truth.gust_up_m_s, truth.elevator_offset_rad) == (0.0, 0.0)


def test_a_cg_shift_can_be_taken_back(f16: Aircraft, point: TrimPoint) -> None:
    """A shift in flight is relative to the c.g. at take-off, whatever the configured shift."""
    plant, never = (_plant(f16, point, cg_shift_cbar=0.013) for _ in range(2))
    plant.advance(point.elevator_rad, HEALTHY, HEALTHY)
    plant._set_health(Health(cg_shift_cbar=0.05))
    never.advance(point.elevator_rad, HEALTHY, HEALTHY)
    for _ in range(50):
        plant.advance(point.elevator_rad, HEALTHY, HEALTHY)
        never.advance(point.elevator_rad, HEALTHY, HEALTHY)
    assert plant.sense() == never.sense()


def test_gusts_do_not_enter_the_trim_and_are_in_the_truth(f16: Aircraft, point: TrimPoint) -> None:
    """JSBSim keeps the gust during run_ic, so the plant writes it only in flight."""
    gusts = one_minus_cosine(calm, at_s=0.0, up_m_s=10 * FT, rise_s=0.05, hold_s=1.0)
    plant, still = _plant(f16, point, gusts=gusts), _plant(f16, point)
    assert plant.sense() == still.sense()
    gust_down_fps = plant._fdm.getter("atmosphere/gust-down-fps")
    for k in range(1, 20):
        plant.advance(point.elevator_rad, HEALTHY, HEALTHY)
        assert plant.sense().gust_up_m_s == pytest.approx(gusts(k / 100), abs=1e-12)
        assert gust_down_fps() * FT == pytest.approx(-gusts(k / 100), abs=1e-12)


@pytest.mark.parametrize("mach", [0.6, 0.7, 0.8])
@pytest.mark.parametrize("plant_hz", [100, 200, 400])
def test_gusts_move_the_aircraft_as_the_linear_model_says(f16: Aircraft, mach: float, plant_hz: int) -> None:
    """A gust of 0.2 ft/s agrees with the linear plant. The remaining error is one frame of delay: 1.5 % of q at 100 Hz, half at 200, ...

    and 0.1 % that speed and attitude, which the short period does not have, take.
    """
    airframe = JsbsimAirframe(f16, mach=mach, altitude_m=ALTITUDE)
    here = trim(airframe)
    design = short_period(linearize(airframe, here), actuator_rad_s=f16.actuator.lag_rad_s)
    for up in (0.2 * FT, -0.2 * FT):
        gusts = one_minus_cosine(calm, at_s=0.1, up_m_s=up, rise_s=0.05, hold_s=9.0)
        plant, still = (_plant(f16, here, plant_hz=plant_hz, gusts=air) for air in (gusts, calm))
        linear = LinearPlant(design, control_hz=100, airspeed_m_s=here.airspeed_m_s, gusts=gusts)
        flown, expected = [], []
        for _ in range(60):
            for each in (plant, still, linear):
                each.advance(here.elevator_rad, HEALTHY, HEALTHY)
            gusty, calmly, model = plant.sense(), still.sense(), linear.sense()
            flown.append((gusty.alpha_rad - calmly.alpha_rad, gusty.q_rad_s - calmly.q_rad_s))
            expected.append((model.alpha_rad - design.alpha_trim_rad, model.q_rad_s))
        error = np.abs(np.subtract(flown, expected)).max(axis=0) / np.abs(expected).max(axis=0)
        assert error[0] < 0.006 * 100 / plant_hz
        assert error[1] < 0.001 + 0.015 * 100 / plant_hz
        # The initial response, from the peak at 0.15 s on: alpha' = Z_alpha w/V, q' = M_alpha w/V.
        alpha_rate, q_rate = (np.array(flown[17]) - flown[15]) / 0.02
        wind = up / here.airspeed_m_s
        assert alpha_rate == pytest.approx(design.A[0, 0] * wind, rel=0.15)
        assert q_rate == pytest.approx(design.A[1, 0] * wind, rel=0.15)


def test_forces_are_those_that_accelerate_the_aircraft(f16: Aircraft, point: TrimPoint) -> None:
    """Load factor and speed, which JSBSim computes independently, follow from lift, drag and thrust by Newton's law."""
    plant = _plant(f16, point, plant_hz=100)
    weight_n = plant._fdm.getter("inertia/weight-lbs")() * LBF
    flown = [plant.sense()]
    for k in range(80):
        plant.advance(point.elevator_rad - (3.0 * DEG if k < 60 else 0.0), HEALTHY, HEALTHY)
        flown.append(plant.sense())
    # JSBSim computes the load factor in the frame after the forces.
    normal = np.array([t.lift_n * np.cos(t.alpha_rad) + t.drag_n * np.sin(t.alpha_rad) for t in flown[:-1]])
    nz = np.array([t.nz_g for t in flown[1:]])
    assert nz.max() > 2.0 * nz[0]
    np.testing.assert_allclose(normal / weight_n, nz, rtol=2e-4)  # tolerance for the fuel burnt
    along = [
        (t.thrust_n * np.cos(t.alpha_rad) - t.drag_n) / weight_n - np.sin(t.theta_rad - t.alpha_rad) for t in flown
    ]
    slowed = np.diff([t.airspeed_m_s for t in flown])
    np.testing.assert_allclose(np.cumsum(slowed)[20:], np.cumsum(along)[20:-1] * G0 * 0.01, rtol=0.03, atol=0.02)
