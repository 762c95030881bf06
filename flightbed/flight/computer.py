"""The compiled flight computer: one compiled call per tick does all work on board.

The steps and the compiled functions are those of ``composed.Composed``, and the rows are equal to the last bit; a test compares both. Only
flights made of built-in parts can be compiled; external code stays in Python, and ``Composed`` calls it.

All numbers on board lie in one array, the store: passing a further array into compiled code costs more than the arithmetic of a tick on
that array.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from math import isfinite, nan
from operator import call
from struct import Struct

import numpy as np

from flightbed.control import correction
from flightbed.control.base import Gains
from flightbed.control.correction import Adaptation
from flightbed.control.proportional import Proportional, proportional_demand
from flightbed.control.proportional_integral import ProportionalIntegral
from flightbed.core.compiled import Array, compiled
from flightbed.core.signals import NOTHING_RECONSTRUCTED, Estimate, Health, Measurement, Sample, Truth
from flightbed.estimation import differentiated_rls
from flightbed.estimation.base import Estimator, SurfacesEstimator
from flightbed.estimation.differentiated_rls import DifferentiatedRls
from flightbed.estimation.loop_gain import estimator as loop_gain
from flightbed.estimation.loop_gain.estimator import LoopGain
from flightbed.flight.composed import Composed, invalid_estimate
from flightbed.flight.ending import FLIES, NAMES, Ended, ending
from flightbed.flight.loop import Computer, Loop
from flightbed.flight.parts import Flight
from flightbed.flight.record import LEADING, row_width, sample_of
from flightbed.plant import properties
from flightbed.plant.nonlinear import JsbsimPlant
from flightbed.plant.sensors import Sensors, readings

# Indices into the store. The rows have the layout of trace.row_packer.
_ENDED, _WIDTH, _ROWS, _ERRORS, _ESTIMATORS, _CORRECTING_ESTIMATE, _STATE_FROM, _CORRECTION, _INVALID = range(9)
_FLOOR, _CAUTION, _EFFECTIVE_FEEDBACK, _LOW, _HIGH, _TRIM, _PEAK = range(9, 16)
_GAINS, _PER_TICK, _ALPHA_TRIM, _ELEVATOR_TRIM, _INTEGRAL, _HOLD = 16, 20, 21, 22, 23, 24
_ALPHA_START, _GROUND, _MACH_SCALE, _RAW_TRUTH, _ORIGIN, _LATEST, _BLOCKS = 25, 26, 27, 28, 29, 33, 34
_BLOCK = 9  # numbers per estimator: kind, number of filters, bounds of its arrays
_NO_CORRECTION, _BY_ESTIMATE, _BY_TRUE_K = 0.0, 1.0, 2.0  # values of _CORRECTION: source of K in the correction 1/K
_TRUTH, _MEASUREMENT = LEADING, LEADING + len(Truth._fields)
_FIRST_ESTIMATE = _MEASUREMENT + len(Measurement._fields)
_FIELDS = len(Estimate._fields)
_LOOP_GAIN, _RLS = 0.0, 1.0


@compiled
def _tick(store: Array, k: int) -> float:
    """Do all work of the flight computer at tick k; return the command, rad, or nan if the flight ends here.

    The row already holds the true values, or the JSBSim properties from which this function computes them; it adds readings, estimates and
    the command.
    """
    store[_LATEST] = k
    width = int(store[_WIDTH])
    at = int(store[_ROWS]) + k * width
    row = store[at : at + width]
    off = int(store[_ERRORS]) + 8 * k
    truth = store[at + _TRUTH : at + _MEASUREMENT]
    if store[_RAW_TRUTH] > 0.0:
        (
            truth[0], truth[1], truth[2], truth[3], truth[4], truth[5], truth[6], truth[7], truth[8], truth[9],
            truth[10], truth[11], truth[12], truth[13], truth[14], truth[15], truth[16], truth[17], truth[18], truth[19], truth[20],
        ) = properties.fields(
            store[_ORIGIN], store[_ORIGIN + 1], store[_ORIGIN + 2], store[_ORIGIN + 3],
            truth[0], truth[1], truth[2], truth[3], truth[4], truth[5], truth[6], truth[7], truth[8], truth[9],
            truth[10], truth[11], truth[12], truth[13], truth[14], truth[15], truth[16], truth[17], truth[18], truth[19], truth[20],
        )  # fmt: skip
    measurement = store[at + _MEASUREMENT : at + _FIRST_ESTIMATE]
    (
        measurement[0], measurement[1], measurement[2], measurement[3], measurement[4], measurement[5], measurement[6],
        measurement[7], measurement[8],
    ) = readings(
        truth[0], truth[1], truth[11], truth[12], truth[6], truth[7], truth[2], truth[3], truth[10], store[_MACH_SCALE],
        store[off], store[off + 1], store[off + 2], store[off + 3], store[off + 4], store[off + 5], store[off + 6],
        store[off + 7],
    )  # fmt: skip
    before = at - width if k > 0 else at
    previous = store[before + _MEASUREMENT : before + _FIRST_ESTIMATE]
    for number in range(int(store[_ESTIMATORS])):
        block = _BLOCKS + number * _BLOCK
        a, b, c, d, e = (
            int(store[block + 2]), int(store[block + 3]), int(store[block + 4]), int(store[block + 5]), int(store[block + 6]),
        )  # fmt: skip
        if store[block] == _LOOP_GAIN:
            bank = store[a:b].reshape((-1, int(store[block + 1])))
            found = loop_gain.observe(bank, store[b:c], store[c:d], store[d:e], previous, measurement, k)
        else:
            found = differentiated_rls.observe(store[a:b], store[b:c], store[c:d], measurement, k)
        to = _FIRST_ESTIMATE + number * _FIELDS
        (
            row[to], row[to + 1], row[to + 2], row[to + 3], row[to + 4], row[to + 5],
            row[to + 6], row[to + 7], row[to + 8], row[to + 9], row[to + 10], row[to + 11],
        ) = found  # fmt: skip

    low, high, effectiveness_used = store[_LOW], store[_HIGH], 1.0
    if store[_CORRECTION] == _BY_TRUE_K:
        effectiveness_used = correction.divisor(truth[13], 0.0, store[_FLOOR], store[_CAUTION])
    elif store[_CORRECTION] == _BY_ESTIMATE:
        to = _FIRST_ESTIMATE + int(store[_CORRECTING_ESTIMATE]) * _FIELDS
        if not isfinite(row[to + 2]) and isfinite(measurement[1]):
            store[_INVALID] = 1.0
            return nan
        effectiveness_used = correction.divisor(row[to + 2], row[to + 1], store[_FLOOR], store[_CAUTION])
    elevator = effectiveness_used * measurement[2] if store[_EFFECTIVE_FEEDBACK] > 0.0 else measurement[2]
    reference = row[2]
    if store[_PEAK] > 0.0 and store[_CORRECTION] != _NO_CORRECTION:
        reference = correction.limit_reference(reference, effectiveness_used, low, high, store[_TRIM], store[_PEAK])
    alpha, q = measurement[0], measurement[1]
    if store[_STATE_FROM] >= 0.0:
        to = _FIRST_ESTIMATE + int(store[_STATE_FROM]) * _FIELDS
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
    corrected = demand / effectiveness_used
    command = correction.clip_command(corrected, low, high)
    store[_HOLD] = 1.0 if command != corrected else 0.0
    row[3] = command
    store[_ENDED] = ending(truth[0] - store[_ALPHA_START], truth[1], truth[7], store[_GROUND], 0.0)
    return command if store[_ENDED] == FLIES else nan


@cache
def ready() -> None:
    """Compile the tick function or load it from the cache, before a flight."""
    store = np.zeros(_BLOCKS + 8 + row_width(0))
    store[_WIDTH], store[_ERRORS], store[_ROWS], store[_STATE_FROM] = row_width(0), _BLOCKS, _BLOCKS + 8, -1.0
    _tick(store, 0)


class Compiled:
    """All work on board at a tick, in one compiled call on the store; a ``loop.Computer``.

    Args:
        flight: assembled, at its start; ``is_built_in`` must hold.

    Attributes:
        ended: end condition that holds at the latest tick; None while the flight flies.
        listeners: none.

    """

    listeners: tuple[Callable[[float], object], ...] = ()

    def __init__(self, flight: Flight) -> None:
        self._store, self._first, self._width = _store(flight)
        self._flight, self._tick = flight, 0
        self.ended: Ended | None = None
        self.step = self._stepper()

    def _stepper(self) -> Callable[[int, Health], float]:
        """Return the function ``step``; a closure, because attributes of an object cost 1 % of a tick."""
        plant, store = self._flight.plant, self._store
        put, memory = Struct(f"{len(Truth._fields)}d").pack_into, memoryview(store.data).cast("B")
        stride, begin = 8 * self._width, 8 * (self._first + _TRUTH)
        if not isinstance(plant, JsbsimPlant):

            def linear(tick: int, health: Health) -> float:
                put(memory, begin + tick * stride, *plant.sense(health))
                command = _tick(store, tick)
                return command if command == command else self._stopped(tick)

            return linear
        getters = plant.getters

        def nonlinear(tick: int, health: Health) -> float:  # no Truth is built: the compiled code computes its fields
            put(
                memory, begin + tick * stride, *map(call, getters),
                plant.elevator_mean_rad, *health[:3], plant.gust_up_m_s, plant.elevator_offset_rad,
            )  # fmt: skip
            command = _tick(store, tick)
            return command if command == command else self._stopped(tick)

        return nonlinear

    def _stopped(self, tick: int) -> float:
        """Take the reason of a tick without a command. Raises EstimateError."""
        if self._store[_INVALID]:
            number = self._flight.adaptation.estimator
            smoothed = self._row(tick)[_FIRST_ESTIMATE + number * _FIELDS + 2]
            raise invalid_estimate(number, float(smoothed), tick / self._flight.control_hz)
        self.ended = NAMES.get(self._store[_ENDED])
        return nan

    def _row(self, tick: int) -> Array:
        begin = self._first + tick * self._width
        return self._store[begin : begin + self._width]

    def rows(self) -> Array:
        """Return the rows of all ticks so far, in the layout of ``record.row_packer``."""
        return self._store[self._first : self._first + (int(self._store[_LATEST]) + 1) * self._width]

    def sample(self) -> Sample:
        """Return all signals of the latest tick."""
        return sample_of(self._row(int(self._store[_LATEST])).tolist(), self._flight.estimates)

    def replace(self, elevator_cmd_rad: float) -> None:
        """Take the command that replaces the law's at the latest tick; the law holds its integral at the next one."""
        self._store[_HOLD] = 1.0
        self._row(int(self._store[_LATEST]))[3] = elevator_cmd_rad

    def lateral_command(self) -> tuple[float, float]:
        """Raise an error: no compiled flight commands aileron and rudder."""
        raise NotImplementedError

    def throttle_norm(self) -> float:
        """Raise an error: no compiled flight is commanded in g."""
        raise NotImplementedError


def computer_of(flight: Flight) -> Computer:
    """Return the flight computer of a new flight: compiled if all its parts are built in, otherwise composed of its objects."""
    return Compiled(flight) if _is_built_in(flight) else Composed(flight)


def rows_of(flight: Flight) -> Array | None:
    """Fly a flight to its end and return its samples as rows for ``trace.from_rows``; None if a part is not built in.

    Raises:
        EstimateError: as ``loop.fly``.

    """
    if not _is_built_in(flight):
        return None
    computer = Compiled(flight)
    loop = Loop(flight, computer)
    while loop.ended is None:
        loop.advance()
    return computer.rows()


def _is_built_in(flight: Flight) -> bool:
    """Return whether all parts of a tick have exactly these types; a derived type may behave differently."""
    return (
        flight.lateral is None
        and flight.redesign is None
        and type(flight.sensors) is Sensors
        and type(flight.adaptation) is Adaptation
        and type(flight.law) in (Proportional, ProportionalIntegral)
        and all(type(estimator) in (LoopGain, DifferentiatedRls) for estimator in flight.estimators)
    )


def _store(flight: Flight) -> tuple[Array, int, int]:
    """Return the store of a new flight, the index of its first row, and the row width."""
    ticks, count, width = flight.ticks, len(flight.estimators), row_width(len(flight.estimators))
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
    for number in range(count):  # fields of an unknown input, which these estimators do not reconstruct
        to = _FIRST_ESTIMATE + number * _FIELDS
        rows[:, to + _FIELDS - len(NOTHING_RECONSTRUCTED) : to + _FIELDS] = NOTHING_RECONSTRUCTED
    rows[:, 0], rows[:, 1], rows[:, 2] = np.arange(ticks), flight.profile.q_cmd_rad_s, flight.profile.q_ref_rad_s
    _set_up(header, flight)
    header[_WIDTH], header[_ESTIMATORS] = width, count
    return np.concatenate([*parts, flight.sensors.errors.ravel(), rows.ravel()]), int(header[_ROWS]), width


def _packed(estimator: Estimator | SurfacesEstimator) -> tuple[float, int, tuple[Array, ...]]:
    """Return kind, number of parallel filters, and arrays of a new estimator."""
    if isinstance(estimator, LoopGain):
        arrays = estimator.packed()
        return _LOOP_GAIN, arrays[0].shape[1], arrays
    assert isinstance(estimator, DifferentiatedRls)
    return _RLS, 1, estimator.packed()


def _set_up(header: Array, flight: Flight) -> None:
    correction, law = flight.adaptation, flight.law
    assert isinstance(law, Proportional | ProportionalIntegral)
    gains: Gains = law.gains
    header[_CORRECTION] = (
        _NO_CORRECTION if not correction.enabled else _BY_TRUE_K if correction.oracle else _BY_ESTIMATE
    )
    header[_CORRECTING_ESTIMATE] = correction.estimator
    header[_STATE_FROM] = -1 if flight.state_from is None else flight.state_from
    header[_FLOOR], header[_CAUTION] = correction.floor, correction.caution
    header[_EFFECTIVE_FEEDBACK] = correction.feedback == "effective"
    header[_LOW], header[_HIGH], header[_TRIM] = correction.min_rad, correction.max_rad, correction.trim_rad
    header[_PEAK] = 0.0 if correction.peak_per_reference is None else correction.peak_per_reference
    header[_GAINS : _GAINS + 4] = gains.reference, gains.alpha, gains.q, gains.elevator
    header[_PER_TICK] = law.per_tick if isinstance(law, ProportionalIntegral) else 0.0
    header[_ALPHA_TRIM], header[_ELEVATOR_TRIM] = law.alpha_trim_rad, law.elevator_trim_rad
    header[_ALPHA_START], header[_GROUND] = flight.alpha_trim_rad, flight.floor_m
    header[_MACH_SCALE] = flight.sensors.mach_scale
    if isinstance(flight.plant, JsbsimPlant):
        header[_RAW_TRUTH], header[_ORIGIN : _ORIGIN + 4] = 1.0, flight.plant.origin
