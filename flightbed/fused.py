"""A whole flight into rows, all that the flight computer does at a tick in one compiled call: ``loop.fly`` for many flights, fast.

The steps are those of ``loop.fly``, made of the same compiled functions, and the rows are the same to the last bit; a test flies both
ways. Only flights whose parts are all of the house can be flown so: what a user brings along stays in Python, and ``fly`` calls it.

All numbers that a flight needs on board lie in one array, the store: each array costs the way into compiled code more than a tick's
arithmetic on it.
"""

from __future__ import annotations

from collections import deque
from functools import cache
from math import isfinite, nan
from operator import call
from struct import Struct

import numpy as np

from flightbed.compiling import Array, compiled
from flightbed.control import adaptation
from flightbed.control.adaptation import Adaptation
from flightbed.control.base import Gains
from flightbed.control.proportional import Proportional, proportional_demand
from flightbed.control.proportional_integral import ProportionalIntegral
from flightbed.estimation import loop_gain, rls
from flightbed.estimation.base import Estimator, SurfacesEstimator
from flightbed.estimation.loop_gain import LoopGain
from flightbed.estimation.rls import DifferentiatedRls
from flightbed.loop import DEPARTURE_RAD, Flight, not_a_number
from flightbed.plant import properties
from flightbed.plant.nonlinear import JsbsimPlant
from flightbed.sensors import Sensors, readings
from flightbed.signals import NOTHING_RECONSTRUCTED, Estimate, Measurement, Truth
from flightbed.trace import LEADING, row_width

# Where what lies in the store. The rows are laid out as trace.row_packer packs them.
_ENDED, _WIDTH, _ROWS, _ERRORS, _ESTIMATORS, _WHICH, _STATE_FROM, _BELIEVES, _BROKEN = range(9)
_FLOOR, _CAUTION, _EFFECTIVE, _LOW, _HIGH, _TRIM, _PEAK = range(9, 16)
_GAINS, _PER_TICK, _ALPHA_TRIM, _ELEVATOR_TRIM, _INTEGRAL, _HOLD = 16, 20, 21, 22, 23, 24
_ALPHA_START, _GROUND, _MACH_SCALE, _READ_OUT, _ORIGIN, _BLOCKS = 25, 26, 27, 28, 29, 33
_BLOCK = 9  # of each estimator: kind, filters, then where its arrays begin and end
_NOBODY, _ESTIMATE, _ORACLE = 0.0, 1.0, 2.0  # whom the law believes
_TRUTH, _READ = LEADING, LEADING + len(Truth._fields)
_TOLD = _READ + len(Measurement._fields)
_FIELDS = len(Estimate._fields)
_LOOP_GAIN, _RLS = 0.0, 1.0


@compiled
def _tick(store: Array, k: int) -> float:
    """Do all that the flight computer does at tick k; returns the command, nan if the flight ends here.

    The true values stand in the row already, or what JSBSim says, which is made into them; readings, estimates and the command are written
    into it.
    """
    width = int(store[_WIDTH])
    at = int(store[_ROWS]) + k * width
    row = store[at : at + width]
    off = int(store[_ERRORS]) + 8 * k
    truth = store[at + _TRUTH : at + _READ]
    if store[_READ_OUT] > 0.0:
        (
            truth[0], truth[1], truth[2], truth[3], truth[4], truth[5], truth[6], truth[7], truth[8], truth[9],
            truth[10], truth[11], truth[12], truth[13], truth[14], truth[15], truth[16], truth[17], truth[18], truth[19], truth[20],
        ) = properties.fields(
            store[_ORIGIN], store[_ORIGIN + 1], store[_ORIGIN + 2], store[_ORIGIN + 3],
            truth[0], truth[1], truth[2], truth[3], truth[4], truth[5], truth[6], truth[7], truth[8], truth[9],
            truth[10], truth[11], truth[12], truth[13], truth[14], truth[15], truth[16], truth[17], truth[18], truth[19], truth[20],
        )  # fmt: skip
    now = store[at + _READ : at + _TOLD]
    (now[0], now[1], now[2], now[3], now[4], now[5], now[6], now[7], now[8]) = readings(
        truth[0], truth[1], truth[11], truth[12], truth[6], truth[7], truth[2], truth[3], truth[10], store[_MACH_SCALE],
        store[off], store[off + 1], store[off + 2], store[off + 3], store[off + 4], store[off + 5], store[off + 6],
        store[off + 7],
    )  # fmt: skip
    before = at - width if k > 0 else at
    then = store[before + _READ : before + _TOLD]
    for number in range(int(store[_ESTIMATORS])):
        block = _BLOCKS + number * _BLOCK
        a, b, c, d, e = (
            int(store[block + 2]), int(store[block + 3]), int(store[block + 4]), int(store[block + 5]), int(store[block + 6]),
        )  # fmt: skip
        if store[block] == _LOOP_GAIN:
            bank = store[a:b].reshape((-1, int(store[block + 1])))
            found = loop_gain.observe(bank, store[b:c], store[c:d], store[d:e], then, now, k)
        else:
            found = rls.observe(store[a:b], store[b:c], store[c:d], now, k)
        to = _TOLD + number * _FIELDS
        (
            row[to], row[to + 1], row[to + 2], row[to + 3], row[to + 4], row[to + 5],
            row[to + 6], row[to + 7], row[to + 8], row[to + 9], row[to + 10], row[to + 11],
        ) = found  # fmt: skip

    low, high, believed = store[_LOW], store[_HIGH], 1.0
    if store[_BELIEVES] == _ORACLE:
        believed = adaptation.divisor(truth[13], 0.0, store[_FLOOR], store[_CAUTION])
    elif store[_BELIEVES] == _ESTIMATE:
        to = _TOLD + int(store[_WHICH]) * _FIELDS
        if not isfinite(row[to + 2]) and isfinite(now[1]):
            store[_BROKEN] = 1.0
            return nan
        believed = adaptation.divisor(row[to + 2], row[to + 1], store[_FLOOR], store[_CAUTION])
    elevator = believed * now[2] if store[_EFFECTIVE] > 0.0 else now[2]
    reference = row[2]
    if store[_PEAK] > 0.0 and store[_BELIEVES] != _NOBODY:
        reference = adaptation.limit_reference(reference, believed, low, high, store[_TRIM], store[_PEAK])
    alpha, q = now[0], now[1]
    if store[_STATE_FROM] >= 0.0:
        to = _TOLD + int(store[_STATE_FROM]) * _FIELDS
        alpha, q = row[to + 4], row[to + 5]
    trim = store[_ELEVATOR_TRIM]
    demand = proportional_demand(
        store[_GAINS], store[_GAINS + 1], store[_GAINS + 2], store[_GAINS + 3], trim,
        reference, alpha - store[_ALPHA_TRIM], q, elevator - trim,
    )  # fmt: skip
    if store[_PER_TICK] != 0.0:
        demand = store[_INTEGRAL] + demand
        if store[_HOLD] == 0.0:
            store[_INTEGRAL] += store[_PER_TICK] * (reference - q)
    wanted = demand / believed
    command = adaptation.clip_command(wanted, low, high)
    store[_HOLD] = 1.0 if command != wanted else 0.0
    row[3] = command
    store[_ENDED] = k
    deviation = truth[0] - store[_ALPHA_START]
    if not abs(deviation) <= DEPARTURE_RAD or not isfinite(truth[1]) or truth[7] < store[_GROUND]:
        return nan
    return command


@cache
def ready() -> None:
    """Compile, or load what was compiled, now and not in the time of a flight."""
    store = np.zeros(_BLOCKS + 8 + row_width(0))
    store[_WIDTH], store[_ERRORS], store[_ROWS], store[_STATE_FROM] = row_width(0), _BLOCKS, _BLOCKS + 8, -1.0
    _tick(store, 0)


def rows_of(flight: Flight) -> Array | None:
    """Fly a flight to its end; returns its samples as rows for ``trace.from_rows``, or None if some part of it is not of the house.

    Raises:
        EstimateError: as ``loop.fly``.

    """
    if not _is_ours(flight):
        return None
    store, first, width = _store(flight)
    plant, health_at, ticks = flight.plant, flight.health, len(flight.profile.q_cmd_rad_s)
    sense, advance = plant.sense, plant.advance
    ours = plant if isinstance(plant, JsbsimPlant) else None
    getters = ours.getters if ours else ()
    delay, on_the_way = flight.delay_ticks, deque([plant.sense().elevator_rad] * flight.delay_ticks)
    put, memory = Struct(f"{len(Truth._fields)}d").pack_into, memoryview(store.data).cast("B")
    stride, place = 8 * width, 8 * (first + _TRUTH)
    following = told = health_at(0)
    left = told[:3]
    for tick in range(ticks):
        health, following = following, health_at(tick + 1)
        if ours is not None:  # no Truth is made: the compiled code makes its fields
            if health is not told:
                told, left = health, health[:3]
            put(
                memory, place, *map(call, getters),
                ours.elevator_mean_rad, *left, ours.gust_up_m_s, ours.elevator_offset_rad,
            )  # fmt: skip
        else:
            put(memory, place, *sense(health))
        place += stride
        command = _tick(store, tick)
        if command != command:
            break
        if delay:
            on_the_way.append(command)
            command = on_the_way.popleft()
        advance(command, health, following)
    if store[_BROKEN]:
        which = flight.adaptation.estimator
        raise not_a_number(which, float(store[first + tick * width + _TOLD + which * _FIELDS + 2]), tick)
    return store[first : first + (int(store[_ENDED]) + 1) * width]


def _is_ours(flight: Flight) -> bool:
    """Tell whether all that is called at a tick is of exactly these types: one that is derived from them may do something else."""
    return (
        flight.lateral is None
        and flight.redesign is None
        and type(flight.sensors) is Sensors
        and type(flight.adaptation) is Adaptation
        and type(flight.law) in (Proportional, ProportionalIntegral)
        and all(type(estimator) in (LoopGain, DifferentiatedRls) for estimator in flight.estimators)
    )


def _store(flight: Flight) -> tuple[Array, int, int]:
    """Return the store of a flight about to begin, where its rows begin, and their width."""
    ticks, count, width = len(flight.profile.q_cmd_rad_s), len(flight.estimators), row_width(len(flight.estimators))
    parts = [np.zeros(_BLOCKS + count * _BLOCK)]
    header, end = parts[0], len(parts[0])
    for number, estimator in enumerate(flight.estimators):
        kind, filters, arrays = _packed(estimator)
        bounds = np.cumsum([end, *(array.size for array in arrays)])
        block = _BLOCKS + number * _BLOCK
        header[block : block + 2 + len(bounds)] = kind, filters, *bounds
        parts += [array.ravel() for array in arrays]
        end = int(bounds[-1])
    header[_ERRORS], header[_ROWS] = end, end + flight.sensors.errors.size
    rows = np.zeros((ticks, width))
    for number in range(count):  # what none of these estimators reconstructs
        to = _TOLD + number * _FIELDS
        rows[:, to + _FIELDS - len(NOTHING_RECONSTRUCTED) : to + _FIELDS] = NOTHING_RECONSTRUCTED
    rows[:, 0], rows[:, 1], rows[:, 2] = np.arange(ticks), flight.profile.q_cmd_rad_s, flight.profile.q_ref_rad_s
    _set_up(header, flight)
    header[_WIDTH], header[_ESTIMATORS] = width, count
    return np.concatenate([*parts, flight.sensors.errors.ravel(), rows.ravel()]), int(header[_ROWS]), width


def _packed(estimator: Estimator | SurfacesEstimator) -> tuple[float, int, tuple[Array, ...]]:
    """Return kind, number of filters side by side, and arrays of an estimator about to begin."""
    if isinstance(estimator, LoopGain):
        arrays = estimator.packed()
        return _LOOP_GAIN, arrays[0].shape[1], arrays
    assert isinstance(estimator, DifferentiatedRls)
    return _RLS, 1, estimator.packed()


def _set_up(header: Array, flight: Flight) -> None:
    told, law = flight.adaptation, flight.law
    assert isinstance(law, Proportional | ProportionalIntegral)
    gains: Gains = law.gains
    header[_BELIEVES] = _NOBODY if not told.enabled else _ORACLE if told.oracle else _ESTIMATE
    header[_WHICH] = told.estimator
    header[_STATE_FROM] = -1 if flight.state_from is None else flight.state_from
    header[_FLOOR], header[_CAUTION] = told.floor, told.caution
    header[_EFFECTIVE] = told.feedback == "effective"
    header[_LOW], header[_HIGH], header[_TRIM] = told.min_rad, told.max_rad, told.trim_rad
    header[_PEAK] = 0.0 if told.peak_per_reference is None else told.peak_per_reference
    header[_GAINS : _GAINS + 4] = gains.reference, gains.alpha, gains.q, gains.elevator
    header[_PER_TICK] = law.per_tick if isinstance(law, ProportionalIntegral) else 0.0
    header[_ALPHA_TRIM], header[_ELEVATOR_TRIM] = law.alpha_trim_rad, law.elevator_trim_rad
    header[_ALPHA_START], header[_GROUND] = flight.alpha_trim_rad, flight.floor_m
    header[_MACH_SCALE] = flight.sensors.mach_scale
    if isinstance(flight.plant, JsbsimPlant):
        header[_READ_OUT], header[_ORIGIN : _ORIGIN + 4] = 1.0, flight.plant.origin
