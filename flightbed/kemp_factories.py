"""Factories for the methods of Kemp's thesis: load-factor laws, and PLID as an estimator of effectiveness."""

from __future__ import annotations

from collections.abc import Sequence
from math import exp

import numpy as np

from flightbed.config import kinds
from flightbed.control.ackermann import AckermannConfig
from flightbed.control.autothrottle import Autothrottle
from flightbed.control.load_factor import POLES, LoadFactorDesign, LoadFactorLaw, gain_table, second_order
from flightbed.control.nz_adaptive import FIRST_GAINS, SIGNS, THESIS_PRIOR, NzAdaptive, NzAdaptiveConfig, rest_state
from flightbed.control.nz_scheduled import NzScheduled
from flightbed.core.units import FT
from flightbed.estimation.plid.estimator import FORMS as _FORMS
from flightbed.estimation.plid.estimator import dtype_of as _dtype
from flightbed.estimation.plid.identify import PlidConfig, Tracking


def _poles(settings: kinds.Control) -> Sequence[complex]:
    return POLES if settings.poles is None else [complex(re, im) for re, im in settings.poles]


def nz_scheduled(settings: kinds.Control, design: LoadFactorDesign, control_hz: int) -> LoadFactorLaw:
    """Load factor with gains of alpha, q, error and its integral, scheduled over measured dynamic pressure (Kemp S 6.1)."""
    return NzScheduled(
        gain_table(design.points, _poles(settings)),
        control_hz=control_hz,
        elevator_trim_rad=design.elevator_trim_rad,
        stops_rad=design.stops_rad,
    )


def nz_adaptive(settings: kinds.Control, design: LoadFactorDesign, control_hz: int) -> LoadFactorLaw:
    """Load factor by PLID and pole placement at every tick, around a pitch-rate loop (Kemp chapter 6)."""
    wanted, poles = settings.identification, _poles(settings)
    table = gain_table(design.points, poles)
    damping = table.at(design.here.dynamic_pressure_pa)[1]
    model = THESIS_PRIOR
    if wanted.prior == "linearization":
        model = second_order(design.here, pitch_rate_gain=damping, actuator_rad_s=design.actuator_rad_s, hz=control_hz)
    plid = PlidConfig(
        order=2,
        process_var=wanted.process_var,
        output_var=wanted.output_var,
        prior=rest_state(model, design.elevator_trim_rad),
        prior_var=wanted.prior_var,
        tracking=Tracking(block_fade=wanted.block_fade),
        dtype=_dtype(wanted.precision),
    )
    placement = AckermannConfig(
        poles=tuple(complex(np.exp(pole / control_hz)) for pole in poles),
        first=FIRST_GAINS,
        signs=SIGNS,
        patience=wanted.patience,
        kept=exp(-wanted.gain_filter_rad_s / control_hz) if wanted.gain_filter_rad_s else 0.0,
    )
    return NzAdaptive(
        NzAdaptiveConfig(plid, _FORMS[wanted.form], placement, wanted.command_filter_rad_s),
        table,
        control_hz=control_hz,
        elevator_trim_rad=design.elevator_trim_rad,
        stops_rad=design.stops_rad,
    )


def autothrottle(settings: kinds.Autothrottle, *, airspeed_m_s: float, control_hz: int) -> Autothrottle | None:
    """Return an autothrottle that holds the initial airspeed, and then_fps from then_at_s on; None if it is disabled."""
    if not settings.enabled:
        return None
    return Autothrottle(
        settings.low_norm,
        settings.high_norm,
        airspeed_m_s,
        settings.then_fps * FT if settings.then_fps else airspeed_m_s,
        round(settings.then_at_s * control_hz),
    )
