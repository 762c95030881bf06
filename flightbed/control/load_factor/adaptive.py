"""Load factor by pseudo-linear identification and pole placement in flight: Kemp (1987), chapter 6 and the listing of subroutine D.

A pitch-rate inner loop with a scheduled gain, elevator = u + G q, stabilizes the aircraft while PLID identifies the second-order transfer
function from u to y = -a_n (down positive, so that the gains have the signs of the thesis). The poles are placed again at every tick.
u is absolute, trim included, as in the listing. The nonzero u at y = 0 appears to the filter as process noise, or as a zero at 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp
from typing import Annotated, ClassVar, Literal

import numpy as np

from flightbed.avionics.pitch_points import dynamic_pressure_pa
from flightbed.config.table import NonNegative, Positive, Settings, between
from flightbed.control.load_factor.design import (
    GainTable,
    LoadFactorDesign,
    LoadFactorLaw,
    gain_table,
    increment_g,
    interpolated,
    pressure_pa,
    second_order,
)
from flightbed.control.load_factor.integral_placement import AckermannConfig, IntegralPlacement, place
from flightbed.control.load_factor.settings import LoadFactorSettings
from flightbed.core.compiled import Array, compiled
from flightbed.core.records import layout, record, size
from flightbed.core.signals import Measurement
from flightbed.estimation.packed import MEASUREMENT
from flightbed.estimation.plid import factored, identify
from flightbed.estimation.plid.estimator import FORMS, dtype_of
from flightbed.estimation.plid.identify import Form, Plid, PlidConfig, Tracking

# Listing of D: s_0, with poles near the unit circle and the zero that the thesis expects; initial gains, used until a model is accepted.
THESIS_PRIOR = (-0.9856, 1.953, 0.1416, -0.1025)
FIRST_GAINS = (0.0, 0.0, -0.05)
SIGNS = (1, 1, -1)  # of accepted gains, S 6.2


@dataclass(frozen=True)
class NzAdaptiveConfig:
    """Settings of the law. SI, radians, g.

    Attributes:
        plid: settings of the filter, order 2; its prior includes the state at the start of the flight.
        form: form in which its covariance is stored.
        placement: settings of pole placement in the z plane.
        command_filter_rad_s: bandwidth of a first-order filter of u; PLID receives the filtered u. 0: no filter. A departure from the
            thesis, against the flutter of S 6.3.

    """

    plid: PlidConfig
    form: Form
    placement: AckermannConfig
    command_filter_rad_s: float = 0.0


_MEMORY = layout(
    (
        "low", "high", "keep", "u", "has_begun", "square", "points", "y_before", "count", "is_factored", "reset_every", "reset_below",
        "least", "kept", "patience", "rejected", "is_designed", "integral",
    )
)  # fmt: skip
_AFTER = size(_MEMORY)
_SIZE, _STATES, _GAINS = 6, 2, 3  # of the filter of order 2: its states and those of the plant; gains of the law
_PLID_SETTINGS = 6


@compiled
def demand_of(memory: Array, now: Array, increment_ref_g: float, increment_g: float, _hold: bool, out: Array) -> float:
    """Return ``NzAdaptive.demand``; see ``design.PackableLaw``."""
    own, m, a = record(memory, 0, _MEMORY), record(now, 0, MEASUREMENT), _AFTER
    s, a = memory[a : a + _SIZE], a + _SIZE
    P, a = memory[a : a + _SIZE * _SIZE].reshape((_SIZE, _SIZE)), a + _SIZE * _SIZE
    first_P, a = memory[a : a + _SIZE * _SIZE].reshape((_SIZE, _SIZE)), a + _SIZE * _SIZE
    gain, a = memory[a : a + _SIZE], a + _SIZE
    settings, a = memory[a : a + _PLID_SETTINGS], a + _PLID_SETTINGS
    gains, a = memory[a : a + _GAINS], a + _GAINS
    first_gains, a = memory[a : a + _GAINS], a + _GAINS
    signs, a = memory[a : a + _GAINS], a + _GAINS
    poles, a = memory[a : a + 2 * _GAINS].view(np.complex128), a + 2 * _GAINS
    points = int(own.points)
    table = memory[a:].reshape((points, (memory.size - a) // points))

    y, error = -increment_g, -increment_ref_g - (-increment_g)
    damping = -interpolated(table, pressure_pa(m.mach, m.altitude_m, own.square))[1] * m.q_rad_s
    first = own.count == 0.0
    if own.is_factored > 0.0:
        norm = factored.step(s, P, gain, settings, own.y_before, own.u, y, 0.0, first)[2]
    else:
        norm = identify.step(s, P, gain, settings, own.y_before, own.u, y, 0.0, first)[2]
    own.y_before = y
    own.count += 1.0
    if (own.reset_every > 0.0 and own.count % own.reset_every == 0.0) or (
        own.reset_below > 0.0 and norm < own.reset_below and not first
    ):
        P[:, :] = first_P
    taken = place(s[_STATES:], poles, signs, own.least, own.kept if own.is_designed > 0.0 else 0.0, gains)
    if taken:
        own.is_designed, own.rejected = 1.0, 0.0
    else:
        own.rejected += 1.0
    if own.rejected == own.patience and own.patience > 0.0:
        gains[:] = first_gains
    fed_back, integral_gain = np.dot(gains[:_STATES], s[:_STATES]), gains[_STATES]
    if own.has_begun == 0.0:
        own.integral, own.has_begun = -(own.u + fed_back) / integral_gain, 1.0
    low, high = own.low + damping, own.high + damping
    u = -fed_back - integral_gain * own.integral
    push = -integral_gain * error
    if not ((u > high and push > 0.0) or (u < low and push < 0.0)):
        own.integral += error
    u = min(max(u, low), high)
    own.u = min(max(own.keep * own.u + (1.0 - own.keep) * u, low), high)
    out[:] = s[_STATES:]
    return float(own.u - damping)


class NzAdaptive:
    """The law; a LoadFactorLaw.

    Args:
        config: settings.
        table: gains of the scheduled law; the inner loop uses its pitch-rate gain G, as in the thesis.
        control_hz: control rate.
        elevator_trim_rad: elevator deflection at the start.
        stops_rad: limits of the demand; u is limited to the range that the inner loop leaves, and the integral is held at a limit
            (listing of D).

    """

    compiled_demand = staticmethod(demand_of)

    def __init__(
        self,
        config: NzAdaptiveConfig,
        table: GainTable,
        *,
        control_hz: int,
        elevator_trim_rad: float,
        stops_rad: tuple[float, float],
    ) -> None:
        self._plid, self._placement = Plid(config.plid, config.form), IntegralPlacement(config.placement)
        self._table, self._stops = table, stops_rad
        bandwidth = config.command_filter_rad_s
        self._keep = exp(-bandwidth / control_hz) if bandwidth else 0.0
        self._u, self._begun = elevator_trim_rad, False

    @property
    def model(self) -> tuple[float, float, float, float]:
        """Identified a_0, a_1, b_0, b_1."""
        a_0, a_1, b_0, b_1 = self._plid.parameters.tolist()
        return a_0, a_1, b_0, b_1

    def packed(self) -> Array | None:
        """Return the memory of ``demand_of``; None in single precision, or if the initial integral gain is 0."""
        plid, placement, config = self._plid, self._placement, self._placement.config
        if plid.config.dtype != "float64" or config.first[-1] == 0.0 or plid.config.feedthrough:
            return None
        stored, poles = plid.stored.ravel(), np.array(config.poles, dtype=np.complex128).view(np.float64)
        own = [
            *self._stops, self._keep, self._u, 0.0, 2.0, len(self._table.dynamic_pressure_pa), 0.0, 0.0,
            float(plid.form is FORMS["factored"]), *plid.reset, config.smallest_controllability, config.kept, config.patience, 0.0,
            0.0, 0.0,
        ]  # fmt: skip
        signs = config.signs or (0,) * len(config.poles)
        return np.concatenate(
            [own, plid.state, plid.parameters, stored, stored, plid.gain, plid.settings, placement.gains, config.first, signs, poles,
             self._table.packed().ravel()]
        )  # fmt: skip

    def demand(self, measurement: Measurement, *, increment_ref_g: float, hold: bool) -> float:  # noqa: ARG002
        """Return the demanded effective deflection, rad. ``hold`` is not used: the law applies the stops itself."""
        y = -increment_g(measurement)
        damping = -self.damping(measurement) * measurement.q_rad_s
        self._plid.update(y, self._u)
        self._placement.design(self._plid.parameters)
        x = self._plid.state
        if not self._begun:
            self._placement.settle(x, self._u)
            self._begun = True
        low, high = self._stops
        u = self._placement.demand(x, -increment_ref_g - y, (low + damping, high + damping))
        self._u = min(max(self._keep * self._u + (1.0 - self._keep) * u, low + damping), high + damping)
        return self._u - damping

    def damping(self, measurement: Measurement) -> float:
        """Return G of the inner loop, s."""
        return self._table.at(dynamic_pressure_pa(measurement))[1]


def rest_state(model: tuple[float, float, float, float], u: float) -> tuple[float, ...]:
    """Return the extended state of a model at rest at y = 0 with the input u: x_1 = b_0 u, x_2 = y = 0."""
    return model[2] * u, 0.0, *model


class IdentificationSettings(Settings):
    """Online identification by PLID. The thesis uses prior = "thesis", prior_var = 1 and neither filter."""

    prior: Literal["linearization", "thesis"] = "linearization"
    """Initial model: from the linearization, or the guess of the thesis."""
    prior_var: Positive = 1e-3
    """Variance of the initial parameters, P(0); 1 in the thesis."""
    process_var: Positive = 0.01
    """Variance of the process noise, g^2, as in the thesis."""
    output_var: NonNegative = 1e-8
    """Variance of the output noise, g^2, as in the thesis."""
    block_fade: Annotated[float, between(1, 2)] = 1.001
    """Fading factor of the parameter covariance, as in the thesis."""
    form: Literal["factored", "plain"] = "factored"
    """Form of the covariance: U D U', or plain."""
    precision: Literal["double", "single"] = "double"
    """Floating-point precision of the filter."""
    patience: Annotated[int, between(0, 100000)] = 0
    """Number of consecutive rejected models after which the initial gains return; 0: never."""
    gain_filter_rad_s: NonNegative = 5.0
    """Bandwidth of a first-order filter of the gains, against flutter; 0: none, as in the thesis."""
    command_filter_rad_s: NonNegative = 0.0
    """Bandwidth of a first-order filter of the law's input, against flutter; 0: none, as in the thesis."""


class NzAdaptiveSettings(LoadFactorSettings):
    """Load factor by PLID and pole placement at every tick, around a pitch-rate loop (Kemp chapter 6)."""

    identifies: ClassVar[bool] = True

    law: Literal["nz-adaptive"] = "nz-adaptive"
    identification: IdentificationSettings = IdentificationSettings()
    """Online identification."""

    def build(self, design: LoadFactorDesign, control_hz: int) -> LoadFactorLaw:
        """Return the law. Raises DesignError."""
        wanted, poles = self.identification, self.wanted_poles()
        table = gain_table(design.points, poles)
        damping = table.at(design.here.dynamic_pressure_pa)[1]
        model = THESIS_PRIOR
        if wanted.prior == "linearization":
            model = second_order(
                design.here, pitch_rate_gain=damping, actuator_rad_s=design.actuator_rad_s, hz=control_hz
            )
        plid = PlidConfig(
            order=2,
            process_var=wanted.process_var,
            output_var=wanted.output_var,
            prior=rest_state(model, design.elevator_trim_rad),
            prior_var=wanted.prior_var,
            tracking=Tracking(block_fade=wanted.block_fade),
            dtype=dtype_of(wanted.precision),
        )
        placement = AckermannConfig(
            poles=tuple(complex(np.exp(pole / control_hz)) for pole in poles),
            first=FIRST_GAINS,
            signs=SIGNS,
            patience=wanted.patience,
            kept=exp(-wanted.gain_filter_rad_s / control_hz) if wanted.gain_filter_rad_s else 0.0,
        )
        return NzAdaptive(
            NzAdaptiveConfig(plid, FORMS[wanted.form], placement, wanted.command_filter_rad_s),
            table,
            control_hz=control_hz,
            elevator_trim_rad=design.elevator_trim_rad,
            stops_rad=design.stops_rad,
        )
