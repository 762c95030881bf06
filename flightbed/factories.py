"""Factories from a scenario's settings to the objects of a flight, one per registered name; they convert the units."""

from __future__ import annotations

from flightbed.avionics.short_period import ShortPeriod
from flightbed.config import families, kinds
from flightbed.control.base import Gains, Law
from flightbed.control.design import design_integral, design_proportional
from flightbed.control.proportional import Proportional
from flightbed.control.proportional_integral import ProportionalIntegral
from flightbed.control.redesign import PitchWeights, RedesignedPitch, pitch_lq
from flightbed.core.units import DEG
from flightbed.failures.base import HealthHistory, healthy
from flightbed.scenario.tables import Scenario


def _poles(settings: kinds.Control) -> list[complex] | None:
    return None if settings.poles is None else [complex(re, im) for re, im in settings.poles]


def _given(gains: kinds.GainSettings, *, integral: float = 0.0) -> Gains:
    return Gains(gains.alpha, gains.q_s, gains.elevator, gains.reference_s, integral)


def proportional(settings: kinds.Control, design: ShortPeriod, _control_hz: int) -> Law:
    """Feedback of alpha, q and elevator, prefilter gain for unit DC gain (Sillence S 3.2)."""
    return Proportional(
        _given(settings.gains) if settings.gains else design_proportional(design, _poles(settings)),
        alpha_trim_rad=design.alpha_trim_rad,
        elevator_trim_rad=design.elevator_trim_rad,
    )


def proportional_integral(settings: kinds.Control, design: ShortPeriod, control_hz: int) -> Law:
    """Add to the proportional law the integral of the pitch-rate error (Sillence S 3.3)."""
    return ProportionalIntegral(
        _given(settings.gains, integral=settings.gains.integral)
        if settings.gains
        else design_integral(design, _poles(settings), integral_pole=settings.integral_pole_rad_s),
        alpha_trim_rad=design.alpha_trim_rad,
        elevator_trim_rad=design.elevator_trim_rad,
        control_hz=control_hz,
    )


def lq(settings: kinds.Control, design: ShortPeriod, control_hz: int) -> Law:
    """Proportional law with gains that are optimal for quadratic weights, redesigned for K-hat with adaptation.method = "redesign"."""
    return RedesignedPitch(design, _pitch_weights(settings), control_hz=control_hz)


def lq_gains(settings: kinds.Control, design: ShortPeriod, control_hz: int, effectiveness: float) -> Gains:
    """Return the gains of the law lq at a given K."""
    return pitch_lq(design, _pitch_weights(settings), control_hz=control_hz, effectiveness=effectiveness)


def _pitch_weights(settings: kinds.Control) -> PitchWeights:
    weights = settings.weights
    return PitchWeights(weights.alpha_deg * DEG, weights.q_deg_s * DEG, weights.elevator_deg * DEG)


def health_history(scenario: Scenario) -> HealthHistory:
    """Return the health over time from all failures of a scenario, in order of time; of two at once, the later in the file acts."""
    health: HealthHistory = healthy
    for failure in sorted(scenario.failures, key=lambda f: f.at_s):
        health = families.factory("failures", failure.kind)(failure, health, scenario.rates.control_hz)
    return health
