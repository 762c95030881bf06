"""The compiled flight computer: one compiled call per tick does all work on board.

The steps and the compiled functions are those of ``composed.Composed``, and the rows are equal to the last bit; a test compares both. Only
flights made of built-in parts can be compiled; external code stays in Python, and ``Composed`` calls it.

All numbers on board lie in one array, the store: passing a further array into compiled code costs more than the arithmetic of a tick on
that array. Its records have names (``core.records``). Estimators and load-factor laws are called by address (``core.by_address``): the
compiled function knows their arguments only, and a flight loads the code of its own parts.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from math import cos, isfinite, nan
from operator import call
from struct import Struct
from typing import Any, NamedTuple, cast

import numpy as np

from flightbed.control import correction
from flightbed.control.correction import Adaptation
from flightbed.control.load_factor.autothrottle import Autothrottle
from flightbed.control.load_factor.design import LAWS, LoadFactorLaw, PackableLaw
from flightbed.control.proportional import Proportional, proportional_demand
from flightbed.control.proportional_integral import ProportionalIntegral
from flightbed.control.redesign import Redesign, RedesignedPitch
from flightbed.control.roll_yaw import RollYaw
from flightbed.core.atmosphere import air
from flightbed.core.compiled import Array, compiled
from flightbed.core.records import layout, packed, record, records, size
from flightbed.core.signals import (
    NOTHING_RECONSTRUCTED,
    Estimate,
    Health,
    LateralTruth,
    LoadFactorSample,
    Sample,
    Truth,
)
from flightbed.estimation.base import Estimator, SurfacesEstimator, estimate_names
from flightbed.estimation.packed import ESTIMATE, LATERAL_MEASUREMENT, MEASUREMENT, OBSERVERS, Packable
from flightbed.flight.composed import Composed, invalid_estimate
from flightbed.flight.ending import FLIES, NAMES, Ended, ending
from flightbed.flight.lateral_axes import LateralAxes, invalid_share
from flightbed.flight.load_factor_axis import LoadFactorAxis
from flightbed.flight.loop import Computer, halves
from flightbed.flight.parts import Flight
from flightbed.flight.record import FLOWN_FIELDS, LATERAL_FIELDS, row_width, sample_of
from flightbed.plant import properties
from flightbed.plant.nonlinear import JsbsimPlant
from flightbed.plant.sensors import LateralSensors, Sensors, readings

# Records of the store, in this order: head, three corrections, pitch law, two laws of roll and yaw, estimators; then the memories of the
# estimators, the errors of the sensors, and the rows in the layout of ``record.row_packer``.
_HEAD = layout(
    (
        "latest", "ended", "stopped", "resumes",  # latest tick; end condition; reason of a tick without a command; whether it resumes
        "width", "rows", "errors", "lateral_errors", "estimators", "lateral_at",  # places in the store, in a row
        "mach_scale", "is_raw", "latitude", "longitude", "north_m", "east_m", "alpha_start", "ground", "state_from", "hold",
        "redesign_floor", "redesign_tolerance", "has_roll_yaw_redesign",
        "law", "law_begin", "law_end", "in_g_at", "has_throttle", "throttle_low", "throttle_high", "airspeed", "airspeed_then", "then_tick",
    )
)  # fmt: skip
_CORRECTION = layout(("source", "estimate", "floor", "caution", "is_effective", "low", "high", "trim", "peak"))
_PITCH = layout(
    (
        "reference", "alpha", "q", "elevator", "alpha_trim", "elevator_trim", "per_tick", "integral",
        "redesigns", "keep", "bump", "last", "is_new", "effectiveness", "estimate",
    )
)  # fmt: skip
_SURFACE = layout(
    (
        "p_ref", "beta_ref", "beta", "p", "r", "aileron", "rudder", "keep", "bump", "last", "is_new", "effectiveness",
        "estimate",
    )
)  # fmt: skip
_IN_G = layout(LoadFactorSample._fields)
_ESTIMATOR = layout(("update", "begin", "end", "first", "count"))
_FLOWN, _TRUTH, _RAW, _LATERAL_TRUTH = map(layout, (FLOWN_FIELDS, Truth._fields, properties.RAW, LateralTruth._fields))
_LATERAL_COMMANDS = layout(LATERAL_FIELDS[: len(LATERAL_FIELDS) - size(_LATERAL_TRUTH) - size(LATERAL_MEASUREMENT)])
_ERRORS = layout(("alpha", "q", "elevator", "mach", "altitude", "theta", "phi", "nz"))
_LATERAL_ERRORS = layout(("beta", "p", "r", "aileron", "rudder"))

_AT_CORRECTIONS = size(_HEAD)
_AT_PITCH = _AT_CORRECTIONS + 3 * size(_CORRECTION)
_AT_SURFACES = _AT_PITCH + size(_PITCH)
_AT_ESTIMATORS = _AT_SURFACES + 2 * size(_SURFACE)
_ERROR_SIZE, _LATERAL_ERROR_SIZE, _ESTIMATOR_SIZE = size(_ERRORS), size(_LATERAL_ERRORS), size(_ESTIMATOR)
# Places in a row, and in the lateral part of a row.
_TRUTH_AT = size(_FLOWN)
_MEASURED_AT = _TRUTH_AT + size(_TRUTH)
_ESTIMATES_AT = _MEASURED_AT + size(MEASUREMENT)
_FIELDS = size(ESTIMATE)
_LATERAL_TRUTH_AT = size(_LATERAL_COMMANDS)
_LATERAL_MEASURED_AT = _LATERAL_TRUTH_AT + size(_LATERAL_TRUTH)
_LATERAL_SIZE = _LATERAL_MEASURED_AT + size(LATERAL_MEASUREMENT)

_NO_CORRECTION, _BY_ESTIMATE, _BY_TRUE_K = 0.0, 1.0, 2.0  # sources of K in the correction 1/K
_DECIDED, _INVALID, _INVALID_SHARE, _REDESIGNS = 0.0, 1.0, 2.0, 3.0  # reasons of a tick without a command

_IN_G_SIZE, _MODEL = size(_IN_G), len(LoadFactorSample._fields) - 4  # and the place of the identified model
_LAWS = (Proportional, ProportionalIntegral, RedesignedPitch)
_observe, _demand = OBSERVERS.call, LAWS.call


class _Variant(NamedTuple):
    """Parts of the compiled function that only some flights have."""

    lateral: bool
    load_factor: bool
    redesigns: bool


@compiled
def _read(head: Any, store: Array, row: Array, k: int) -> None:
    """Compute the true values of a raw row, and the readings."""
    truth, measured = record(row, _TRUTH_AT, _TRUTH), record(row, _MEASURED_AT, MEASUREMENT)
    if head.is_raw > 0.0:
        raw = record(row, _TRUTH_AT, _RAW)
        (
            truth.alpha_rad, truth.q_rad_s, truth.theta_rad, truth.phi_rad, truth.psi_rad, truth.airspeed_m_s, truth.mach,
            truth.altitude_m, truth.north_m, truth.east_m, truth.nz_g, truth.elevator_rad, truth.elevator_mean_rad, truth.effectiveness,
            truth.elevator_force, truth.cg_shift_cbar, truth.gust_up_m_s, truth.lift_n, truth.drag_n, truth.thrust_n,
            truth.elevator_offset_rad,
        ) = properties.fields(
            head.latitude, head.longitude, head.north_m, head.east_m,
            raw.alpha, raw.q, raw.theta, raw.phi, raw.psi, raw.airspeed_fps, raw.mach, raw.altitude_ft, raw.latitude, raw.longitude,
            raw.nz, raw.lift_lbs, raw.drag_lbs, raw.thrust_lbs, raw.elevator, raw.elevator_mean, raw.effectiveness,
            raw.elevator_force, raw.cg_shift, raw.gust_up_m_s, raw.elevator_offset,
        )  # fmt: skip
    off = int(head.errors) + _ERROR_SIZE * k
    e = record(store, off, _ERRORS)
    (
        measured.alpha_rad, measured.q_rad_s, measured.elevator_rad, measured.elevator_mean_rad, measured.mach, measured.altitude_m,
        measured.theta_rad, measured.phi_rad, measured.nz_g,
    ) = readings(
        truth.alpha_rad, truth.q_rad_s, truth.elevator_rad, truth.elevator_mean_rad, truth.mach, truth.altitude_m, truth.theta_rad,
        truth.phi_rad, truth.nz_g, head.mach_scale, e.alpha, e.q, e.elevator, e.mach, e.altitude, e.theta, e.phi, e.nz,
    )  # fmt: skip


@compiled
def _read_lateral(head: Any, store: Array, side: Array, k: int) -> None:
    """Compute the readings of roll and yaw."""
    truth = record(side, _LATERAL_TRUTH_AT, _LATERAL_TRUTH)
    measured = record(side, _LATERAL_MEASURED_AT, LATERAL_MEASUREMENT)
    off = int(head.lateral_errors) + _LATERAL_ERROR_SIZE * k
    e = record(store, off, _LATERAL_ERRORS)
    measured.beta_rad = truth.beta_rad + e.beta
    measured.p_rad_s = truth.p_rad_s + e.p
    measured.r_rad_s = truth.r_rad_s + e.r
    measured.aileron_rad = truth.aileron_rad + e.aileron
    measured.rudder_rad = truth.rudder_rad + e.rudder
    measured.aileron_mean_rad = truth.aileron_mean_rad + e.aileron
    measured.rudder_mean_rad = truth.rudder_mean_rad + e.rudder


@compiled
def _is_changed(head: Any, law: Any, estimates: Array) -> bool:
    """Return whether ``Redesign`` designs a law anew for the estimates of a tick."""
    at = _FIELDS * int(law.estimate)
    estimate = record(estimates, at, ESTIMATE)
    smoothed, floor = estimate.effectiveness_smoothed, head.redesign_floor
    wanted = smoothed if smoothed > floor else floor
    return bool(estimate.alarms > 0.0 and abs(wanted - law.effectiveness) > head.redesign_tolerance)


@compiled
def _share(fix: Any, true: float, estimates: Array) -> float:
    """Return the divisor of the demand on aileron or rudder; nan if the smoothed K is not finite."""
    if fix.source == _NO_CORRECTION:
        return 1.0
    if fix.source == _BY_TRUE_K:
        return correction.divisor(true, 0.0, fix.floor, fix.caution)
    at = _FIELDS * int(fix.estimate)
    estimate = record(estimates, at, ESTIMATE)
    if not isfinite(estimate.effectiveness_smoothed):
        return nan
    return correction.divisor(estimate.effectiveness_smoothed, estimate.effectiveness_std, fix.floor, fix.caution)


@compiled
def _decide_lateral(corrections: Any, laws: Any, side: Array, estimates: Array) -> bool:
    """Compute the commands to aileron and rudder; return whether the K of both corrections is finite."""
    truth = record(side, _LATERAL_TRUTH_AT, _LATERAL_TRUTH)
    measured = record(side, _LATERAL_MEASURED_AT, LATERAL_MEASUREMENT)
    commands = record(side, 0, _LATERAL_COMMANDS)
    aileron_fix, rudder_fix = corrections[1], corrections[2]
    aileron_share = _share(aileron_fix, truth.aileron_effectiveness, estimates)
    rudder_share = _share(rudder_fix, truth.rudder_effectiveness, estimates)
    if aileron_share != aileron_share or rudder_share != rudder_share:
        return False
    aileron, rudder = measured.aileron_rad, measured.rudder_rad
    if aileron_fix.is_effective > 0.0:
        aileron = aileron_share * aileron
    if rudder_fix.is_effective > 0.0:
        rudder = rudder_share * rudder
    for i in range(2):
        law = laws[i]
        found = (
            law.p_ref * commands.p_ref_rad_s
            + law.beta_ref * commands.beta_ref_rad
            - (
                law.beta * measured.beta_rad + law.p * measured.p_rad_s + law.r * measured.r_rad_s
                + law.aileron * aileron + law.rudder * rudder
            )
        )  # fmt: skip
        law.bump *= law.keep
        if law.is_new > 0.0:
            law.bump, law.is_new = law.last - found, 0.0
        law.last = found + law.bump
    commands.aileron_cmd_rad = correction.clip_command(laws[0].last / aileron_share, aileron_fix.low, aileron_fix.high)
    commands.rudder_cmd_rad = correction.clip_command(laws[1].last / rudder_share, rudder_fix.low, rudder_fix.high)
    return True


@compiled
def _set_throttle(head: Any, measured: Any, in_g: Any, level: float, k: int) -> None:
    """Complete the load-factor fields of a row, in which the references are increments over ``level``, and decide the throttle."""
    in_g.nz_cmd_g += level
    in_g.nz_ref_g += level
    in_g.throttle_norm = nan
    if head.has_throttle > 0.0:
        wanted = head.airspeed_then if k >= head.then_tick else head.airspeed
        airspeed = measured.mach * air(measured.altitude_m)[1]
        in_g.throttle_norm = head.throttle_high if airspeed < wanted else head.throttle_low


@cache
def _tick_of(variant: _Variant) -> Callable[[Array, int], float]:
    """Return the compiled function of a variant: (store, tick) -> command, rad, or nan without one.

    The row already holds the true values, or the JSBSim properties from which the function computes them; it adds readings, estimates and
    commands.
    """
    # Plain numbers: the cache has one file per combination of their values, and numba drops the branches that are not taken.
    lateral, load_factor, redesigns = variant

    def tick(store: Array, k: int) -> float:
        head = record(store, 0, _HEAD)
        fix = record(store, _AT_CORRECTIONS, _CORRECTION)
        law = record(store, _AT_PITCH, _PITCH)
        width = int(head.width)
        at = int(head.rows) + k * width
        row, side_at = store[at : at + width], int(head.lateral_at)
        # Arrays that other variants use cost time even if they are empty.
        if lateral:
            surface_laws = records(store[_AT_SURFACES:_AT_ESTIMATORS], _SURFACE)
            corrections = records(store[_AT_CORRECTIONS:_AT_PITCH], _CORRECTION)
            side = row[side_at : side_at + _LATERAL_SIZE]
        estimates = row[_ESTIMATES_AT:side_at]
        if head.resumes == 0.0:
            head.latest = k
            _read(head, store, row, k)
            if lateral:
                _read_lateral(head, store, side, k)
            before = store[at - width : at] if k > 0 else row
            now, then = row[_MEASURED_AT:_ESTIMATES_AT], before[_MEASURED_AT:_ESTIMATES_AT]
            turning, turned, command = now, then, nan
            if lateral:
                turning = side[_LATERAL_MEASURED_AT:]
                turned = before[side_at + _LATERAL_MEASURED_AT : side_at + _LATERAL_SIZE]
            if k > 0:
                command = record(before, 0, _FLOWN).elevator_cmd_rad
            for number in range(int(head.estimators)):
                block = record(store, _AT_ESTIMATORS + number * _ESTIMATOR_SIZE, _ESTIMATOR)
                memory, first = store[int(block.begin) : int(block.end)], int(block.first) * _FIELDS
                out = estimates[first : first + int(block.count) * _FIELDS]
                _observe(block.update, memory, now, then, turning, turned, command, k, out)
            if redesigns:
                changed = _is_changed(head, law, estimates)
                if lateral:  # noqa: SIM102
                    if head.has_roll_yaw_redesign > 0.0:
                        changed = changed or _is_changed(head, surface_laws[0], estimates)
                        changed = changed or _is_changed(head, surface_laws[1], estimates)
                if changed:
                    head.stopped = _REDESIGNS
                    return nan
        head.resumes, head.stopped = 0.0, _DECIDED

        flown = record(row, 0, _FLOWN)
        truth = record(row, _TRUTH_AT, _TRUTH)
        measured = record(row, _MEASURED_AT, MEASUREMENT)
        effectiveness_used = 1.0
        if fix.source == _BY_TRUE_K:
            effectiveness_used = correction.divisor(truth.effectiveness, 0.0, fix.floor, fix.caution)
        elif fix.source == _BY_ESTIMATE:
            to = _FIELDS * int(fix.estimate)
            estimate = record(estimates, to, ESTIMATE)
            smoothed = estimate.effectiveness_smoothed
            if not isfinite(smoothed) and isfinite(measured.q_rad_s):
                head.stopped = _INVALID
                return nan
            effectiveness_used = correction.divisor(smoothed, estimate.effectiveness_std, fix.floor, fix.caution)
        elevator, reference = measured.elevator_rad, flown.q_ref_rad_s
        if fix.is_effective > 0.0:
            elevator = effectiveness_used * elevator
        if fix.peak > 0.0 and fix.source != _NO_CORRECTION:
            reference = correction.limit_reference(reference, effectiveness_used, fix.low, fix.high, fix.trim, fix.peak)
        alpha, q = measured.alpha_rad, measured.q_rad_s
        if head.state_from >= 0.0:
            to = _FIELDS * int(head.state_from)
            state = record(estimates, to, ESTIMATE)
            alpha, q = state.alpha_rad, state.q_rad_s
        if load_factor:
            in_g_at = int(head.in_g_at)
            in_g_row = row[in_g_at : in_g_at + _IN_G_SIZE]
            in_g = record(in_g_row, 0, _IN_G)
            own, now = store[int(head.law_begin) : int(head.law_end)], row[_MEASURED_AT:_ESTIMATES_AT]
            level = cos(measured.theta_rad) * cos(measured.phi_rad)
            demand = _demand(
                head.law, own, now, in_g.nz_ref_g, measured.nz_g - level, head.hold > 0.0, in_g_row[_MODEL:]
            )
            _set_throttle(head, measured, in_g, level, k)
        else:
            demand = proportional_demand(
                law.reference, law.alpha, law.q, law.elevator, law.elevator_trim,
                reference, alpha - law.alpha_trim, q, elevator - law.elevator_trim,
            )  # fmt: skip
            if law.per_tick != 0.0:
                demand = law.integral + demand
                if head.hold == 0.0:
                    law.integral += law.per_tick * (reference - q)
            if law.redesigns > 0.0:
                law.bump *= law.keep
                if law.is_new > 0.0:
                    law.bump, law.is_new = law.last - demand, 0.0
                demand = demand + law.bump
                law.last = demand
        corrected = demand / effectiveness_used
        command = correction.clip_command(corrected, fix.low, fix.high)
        head.hold = 1.0 if command != corrected else 0.0
        flown.elevator_cmd_rad = command
        beta = 0.0
        if lateral:
            if not _decide_lateral(corrections, surface_laws, side, estimates):
                head.stopped = _INVALID_SHARE
                return nan
            beta = record(side, _LATERAL_TRUTH_AT, _LATERAL_TRUTH).beta_rad
        head.ended = ending(truth.alpha_rad - head.alpha_start, truth.q_rad_s, truth.altitude_m, head.ground, beta)
        return command if head.ended == FLIES else nan

    return compiled(tick)


class Compiled:
    """All work on board at a tick, in one compiled call on the store; a ``loop.Computer``.

    Args:
        flight: assembled, at its start; ``is_built_in`` must hold.

    Attributes:
        ended: end condition that holds at the latest tick; None while the flight flies.
        listeners: none; estimators read the command that acts in the row of the tick before.

    """

    listeners: tuple[Callable[[float], object], ...] = ()

    def __init__(self, flight: Flight) -> None:
        self._flight, self._store = flight, _store(flight)
        head = self._head = records(self._store[:_AT_CORRECTIONS], _HEAD)[0]
        self._first, self._width, self._lateral_at = int(head.rows), int(head.width), int(head.lateral_at)
        self._call = _tick_of(_variant(flight))
        _prepare(_variant(flight), self._store)
        self.ended: Ended | None = None

    @property
    def step(self) -> Callable[[int, Health], float]:
        """Function (tick, health) -> command, see ``loop.Computer``; a closure, because attributes cost 1 % of a tick."""
        plant, axes, store, work = self._flight.plant, self._flight.lateral, self._store, self._call
        put, memory = Struct(f"{size(_TRUTH)}d").pack_into, memoryview(store.data).cast("B")
        stride, begin = 8 * self._width, 8 * (self._first + _TRUTH_AT)
        getters = plant.getters if isinstance(plant, JsbsimPlant) else ()

        def linear(tick: int, health: Health) -> float:
            put(memory, begin + tick * stride, *plant.sense(health))
            command = work(store, tick)
            return command if command == command else self._without_command(tick)

        latest: Health | None = None
        shares: tuple[float, ...] = ()

        def nonlinear(tick: int, health: Health) -> float:  # no Truth is built: the compiled code computes its fields
            nonlocal latest, shares
            if health is not latest:
                latest, shares = health, health[:3]
            put(
                memory, begin + tick * stride, *map(call, getters),
                plant.elevator_mean_rad, *shares, plant.gust_up_m_s, plant.elevator_offset_rad,  # type: ignore[attr-defined]
            )  # fmt: skip
            command = work(store, tick)
            return command if command == command else self._without_command(tick)

        if axes is None:
            return nonlinear if getters else linear
        put_lateral = Struct(f"{size(_LATERAL_TRUTH)}d").pack_into
        sense_lateral, begin_lateral = (
            axes.plant.sense_lateral,
            8 * (self._first + self._lateral_at + _LATERAL_TRUTH_AT),
        )

        def turning(tick: int, health: Health) -> float:
            put_lateral(memory, begin_lateral + tick * stride, *sense_lateral(health))
            return nonlinear(tick, health)

        return turning

    def _without_command(self, tick: int) -> float:
        """Take the reason of a tick without a command; return its command if there is one. Raises EstimateError, DesignError."""
        flight, head = self._flight, self._head
        if head.stopped == _REDESIGNS:
            assert flight.redesign is not None
            flight.redesign.update(self.sample().estimates)
            _put_redesigned(self._store, flight, is_new=True)
            head.resumes = 1.0
            command = self._call(self._store, tick)
            return command if command == command else self._without_command(tick)
        if head.stopped == _INVALID:
            number = flight.adaptation.estimator
            smoothed = self.sample().estimates[number].effectiveness_smoothed
            raise invalid_estimate(number, smoothed, tick / flight.control_hz)
        if head.stopped == _INVALID_SHARE:
            assert flight.lateral is not None
            raise _invalid_share(flight.lateral, self.sample().estimates, tick)
        self.ended = NAMES.get(float(head.ended))
        return nan

    def _row(self) -> Array:
        """Return the row of the latest tick."""
        begin = self._first + int(self._head.latest) * self._width
        return self._store[begin : begin + self._width]

    def rows(self) -> Array:
        """Return the rows of all ticks so far, in the layout of ``record.row_packer``."""
        return self._store[self._first : self._first + (int(self._head.latest) + 1) * self._width]

    def sample(self) -> Sample:
        """Return all signals of the latest tick."""
        flight = self._flight
        has = {"lateral": flight.lateral is not None, "load_factor": flight.load_factor is not None}
        return sample_of(self._row().tolist(), flight.estimates, **has)

    def replace(self, elevator_cmd_rad: float) -> None:
        """Take the command that replaces the law's at the latest tick; the law holds its integral at the next one."""
        self._head.hold = 1.0
        records(self._row()[:_TRUTH_AT], _FLOWN)[0].elevator_cmd_rad = elevator_cmd_rad

    def lateral_command(self) -> tuple[float, float]:
        """Return the commands to aileron and rudder of the latest tick, rad."""
        side = records(self._row()[self._lateral_at :][:_LATERAL_TRUTH_AT], _LATERAL_COMMANDS)[0]
        return float(side.aileron_cmd_rad), float(side.rudder_cmd_rad)

    def throttle_norm(self) -> float:
        """Return the throttle command of the latest tick; nan keeps the throttle."""
        at = int(self._head.in_g_at)
        return float(records(self._row()[at : at + _IN_G_SIZE], _IN_G)[0].throttle_norm)


def computer_of(flight: Flight) -> Computer:
    """Return the flight computer of a new flight: compiled if all its parts are built in, otherwise composed of its objects."""
    return Compiled(flight) if is_built_in(flight) else Composed(flight)


def ready(flight: Flight) -> None:
    """Compile the function of a new flight, or load it from the cache, before the flight."""
    if is_built_in(flight):
        Compiled(flight)


def rows_of(flight: Flight) -> Array | None:
    """Fly a flight to its end and return its samples as rows for ``trace.from_rows``; None if a part is not built in.

    Raises:
        EstimateError: as ``loop.fly``.

    """
    if not is_built_in(flight):
        return None
    computer = Compiled(flight)
    for _ in halves(flight, computer):
        pass
    return computer.rows()


def is_built_in(flight: Flight) -> bool:
    """Return whether all parts of a tick have exactly these types, or a compiled form; a derived type may behave differently."""
    lateral, redesign, in_g = flight.lateral, flight.redesign, flight.load_factor
    return (
        type(flight.sensors) is Sensors
        and type(flight.adaptation) is Adaptation
        and (_is_packed(in_g) if in_g is not None else type(flight.law) in _LAWS)
        and all(_memory(estimator) is not None for estimator in flight.estimators)
        and (redesign is None or type(redesign) is Redesign)
        and (
            lateral is None
            or (
                type(lateral) is LateralAxes
                and type(lateral.sensors) is LateralSensors
                and type(lateral.law) is RollYaw
                and type(lateral.aileron) is type(lateral.rudder) is Adaptation
                and isinstance(flight.plant, JsbsimPlant)
            )
        )
    )


def _memory(estimator: Estimator | SurfacesEstimator) -> Array | None:
    """Return the memory of an estimator whose class itself has a compiled form: it is ``Packable``."""
    has_form = "compiled_update" in vars(type(estimator))
    return cast(Packable, estimator).packed() if has_form else None


def _law_memory(law: LoadFactorLaw) -> Array | None:
    """Return the memory of a load-factor law whose class itself has a compiled form: it is ``PackableLaw``."""
    has_form = "compiled_demand" in vars(type(law))
    return cast(PackableLaw, law).packed() if has_form else None


def _is_packed(axis: LoadFactorAxis) -> bool:
    """Return whether axis and throttle have exactly the built-in types, and the law has a compiled form."""
    auto = axis.autothrottle
    return (
        type(axis) is LoadFactorAxis
        and _law_memory(axis.law) is not None
        and (auto is None or type(auto) is Autothrottle)
    )


def _variant(flight: Flight) -> _Variant:
    return _Variant(flight.lateral is not None, flight.load_factor is not None, flight.redesign is not None)


_prepared: set[_Variant] = set()


def _prepare(variant: _Variant, store: Array) -> None:
    """Compile the function of a variant, or load it from the cache, by a tick 0 on a copy of a store."""
    if variant not in _prepared:
        _tick_of(variant)(store.copy(), 0)
        _prepared.add(variant)


def _store(flight: Flight) -> Array:
    """Return the store of a new flight."""
    lateral, in_g = flight.lateral, flight.load_factor
    blocks, memories, end, first = [], [], _AT_ESTIMATORS + len(flight.estimators) * _ESTIMATOR_SIZE, 0
    for estimator in flight.estimators:
        memory, count = _memory(estimator), len(estimate_names("", estimator))
        assert memory is not None
        update = OBSERVERS.address(cast(Packable, estimator).compiled_update)
        blocks.append(packed(_ESTIMATOR, update=update, begin=end, end=end + memory.size, first=first, count=count))
        memories.append(memory)
        end, first = end + memory.size, first + count
    places: dict[str, float] = {"law_begin": end, "law_end": end}
    if in_g is not None:
        own = _law_memory(in_g.law)
        assert own is not None
        memories.append(own)
        places["law"] = LAWS.address(cast(PackableLaw, in_g.law).compiled_demand)
        end = places["law_end"] = end + own.size
    errors = [flight.sensors.errors.ravel()] + ([] if lateral is None else [lateral.sensors.errors.ravel()])
    lateral_at = _ESTIMATES_AT + first * _FIELDS
    in_g_at = lateral_at + (_LATERAL_SIZE if lateral is not None else 0)
    width = row_width(first, lateral=lateral is not None, load_factor=in_g is not None)
    places |= {
        "errors": end, "lateral_errors": end + errors[0].size, "rows": end + sum(array.size for array in errors),
        "estimators": len(blocks), "width": width, "lateral_at": lateral_at, "in_g_at": in_g_at,
    }  # fmt: skip
    before = [_head(flight, places), *_laws(flight), *blocks, *memories, *errors]
    store = np.zeros(int(places["rows"]) + flight.ticks * width)
    np.concatenate(before, out=store[: int(places["rows"])])
    rows = store[int(places["rows"]) :].reshape(flight.ticks, width)
    rows[:, _FLOWN_AT["tick"]] = np.arange(flight.ticks)
    rows[:, _FLOWN_AT["q_cmd_rad_s"]] = flight.profile.q_cmd_rad_s
    rows[:, _FLOWN_AT["q_ref_rad_s"]] = flight.profile.q_ref_rad_s
    for after in range(_ESTIMATES_AT + _FIELDS, lateral_at + 1, _FIELDS):  # the end of each estimate
        rows[:, after - len(NOTHING_RECONSTRUCTED) : after] = NOTHING_RECONSTRUCTED
    if lateral is not None:
        references = np.array(lateral.references)
        rows[:, lateral_at : lateral_at + references.shape[1]] = references
    if in_g is not None:
        increments = np.array(in_g.references)
        rows[:, in_g_at:] = np.nan
        rows[:, in_g_at : in_g_at + increments.shape[1]] = increments
    _put_redesigned(store, flight, is_new=False)
    return store


_FLOWN_AT = {name: at for at, name in enumerate(FLOWN_FIELDS)}


def _head(flight: Flight, places: Mapping[str, float]) -> Array:
    """Return the head of the store."""
    values: dict[str, float] = {
        **places,
        "state_from": -1 if flight.state_from is None else flight.state_from,
        "alpha_start": flight.alpha_trim_rad,
        "ground": flight.floor_m,
        "mach_scale": flight.sensors.mach_scale,
    }
    if isinstance(flight.plant, JsbsimPlant):
        values |= zip(("latitude", "longitude", "north_m", "east_m"), flight.plant.origin, strict=True)
        values["is_raw"] = 1.0
    if flight.load_factor is not None and (auto := flight.load_factor.autothrottle) is not None:
        values |= {"has_throttle": 1.0, "throttle_low": auto.low_norm, "throttle_high": auto.high_norm}
        values |= {"airspeed": auto.airspeed_m_s, "airspeed_then": auto.then_m_s, "then_tick": auto.from_tick}
    if (redesign := flight.redesign) is not None:
        values |= {"redesign_floor": redesign.floor, "redesign_tolerance": redesign.tolerance}
        values["has_roll_yaw_redesign"] = float(redesign.roll_yaw is not None)
    return packed(_HEAD, **values)


def _laws(flight: Flight) -> list[Array]:
    """Return corrections and laws of the store, without the numbers that a redesign changes."""
    axes, law, redesign = flight.lateral, flight.law, flight.redesign
    fixes = [flight.adaptation, *((axes.aileron, axes.rudder) if axes is not None else ())]
    corrections = [
        packed(
            _CORRECTION,
            source=_NO_CORRECTION if not fix.enabled else _BY_TRUE_K if fix.oracle else _BY_ESTIMATE,
            estimate=fix.estimator, floor=fix.floor, caution=fix.caution, is_effective=fix.feedback == "effective",
            low=fix.min_rad, high=fix.max_rad, trim=fix.trim_rad,
            peak=0.0 if fix.peak_per_reference is None else fix.peak_per_reference,
        )
        for fix in fixes
    ]  # fmt: skip
    corrections += [np.zeros(size(_CORRECTION))] * (3 - len(corrections))
    pitch: dict[str, float] = {}
    if isinstance(law, Proportional | ProportionalIntegral):
        gains = law.gains
        pitch = {"reference": gains.reference, "alpha": gains.alpha, "q": gains.q, "elevator": gains.elevator}
        pitch |= {"alpha_trim": law.alpha_trim_rad, "elevator_trim": law.elevator_trim_rad}
        pitch["per_tick"] = law.per_tick if isinstance(law, ProportionalIntegral) else 0.0
    surfaces = (0, 0)
    if redesign is not None:
        pitch["estimate"] = redesign.pitch[1]
        surfaces = surfaces if redesign.roll_yaw is None else redesign.roll_yaw[1]
    return [*corrections, packed(_PITCH, **pitch), *(packed(_SURFACE, estimate=index) for index in surfaces)]


def _put_redesigned(store: Array, flight: Flight, *, is_new: bool) -> None:
    """Write the laws that a redesign changes into the store; a new law takes over without a step."""
    pitch, law = flight.law, record(store, _AT_PITCH, _PITCH)
    if isinstance(pitch, RedesignedPitch):
        gains = pitch.gains
        law.redesigns, law.keep = 1.0, pitch.keep
        law.is_new = float(is_new and law.effectiveness != pitch.effectiveness) or law.is_new
        law.effectiveness = pitch.effectiveness
        law.reference, law.alpha, law.q, law.elevator = gains.reference, gains.alpha, gains.q, gains.elevator
        law.alpha_trim, law.elevator_trim = pitch.law.alpha_trim_rad, pitch.law.elevator_trim_rad
    if flight.lateral is None:
        return
    both = flight.lateral.law
    surfaces = records(store[_AT_SURFACES:_AT_ESTIMATORS], _SURFACE)
    changed = is_new and both.effectiveness != tuple(float(to.effectiveness) for to in surfaces)
    for to, N, F, share in zip(surfaces, both.N.tolist(), both.F.tolist(), both.effectiveness, strict=True):
        to.p_ref, to.beta_ref = N
        to.beta, to.p, to.r, to.aileron, to.rudder = F
        to.keep, to.is_new, to.effectiveness = both.keep, float(changed) or to.is_new, share


def _invalid_share(axes: LateralAxes, estimates: tuple[Estimate, ...], tick: int) -> Exception:
    """Return the error of the first correction of aileron and rudder whose smoothed K is not finite."""
    smoothed = [
        estimates[fix.estimator].effectiveness_smoothed
        for fix in (axes.aileron, axes.rudder)
        if fix.enabled and not fix.oracle
    ]
    return invalid_share(next(K for K in smoothed if not isfinite(K)), tick / axes.control_hz)
