"""Trace -> Metrics: tracking errors of the flight and errors of its estimators."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from math import isfinite, log10
from typing import Any

import numpy as np
import numpy.typing as npt

from flightbed.aircraft import Actuator
from flightbed.loop import DEPARTURE_RAD
from flightbed.naming import surface_of
from flightbed.pull_up import PULL_UP_METRICS, command_g, first_pulse, pull_up
from flightbed.trace import Trace, true_share
from flightbed.units import DEG

Vector = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

SETTLING_S = 0.3  # "post" starts this long after the failure: one window of the thesis
BAND = 0.2  # of the true K: the thesis's settling band


@dataclass(frozen=True)
class EstimatorMetrics:
    """Metrics of one estimator; None where there is no failure, or where the event does not occur.

    "The failure" here is the first change of K, at Metrics.estimators_since_s.

    Attributes:
        final: last K-hat.
        median_abs_error_post: median |K-hat - K| after the failure.
        rms_error_smoothed_post: RMS error of the smoothed K-hat after the failure.
        std_pre: standard deviation of K-hat before the failure.
        first_within_20pct_s: first entry of K-hat into +-20 % of the true K.
        first_within_20pct_smoothed_s: the same for the smoothed K-hat.
        nis_mean: mean normalized innovation squared, over the ticks that have one.
        nis_expected: expected nis_mean if the estimator's model holds: the number of readings that it predicts; None if unknown.
        detected_at_s: first alarm after the failure; None also for estimators without a test.
        false_alarms: alarms before the failure.
        nees_mean_post: mean of ((K-hat - K) / sigma)^2 from 0.3 s after the failure, K-hat before the bounds; 1 for a consistent sigma.
        efficiency: mean square of the Cramer-Rao bound (column ``effectiveness_bound``) over the mean square error; None without a true
            model for the bound, and for aileron and rudder.

    """

    final: float | None
    median_abs_error_post: float | None
    rms_error_smoothed_post: float | None
    std_pre: float | None
    first_within_20pct_s: float | None
    first_within_20pct_smoothed_s: float | None
    nis_mean: float | None
    detected_at_s: float | None = None
    false_alarms: int = 0
    nees_mean_post: float | None = None
    efficiency: float | None = None
    nis_expected: float | None = None


@dataclass(frozen=True)
class Metrics:
    """Metrics of one flight.

    Attributes:
        departed: |alpha - alpha_trim| > 25 deg, or a state that is not finite; where aileron and rudder are commanded also |beta| > 25 deg.
        departed_at_s: flight time of the departure; None without one.
        tracking_rms_pre_deg_s, tracking_rms_post_deg_s: RMS of q - q_ref before the first failure of any kind, and from 0.3 s after it.
        tracking_rms_pre_p_deg_s, tracking_rms_post_p_deg_s, tracking_rms_pre_beta_deg, tracking_rms_post_beta_deg: the same for roll
            rate and sideslip; None where aileron and rudder are not commanded.
        tracking_rms_pre_nz_g, tracking_rms_post_nz_g: the same for the load factor; None for flights not commanded in g.
        pull_up_overshoot, pull_up_undershoot, pull_up_disturbance_g, pull_up_flutter_deg: for a flight commanded in g whose
            first command is a pulse, see ``PullUp``; None for other flights, and after an early end.
        estimators_since_s: origin of the estimators' times: the first tick at which the true K is not 1, or, with a constant K, the first
            failure; None without a failure.

    """

    departed: bool
    departed_at_s: float | None
    tracking_rms_pre_deg_s: float | None
    tracking_rms_post_deg_s: float | None
    estimators_since_s: float | None
    estimators: dict[str, EstimatorMetrics]
    tracking_rms_pre_p_deg_s: float | None = None
    tracking_rms_post_p_deg_s: float | None = None
    tracking_rms_pre_beta_deg: float | None = None
    tracking_rms_post_beta_deg: float | None = None
    tracking_rms_pre_nz_g: float | None = None
    tracking_rms_post_nz_g: float | None = None
    pull_up_overshoot: float | None = None
    pull_up_undershoot: float | None = None
    pull_up_disturbance_g: float | None = None
    pull_up_flutter_deg: float | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return nested plain values, ready for JSON."""
        return asdict(self)


def measure(
    trace: Trace,
    *,
    alpha_trim_deg: float,
    failed_at_s: float | None,
    readings: Mapping[str, float] | None = None,
) -> Metrics:
    """Compute the metrics of a flight.

    Args:
        trace: the flight.
        alpha_trim_deg: angle of attack from which departure is measured.
        failed_at_s: time of the first failure of any kind; None without a failure, and then the whole flight is "pre".
        readings: estimator -> number of readings that it predicts, where known.

    """
    pre, _, post = _phases(trace, failed_at_s)
    last_alpha, last_q = float(trace["alpha_deg"][-1]), float(trace["q_deg_s"][-1])
    limit_deg = DEPARTURE_RAD / DEG
    departed = not (abs(last_alpha - alpha_trim_deg) <= limit_deg and isfinite(last_q))
    if "beta_deg" in trace.columns:
        departed = departed or not abs(trace["beta_deg"][-1]) <= limit_deg
    error = trace["q_deg_s"] - trace["q_ref_deg_s"]
    other_axes: dict[str, float | None] = {}
    for axis, unit in (("p", "deg_s"), ("beta", "deg"), ("nz", "g")):
        if f"{axis}_ref_{unit}" in trace.columns:
            off = trace[f"{axis}_{unit}"] - trace[f"{axis}_ref_{unit}"]
            other_axes |= {
                f"tracking_rms_pre_{axis}_{unit}": _rms(off[pre]),
                f"tracking_rms_post_{axis}_{unit}": _rms(off[post]),
            }
    if "nz_cmd_g" in trace.columns and len(trace) > 1:
        other_axes |= _pull_up(trace)
    return Metrics(
        departed=departed,
        departed_at_s=float(trace["t_s"][-1]) if departed else None,
        tracking_rms_pre_deg_s=_rms(error[pre]),
        tracking_rms_post_deg_s=_rms(error[post]),
        estimators_since_s=since_s(trace, "", failed_at_s),
        estimators={
            name: _estimator(
                trace, name, *_phases(trace, since_s(trace, name, failed_at_s)), readings=(readings or {}).get(name)
            )
            for name in trace.estimators
        },
        **other_axes,
    )


def _pull_up(trace: Trace) -> dict[str, float | None]:
    hz = round(1.0 / float(trace["t_s"][1] - trace["t_s"][0]))
    if first_pulse(command_g(trace.columns), control_hz=hz) is None:
        return {}
    measured = pull_up(trace.columns, control_hz=hz, ticks=len(trace))
    found = {key: float(getattr(measured, key.removeprefix("pull_up_"))) for key in PULL_UP_METRICS}
    return {key: value if isfinite(value) else None for key, value in found.items()}


def since_s(trace: Trace, estimate: str, failed_at_s: float | None) -> float | None:
    """Return the origin of an estimate's times, s: the first time at which its K is not 1, or, with a constant K, the first failure."""
    changed = trace["t_s"][trace[true_share(estimate)] != 1.0]
    return float(changed[0]) if changed.size else failed_at_s


def _phases(trace: Trace, failed_at_s: float | None) -> tuple[Mask, Mask, Mask]:
    """Return masks (ticks,) of the ticks before a failure, after it, and from ``SETTLING_S`` after it."""
    t = trace["t_s"]
    start = np.inf if failed_at_s is None else failed_at_s - 1e-9
    return t < start, t >= start, t >= start + SETTLING_S


def _estimator(
    trace: Trace, name: str, pre: Mask, failed: Mask, post: Mask, *, readings: float | None
) -> EstimatorMetrics:
    truth, estimate = trace[true_share(name)], trace[f"{name}.effectiveness"]
    smoothed, nis, t = trace[f"{name}.effectiveness_smoothed"], trace[f"{name}.nis"], trace["t_s"]

    def first_within(values: Vector) -> float | None:
        inside = np.flatnonzero(failed & (np.abs(values - truth) <= BAND * truth))
        return round(float(t[inside[0]] - t[failed][0]), 9) if inside.size else None

    return EstimatorMetrics(
        final=_finite(estimate[-1]),
        detected_at_s=_detected(trace, name, failed),
        false_alarms=int(np.max(trace[f"{name}.alarms"][pre], initial=0.0)),
        nees_mean_post=_nees(trace[f"{name}.effectiveness_raw"] - truth, trace[f"{name}.effectiveness_std"], post),
        efficiency=_efficiency(trace, estimate - truth, post) if surface_of(name) == "elevator" else None,
        median_abs_error_post=_finite(np.median(np.abs(estimate - truth)[post])) if post.any() else None,
        rms_error_smoothed_post=_rms((smoothed - truth)[post]),
        std_pre=_finite(np.std(estimate[pre])) if pre.any() else None,
        first_within_20pct_s=first_within(estimate),
        first_within_20pct_smoothed_s=first_within(smoothed),
        nis_mean=_mean(nis[1:][np.isfinite(nis[1:])]),
        nis_expected=readings,
    )


def _detected(trace: Trace, name: str, failed: npt.NDArray[np.bool_]) -> float | None:
    """Return the time from the failure to the first alarm after it."""
    alarms, t = trace[f"{name}.alarms"], trace["t_s"]
    raised = np.flatnonzero(failed & (np.diff(alarms, prepend=0.0) > 0.0))
    return round(float(t[raised[0]] - t[failed][0]), 9) if raised.size else None


def _efficiency(trace: Trace, error: Vector, post: npt.NDArray[np.bool_]) -> float | None:
    """Return the mean square of the Cramer-Rao bound over the mean square error."""
    if "effectiveness_bound" not in trace.columns:
        return None
    best = trace["effectiveness_bound"]
    usable = post & (best < 0.5)  # a larger bound says less about K than 0 <= K <= 1 does
    if not usable.any() or not np.any(error[usable]):
        return None
    return _finite(np.mean(best[usable] ** 2) / np.mean(error[usable] ** 2))


def _nees(error: Vector, std: Vector, post: Mask) -> float | None:
    """Return the mean of (error/std)^2; None for an estimator whose std is 0 or nan at any tick."""
    usable = post & (std > 0.0)
    return _mean((error[usable] / std[usable]) ** 2) if usable.any() and usable.sum() == post.sum() else None


def _mean(values: Vector) -> float | None:
    return _finite(np.mean(values)) if values.size else None


def _rms(values: Vector) -> float | None:
    return _finite(np.sqrt(np.mean(values**2))) if values.size else None


def _finite(value: float | np.floating[Any]) -> float | None:
    return float(value) if np.isfinite(value) else None


def at_stop(trace: Trace, actuator: Actuator, surface: str = "elevator") -> npt.NDArray[np.bool_]:
    """Return the mask (ticks,) of the ticks at which the command to a surface is at a stop of its actuator."""
    command = trace[f"{surface}_cmd_deg"] * DEG
    return (command <= actuator.min_rad + 1e-9) | (command >= actuator.max_rad - 1e-9)


def snr_db(
    *, alpha_max: float, q_max: float, alpha_std: float, q_std: float, poles: npt.NDArray[np.complex128]
) -> float | None:
    """Return the signal-to-noise ratio of Sillence eq (82), dB; alpha and q in the angle unit of their noise.

    Pitch rate is weighted by w = 1/sqrt|p1 p2|, p the short-period poles, rad/s. None without a signal.
    """
    w2 = 1.0 / abs(poles[0] * poles[1])
    signal = alpha_max**2 + w2 * q_max**2
    return float(10.0 * log10(signal / (2.0 * (alpha_std**2 + w2 * q_std**2)))) if signal > 0.0 else None
