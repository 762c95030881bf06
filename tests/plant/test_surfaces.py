"""Aileron and rudder of the JSBSim plant, and every kind of actuator fault."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from functools import partial

import numpy as np
import pytest

from flightbed.aircraft.overlay import Aircraft
from flightbed.core.signals import HEALTHY, SURFACES, Health, LateralTruth, Truth
from flightbed.core.units import DEG, FT
from flightbed.failures.base import HealthHistory, healthy
from flightbed.failures.surface import bias, effectiveness_loss, floating, hardover, rate_limited, stuck
from flightbed.fdm.jsbsim import Fdm
from flightbed.models.trim import TrimPoint, trim
from flightbed.plant.airframe import JsbsimAirframe
from flightbed.plant.nonlinear import JsbsimPlant, Start
from tests.aircraft.test_overlay import LOADS, POINTS, _settle, _stock

ALTITUDE = 20000 * FT
AT = 20  # onset of the fault, tick
Commands = Callable[[int], tuple[float, float, float]]  # tick -> elevator beyond trim, aileron, rudder, rad


@pytest.fixture(scope="module")
def point(f16: Aircraft) -> TrimPoint:
    return trim(JsbsimAirframe(f16, mach=0.8, altitude_m=ALTITUDE))


def _plant(aircraft: Aircraft, point: TrimPoint, *, plant_hz: int = 200, health: Health = HEALTHY) -> JsbsimPlant:
    start = Start(
        ALTITUDE, point.airspeed_m_s, point.alpha_rad, point.theta_rad, point.elevator_rad, point.throttle_norm
    )
    return JsbsimPlant(aircraft, start, control_hz=100, plant_hz=plant_hz, health=health, lateral=True)


def _fly(
    aircraft: Aircraft,
    point: TrimPoint,
    failing: HealthHistory,
    commands: Commands,
    *,
    ticks: int = 80,
    plant_hz: int = 200,
) -> list[tuple[Truth, LateralTruth]]:
    plant = _plant(aircraft, point, plant_hz=plant_hz, health=failing(0))
    flown = []
    for k in range(ticks):
        flown.append((plant.sense(failing(k)), plant.sense_lateral(failing(k))))
        elevator, aileron, rudder = commands(k)
        plant.steer(aileron, rudder)
        plant.advance(point.elevator_rad + elevator, failing(k), failing(k + 1))
    return flown


def _positions(flown: list[tuple[Truth, LateralTruth]], surface: str) -> np.ndarray:
    pick = SURFACES.index(surface)
    return np.array([(t.elevator_rad, s.aileron_rad, s.rudder_rad)[pick] for t, s in flown])


def _sway(k: int) -> tuple[float, float, float]:
    """Small commands of all three surfaces at different phases."""
    return 1.0 * DEG * np.sin(0.12 * k), 3.0 * DEG * np.sin(0.1 * k + 1.0), 3.0 * DEG * np.sin(0.08 * k + 2.0)


def _actuator(aircraft: Aircraft, surface: str):  # type: ignore[no-untyped-def]
    return aircraft.actuator if surface == "elevator" else aircraft.lateral[surface]


@pytest.mark.parametrize("surface", ["aileron", "rudder"])
@pytest.mark.parametrize("plant_hz", [100, 200, 400])
def test_actuators_have_lag_and_rate_of_the_overlay(
    f16: Aircraft, point: TrimPoint, surface: str, plant_hz: int
) -> None:
    large = 20 * DEG if surface == "aileron" else 28 * DEG
    position = _positions(
        _fly(f16, point, healthy, lambda _: (0.0, large, large), ticks=30, plant_hz=plant_hz), surface
    )
    assert (np.diff(position) * 100).max() == pytest.approx(_actuator(f16, surface).rate_limit_rad_s, rel=1e-6)
    small = _positions(
        _fly(f16, point, healthy, lambda _: (0.0, 0.1 * DEG, 0.1 * DEG), ticks=6, plant_hz=plant_hz), surface
    )
    # First order, half a frame late: Tustin's rule averages the step with the frame before it. Five periods are flown.
    assert small[5] / (0.1 * DEG) == pytest.approx(1.0 - np.exp(-20.2 * (0.05 - 0.5 / plant_hz)), abs=0.001)


def test_mean_positions_are_those_of_the_frames_that_acted(f16: Aircraft, point: TrimPoint) -> None:
    """Over a period with two frames the mean is of the positions at its beginning and in its middle."""
    flown = _fly(f16, point, healthy, _sway, ticks=20)
    fine = _fly(f16, point, healthy, _sway, ticks=20, plant_hz=100)
    for _, turning in (flown[0], fine[0]):
        assert (turning.aileron_mean_rad, turning.rudder_mean_rad) == (0.0, 0.0)
    for (_, before), (_, now) in itertools.pairwise(flown):
        for was, mean, is_now in (
            (before.aileron_rad, now.aileron_mean_rad, now.aileron_rad),
            (before.rudder_rad, now.rudder_mean_rad, now.rudder_rad),
        ):
            assert min(was, is_now) <= mean <= max(was, is_now) or mean == pytest.approx(was, abs=2e-4)
    for (_, before), (_, now) in itertools.pairwise(fine):  # of one frame: the position at its beginning
        assert now.aileron_mean_rad == before.aileron_rad
        assert now.rudder_mean_rad == before.rudder_rad


@pytest.mark.parametrize("surface", SURFACES)
def test_a_stuck_surface_stays_exactly(f16: Aircraft, point: TrimPoint, surface: str) -> None:
    position = _positions(_fly(f16, point, stuck(healthy, surface=surface, at_tick=AT), _sway), surface)
    free = _positions(_fly(f16, point, healthy, _sway), surface)
    np.testing.assert_array_equal(position[: AT + 1], free[: AT + 1])
    assert set(position[AT:]) == {position[AT]}
    assert abs(free[AT + 1] - free[AT]) > 1e-4  # in motion at the onset


@pytest.mark.parametrize("surface", SURFACES)
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_hardover_runs_at_the_rate_limit_to_the_stop_whatever_is_commanded(
    f16: Aircraft, point: TrimPoint, surface: str, side: float
) -> None:
    failing = hardover(healthy, surface=surface, to_rad=side * np.inf, at_tick=AT)
    runs = [
        _positions(_fly(f16, point, failing, commands, ticks=AT + 70), surface)
        for commands in (lambda _: (0.0, 0.0, 0.0), lambda k: (0.0, 0.0, 0.0) if k < AT else (-side, -side, -side))
    ]
    np.testing.assert_array_equal(*runs)
    actuator, position = _actuator(f16, surface), runs[0]
    stop = actuator.max_rad if side > 0.0 else actuator.min_rad
    assert np.abs(np.diff(position) * 100).max() == pytest.approx(actuator.rate_limit_rad_s, rel=1e-6)
    # At the rate limit until the lag demands less, within rate / lag of the stop.
    running = np.abs(position[AT:-1] - stop) > actuator.rate_limit_rad_s / actuator.lag_rad_s * 1.3
    rates = side * np.diff(position[AT:]) * 100
    np.testing.assert_allclose(rates[running][2:], actuator.rate_limit_rad_s, rtol=1e-6)
    assert running.sum() > 8
    assert side * (position[AT + 1] - position[AT]) > 0.0  # from its tick on
    assert position[-1] == pytest.approx(stop, abs=1e-3)


@pytest.mark.parametrize("surface", SURFACES)
def test_a_reduced_rate_limit_is_not_exceeded(f16: Aircraft, point: TrimPoint, surface: str) -> None:
    def square(k: int) -> tuple[float, float, float]:
        level = 4.0 * DEG if (k // 25) % 2 else -4.0 * DEG
        return level, level, level

    share = 0.2
    actuator = _actuator(f16, surface)
    flown = _fly(f16, point, rate_limited(healthy, surface=surface, to=share, at_tick=AT), square, ticks=120)
    rates = np.abs(np.diff(_positions(flown, surface))) * 100
    assert rates[AT:].max() == pytest.approx(share * actuator.rate_limit_rad_s, rel=1e-6)
    assert rates[:AT].max() > 2.0 * share * actuator.rate_limit_rad_s


@pytest.mark.parametrize("surface", SURFACES)
def test_without_any_rate_left_it_stands_still(f16: Aircraft, point: TrimPoint, surface: str) -> None:
    position = _positions(_fly(f16, point, rate_limited(healthy, surface=surface, to=0.0, at_tick=AT), _sway), surface)
    np.testing.assert_allclose(position[AT:], position[AT], atol=1e-12)


@pytest.mark.parametrize("surface", SURFACES)
def test_a_bias_adds_to_what_acts_and_is_not_in_the_position(f16: Aircraft, point: TrimPoint, surface: str) -> None:
    """A bias of 2 deg acts like a healthy surface deflected by 2 deg more."""
    failing = bias(healthy, surface=surface, by_rad=2.0 * DEG, at_tick=0)
    hold = tuple(2.0 * DEG if name == surface else 0.0 for name in SURFACES)
    biased_flight = _fly(f16, point, failing, lambda _: (0.0, 0.0, 0.0), ticks=40)
    offsets = {
        "elevator": [t.elevator_offset_rad for t, _ in biased_flight],
        "aileron": [s.aileron_offset_rad for _, s in biased_flight],
        "rudder": [s.rudder_offset_rad for _, s in biased_flight],
    }
    assert offsets == {name: [2.0 * DEG if name == surface else 0.0] * 40 for name in SURFACES}
    at_rest = _positions(_fly(f16, point, healthy, lambda _: (0.0, 0.0, 0.0), ticks=40), surface)
    np.testing.assert_allclose(_positions(biased_flight, surface), at_rest, atol=1e-12)
    held = _held(f16, point, HEALTHY, hold)
    np.testing.assert_allclose(_held(f16, point, failing(0), (0.0, 0.0, 0.0)), held, rtol=1e-9, atol=1e-9)


def _held(aircraft: Aircraft, point: TrimPoint, health: Health, beyond: tuple[float, float, float]) -> np.ndarray:
    """Return side force and moments with the actuators settled at these deflections beyond trim."""
    plant = _plant(aircraft, point, health=health)
    plant._command(point.elevator_rad + beyond[0])
    for surface, rad in zip(plant._lateral_surfaces, beyond[1:], strict=True):
        surface.put(rad)
    plant._fdm.settle()
    return np.array(
        [plant._fdm.getter(name)() for name in ("forces/fby-aero-lbs", *(f"moments/{a}-aero-lbsft" for a in "lmn"))]
    )


@pytest.mark.parametrize("surface", SURFACES)
def test_a_floating_surface_aligns_with_the_flow(f16: Aircraft, point: TrimPoint, surface: str) -> None:
    """The elevator floats at -alpha, the rudder at +beta, the aileron at 0 (start of the frame); the actuator has no effect."""
    flown = _fly(f16, point, floating(healthy, surface=surface, at_tick=AT), _sway, ticks=120, plant_hz=100)
    truth = np.array([t.elevator_offset_rad for t, _ in flown])
    alpha, beta = (np.array(v) for v in zip(*((t.alpha_rad, s.beta_rad) for t, s in flown), strict=True))
    rudder = np.array([s.rudder_offset_rad for _, s in flown])
    aileron = np.array([s.aileron_offset_rad for _, s in flown])
    shares = np.array([(t.effectiveness, s.aileron_effectiveness, s.rudder_effectiveness) for t, s in flown])
    free = np.arange(len(flown)) >= AT
    np.testing.assert_array_equal(shares[:, SURFACES.index(surface)], np.where(free, 0.0, 1.0))
    # The value at a tick was set at the start of the previous frame.
    for name, offset, stream in (
        ("elevator", truth, -alpha),
        ("aileron", aileron, 0.0 * beta),
        ("rudder", rudder, beta),
    ):
        if name != surface:
            np.testing.assert_array_equal(offset, 0.0)
        else:
            np.testing.assert_array_equal(offset[AT:], stream[AT - 1 : -1])
            np.testing.assert_array_equal(offset[:AT], 0.0)
    positions = _positions(flown, surface)  # the sensor is at the actuator, which follows its command
    assert np.ptp(positions[AT:]) > 0.5 * DEG


@pytest.mark.parametrize("surface", ["aileron", "rudder"])
def test_effectiveness_scales_the_deflection(f16: Aircraft, point: TrimPoint, surface: str) -> None:
    """K = 0.4 at 10 deg is K = 1 at 4 deg, in side force and every moment."""
    number = SURFACES.index(surface)
    weak = effectiveness_loss(healthy, to=0.4, at_tick=0, surface=surface)(0)
    held = partial(_held, f16, point)
    ten, four = (tuple(deg * DEG if i == number else 0.0 for i in range(3)) for deg in (10.0, 4.0))
    np.testing.assert_allclose(held(weak, ten), held(HEALTHY, four), rtol=1e-12, atol=1e-9)
    assert np.abs(held(HEALTHY, ten) - held(HEALTHY, four)).max() > 1000.0


@pytest.mark.parametrize("surface", ["aileron", "rudder"])
def test_a_failure_acts_from_its_tick_on(f16: Aircraft, point: TrimPoint, surface: str) -> None:
    """Held surface, K = 0.2 from AT: bit-equal at AT, reduced acceleration at the next tick."""

    def hold(_k: int) -> tuple[float, float, float]:
        return (0.0, 3.0 * DEG, 0.0) if surface == "aileron" else (0.0, 0.0, 3.0 * DEG)

    weak = _fly(f16, point, effectiveness_loss(healthy, to=0.2, at_tick=AT, surface=surface), hold, ticks=AT + 3)
    sound = _fly(f16, point, healthy, hold, ticks=AT + 3)
    for k in range(AT + 1):
        assert (weak[k][1].p_rad_s, weak[k][1].r_rad_s) == (sound[k][1].p_rad_s, sound[k][1].r_rad_s)
    assert abs(weak[AT + 1][1].p_rad_s - sound[AT + 1][1].p_rad_s) > 1e-3


@pytest.mark.parametrize("point_", POINTS[1:5])
@pytest.mark.parametrize(("aileron", "rudder"), [(0.2, 0.1), (0.0, 0.2), (-0.7, 0.3)])
def test_commanded_surfaces_are_the_stock_aircraft_at_the_same_positions(
    f16: Aircraft, point_: tuple[float, ...], aileron: float, rudder: float
) -> None:
    """All loads equal those of the overlay under the stock laws, and each table of aileron and rudder that of the stock aircraft.

    The loads differ there: drag and lift of the flaperons, which the stock model sums with the aileron's sign, are taken out of ours.
    """
    stock, laws, direct = _stock(), Fdm(f16, 0.005).exec, Fdm(f16, 0.005).exec
    for fdm, stick in ((stock, "fcs/aileron-cmd-norm"), (laws, "fcs/aileron-cmd-norm")):
        fdm["fcs/fbw-override"] = 1
        fdm[stick], fdm["fcs/rudder-cmd-norm"] = aileron, rudder
        _settle(fdm, point_)
    assert laws["fcs/aileron-pos-rad"] == pytest.approx(stock["fcs/aileron-pos-rad"], abs=1e-12)
    direct["fcs/fbw-override"] = 1
    direct["fcs/lateral-direct"] = 2.0
    direct["fcs/aileron-direct-rad"] = laws["fcs/aileron-pos-rad"]
    direct["fcs/rudder-direct-rad"] = laws["fcs/rudder-pos-rad"]
    _settle(direct, point_)
    assert max(abs(laws["fcs/aileron-pos-rad"]), abs(laws["fcs/rudder-pos-rad"])) > 0.02
    for name in ("aileron", "rudder"):
        assert direct[f"fcs/{name}-used-rad"] == pytest.approx(laws[f"fcs/{name}-pos-rad"], abs=1e-15)
    for name in LOADS:
        assert direct[name] == pytest.approx(laws[name], rel=1e-12, abs=1e-6), name
    for name in ("CYDa", "Clda", "Clda_M", "Cnda", "Cnda_M", "CYdr", "Cldr", "Cldr_M", "Cndr", "Cndr_M"):
        path = f"aero/coefficient/{name}"
        assert direct[path] == pytest.approx(stock[path], rel=1e-12, abs=1e-9), name


def test_repeat_flights_with_roll_and_yaw_are_bit_identical(f16: Aircraft, point: TrimPoint) -> None:
    failing = effectiveness_loss(
        stuck(healthy, surface="rudder", at_tick=AT), to=0.3, at_tick=AT + 5, surface="aileron"
    )
    assert _fly(f16, point, failing, _sway) == _fly(f16, point, failing, _sway)
