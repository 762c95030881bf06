"""Load-factor law with gains scheduled on measured dynamic pressure: the baseline of Kemp (1987), S 6.1."""

from __future__ import annotations

from math import nan
from typing import Literal

from flightbed.avionics.pitch_points import dynamic_pressure_pa
from flightbed.control.load_factor.design import (
    GainTable,
    LoadFactorDesign,
    LoadFactorLaw,
    gain_table,
    increment_g,
)
from flightbed.control.load_factor.settings import LoadFactorSettings
from flightbed.core.signals import Measurement


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

    def __init__(
        self, table: GainTable, *, control_hz: int, elevator_trim_rad: float, stops_rad: tuple[float, float]
    ) -> None:
        self.table, self._hz, self._stops = table, control_hz, stops_rad
        self._demand, self._last = elevator_trim_rad, (nan, nan, nan)

    @property
    def model(self) -> tuple[float, float, float, float]:
        """Four nan: the law identifies nothing."""
        return nan, nan, nan, nan

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
