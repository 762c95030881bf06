"""Factories from a scenario's settings to the objects of a flight, one per registered name; they convert the units."""

from __future__ import annotations

from collections.abc import Sequence

from flightbed.avionics.onboard import OnBoard
from flightbed.avionics.short_period import ShortPeriod
from flightbed.config import families, kinds
from flightbed.control.base import Gains, Law
from flightbed.control.design import design_integral, design_proportional
from flightbed.control.proportional import Proportional
from flightbed.control.proportional_integral import ProportionalIntegral
from flightbed.control.redesign import PitchWeights, RedesignedPitch, pitch_lq
from flightbed.core.units import DEG, FT
from flightbed.estimation.base import Estimator, SurfacesEstimator
from flightbed.estimation.loop_gain import LoopGain, LoopGainConfig
from flightbed.estimation.rls import DifferentiatedRls, RlsConfig
from flightbed.estimation.surfaces import SurfacesConfig, TwoStagePitch, TwoStageSurfaces
from flightbed.estimation.two_stage import ConstantForgetting, Forgetting, NoForgetting, VariableForgetting
from flightbed.failures.base import HealthHistory, healthy
from flightbed.gusts import Gusts, calm, one_minus_cosine, sine
from flightbed.settings.scenario import Scenario


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


def gusts(settings: Sequence[kinds.GustSettings]) -> Gusts:
    """Return the sum of all gusts, m/s over time."""
    air: Gusts = calm
    for gust in settings:
        if gust.shape == "sine":
            air = sine(air, at_s=gust.at_s, up_m_s=gust.up_fps * FT, frequency_hz=gust.frequency_hz)
            continue
        air = one_minus_cosine(air, at_s=gust.at_s, up_m_s=gust.up_fps * FT, rise_s=gust.rise_s, hold_s=gust.hold_s)
    return air


def loop_gain(settings: kinds.EstimatorSettings, onboard: OnBoard) -> Estimator:
    """Joint Kalman filter for alpha, q and K (Sillence Theorem 1): window, expanding or fading memory."""
    return LoopGain(loop_gain_config(settings), onboard)


def differentiated_rls(settings: kinds.EstimatorSettings, onboard: OnBoard) -> Estimator:
    """Recursive least squares with variable forgetting on differentiated pitch rate: the baseline."""
    return DifferentiatedRls(
        RlsConfig(
            scheduled=settings.model == "scheduled",
            forgetting=settings.forgetting,
            smoothing=settings.smoothing,
            bounds=(settings.bounds[0], settings.bounds[1]),
            prior_effectiveness=settings.prior.effectiveness,
            prior_effectiveness_var=settings.prior.effectiveness_std**2,
        ),
        onboard,
    )


def two_stage(settings: kinds.EstimatorSettings, onboard: OnBoard) -> Estimator | SurfacesEstimator:
    """Two-stage Kalman filter with forgetting (Wu, Zhang and Zhou 2000): of the elevator, or of all commanded surfaces."""
    forgetting: Forgetting = NoForgetting()
    if settings.memory == "fading":
        forgetting = ConstantForgetting(settings.forgetting)
    elif settings.memory == "variable":
        forgetting = VariableForgetting(settings.variance_min, settings.variance_max)
    config = SurfacesConfig(
        forgetting=forgetting,
        walk_std=settings.walk_std,
        test_window=settings.window,
        false_alarm=settings.false_alarm,
        smoothing=settings.smoothing,
        bounds=(settings.bounds[0], settings.bounds[1]),
        prior_std=settings.prior.effectiveness_std,
        follow_disturbances=settings.follow_disturbances,
        scheduled=settings.model == "scheduled",
        disturbances=(
            settings.alpha_disturbance_deg_s * DEG,
            settings.q_disturbance_deg_s2 * DEG,
            settings.beta_disturbance_deg_s * DEG,
            settings.p_disturbance_deg_s2 * DEG,
            settings.r_disturbance_deg_s2 * DEG,
        ),
    )
    if onboard.lateral is None:
        return TwoStagePitch(config, onboard)
    return TwoStageSurfaces(config, onboard)


def loop_gain_config(settings: kinds.EstimatorSettings) -> LoopGainConfig:
    """Return the filter's settings in SI and radians."""
    prior = settings.prior
    return LoopGainConfig(
        memory=settings.memory,
        window=settings.window,
        forgetting=settings.forgetting,
        smoothing=settings.smoothing,
        bounds=(settings.bounds[0], settings.bounds[1]),
        alarm_threshold=settings.alarm_threshold,
        follow_disturbances=settings.follow_disturbances,
        hold_std=settings.hold_std,
        absolute=settings.input == "absolute",
        input_at=settings.input_at,
        scheduled=settings.model == "scheduled",
        alpha_disturbance_rad_s=settings.alpha_disturbance_deg_s * DEG,
        q_disturbance_rad_s2=settings.q_disturbance_deg_s2 * DEG,
        prior_state="measurement"
        if prior.state == "measurement"
        else ("corrected" if prior.first_reading == "used" else "fixed"),
        prior_alpha_rad=prior.alpha_deg * DEG,
        prior_q_rad_s=prior.q_deg_s * DEG,
        prior_alpha_var=(prior.alpha_std_deg * DEG) ** 2,
        prior_q_var=(prior.q_std_deg_s * DEG) ** 2,
        prior_effectiveness=prior.effectiveness,
        prior_effectiveness_var=prior.effectiveness_std**2,
    )
