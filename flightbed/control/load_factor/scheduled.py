"""Load-factor law with gains scheduled on measured dynamic pressure: the baseline of Kemp (1987), S 6.1."""

from __future__ import annotations

from math import nan
from typing import Literal

import numpy as np

from flightbed.avionics.pitch_points import dynamic_pressure_pa
from flightbed.control.load_factor.design import (
    GainTable,
    LoadFactorDesign,
    LoadFactorLaw,
    gain_table,
    increment_g,
    interpolated,
    pressure_pa,
)
from flightbed.control.load_factor.settings import LoadFactorSettings
from flightbed.core.compiled import Array, compiled
from flightbed.core.records import layout, record, size
from flightbed.core.signals import Measurement
from flightbed.estimation.packed import MEASUREMENT

_MEMORY = layout(("hz", "low", "high", "demand", "alpha", "q", "missed", "square", "points"))
_TABLE = size(_MEMORY)


@compiled
def demand_of(memory: Array, now: Array, increment_ref_g: float, increment_g: float, hold: bool, _out: Array) -> float:
    """Return ``NzScheduled.demand``; see ``design.PackableLaw``."""
    own, m = record(memory, 0, _MEMORY), record(now, 0, MEASUREMENT)
    points = int(own.points)
    table = memory[_TABLE:].reshape((points, (memory.size - _TABLE) // points))
    alpha, q, error, integral = interpolated(table, pressure_pa(m.mach, m.altitude_m, own.square))
    missed = increment_ref_g - increment_g
    if own.alpha != own.alpha:  # increments start at the first reading
        own.alpha, own.q, own.missed = m.alpha_rad, m.q_rad_s, missed
    own.demand += alpha * (m.alpha_rad - own.alpha) + q * (m.q_rad_s - own.q) + error * (missed - own.missed)
    own.alpha, own.q, own.missed = m.alpha_rad, m.q_rad_s, missed
    if not hold:
        own.demand += integral * missed / own.hz
    own.demand = min(max(own.demand, own.low), own.high)
    return float(own.demand)


class NzScheduled:
    """Feedback of alpha, q, the error of a_n and its integral. A LoadFactorLaw.

    Velocity form, u_k = u_(k-1) + K (x_k - x_(k-1)) + K_i e_k / hz: changing gains cause no bump, and no trim has to be scheduled
    (Kaminer, Pascoal, Khargonekar and Coleman, Automatica 31 (1995) 1185). The thesis does not state the form of its controller.

    Args:
        table: gains over dynamic pressure.
        control_hz: control rate.
        elevator_trim_rad: elevator deflection at the start.
        stops_rad: limits of the demand.

    """

    compiled_demand = staticmethod(demand_of)

    def __init__(
        self, table: GainTable, *, control_hz: int, elevator_trim_rad: float, stops_rad: tuple[float, float]
    ) -> None:
        self.table, self._hz, self._stops = table, control_hz, stops_rad
        self._demand, self._last = elevator_trim_rad, (nan, nan, nan)

    @property
    def model(self) -> tuple[float, float, float, float]:
        """Four nan: the law identifies nothing."""
        return nan, nan, nan, nan

    def packed(self) -> Array:
        """Return the memory of ``demand_of``."""
        own = [self._hz, *self._stops, self._demand, *self._last, 2.0, len(self.table.dynamic_pressure_pa)]
        return np.concatenate([own, self.table.packed().ravel()])

    def demand(self, measurement: Measurement, *, increment_ref_g: float, hold: bool) -> float:
        """Return the demanded effective deflection, rad."""
        alpha, q, error, integral = self.table.at(dynamic_pressure_pa(measurement))
        missed = increment_ref_g - increment_g(measurement)
        now = measurement.alpha_rad, measurement.q_rad_s, missed
        if self._last[0] != self._last[0]:  # increments start at the first reading
            self._last = now
        changed = [new - old for new, old in zip(now, self._last, strict=True)]
        self._last = now
        self._demand += alpha * changed[0] + q * changed[1] + error * changed[2]
        if not hold:
            self._demand += integral * missed / self._hz
        low, high = self._stops
        self._demand = min(max(self._demand, low), high)
        return self._demand


class NzScheduledSettings(LoadFactorSettings):
    """Load factor with gains of alpha, q, error and its integral, scheduled over measured dynamic pressure (Kemp S 6.1)."""

    law: Literal["nz-scheduled"] = "nz-scheduled"

    def build(self, design: LoadFactorDesign, control_hz: int) -> LoadFactorLaw:
        """Return the law. Raises DesignError."""
        return NzScheduled(
            gain_table(design.points, self.wanted_poles()),
            control_hz=control_hz,
            elevator_trim_rad=design.elevator_trim_rad,
            stops_rad=design.stops_rad,
        )
