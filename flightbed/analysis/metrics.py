"""Trace -> Metrics: departure, tracking error, pull-up, and errors of the estimates."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from math import isfinite, log10
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from flightbed.analysis.pull_up import PULL_UP_METRICS, command_g, first_pulse, pull_up
from flightbed.analysis.trace import Trace, true_share
from flightbed.core.actuator import Actuator
from flightbed.core.estimate_names import surface_of
from flightbed.core.units import DEG
from flightbed.flight.ending import DEPARTURE_RAD

Vector = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

SETTLING_S = 0.3  # "post" starts this long after the failure: one window of the thesis
Phase = Literal["pre", "post"]  # before the first failure; from SETTLING_S after it
PHASES: tuple[Phase, Phase] = ("pre", "post")
BAND = 0.2  # of the true K: the thesis's settling band


@dataclass(frozen=True)
class EstimatorMetrics:
    """Accuracy of one estimate of K; None without a failure, and for an event that does not occur.

    "The failure" is the first change of the true K of its surface, see ``Metrics.estimators_since_s``.

    Attributes:
        final: last K-hat.
        median_abs_error_post: median |K-hat - K| after the failure.
        rms_error_smoothed_post: RMS error of the smoothed K-hat after the failure.
        std_pre: standard deviation of K-hat before the failure.
        first_within_20pct_s: first entry of K-hat into +-20 % of the true K.
        first_within_20pct_smoothed_s: the same for the smoothed K-hat.
        nis_mean: mean normalized innovation squared, over the ticks that have one.
        nis_expected: its expectation under the estimator's own model, the number of readings that it predicts; None if not declared.
        detected_at_s: time from the failure to the first alarm; None also for estimators without a test.
        false_alarms: alarms before the failure.
        nees_mean_post: mean of ((K-hat - K) / sigma)^2 from 0.3 s after the failure, K-hat before it is bounded; 1 for a consistent sigma.
        efficiency: mean square of the Cramer-Rao bound (column ``effectiveness_bound``) over the mean square error; None without a true
            model, and for aileron and rudder.

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
    """Departure, tracking and estimation of one flight.

    Attributes:
        departed: |alpha - alpha_trim| > 25 deg, or a state that is not finite; with commanded aileron and rudder also |beta| > 25 deg.
        departed_at_s: flight time of the departure, s; None without one.
        tracking_rms_pre_deg_s, tracking_rms_post_deg_s: RMS of q - q_ref before the first failure of any kind, and from 0.3 s after it.
        tracking_rms_pre_p_deg_s, tracking_rms_post_p_deg_s, tracking_rms_pre_beta_deg, tracking_rms_post_beta_deg: the same of roll rate
            and sideslip; None where aileron and rudder are not commanded.
        tracking_rms_pre_nz_g, tracking_rms_post_nz_g: the same of the load factor; None where the flight is not commanded in g.
        pull_up_overshoot, pull_up_undershoot, pull_up_disturbance_g, pull_up_flutter_deg: of the first command of a flight in g, if it is a
            pulse, see ``PullUp``; None in other flights, and for a phase that the flight did not reach.
        estimators_since_s: origin of the estimators' times: the first tick with a true K other than 1, or, where K does not change, the
            first failure; None without a failure.

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

    def tracking_rms(self, phase: Phase, quantity: str) -> float | None:
        """Return the tracking RMS of one quantity.

        Args:
            phase: before the first failure, or from 0.3 s after it.
            quantity: end of the attribute's name: ``deg_s`` (pitch rate), ``p_deg_s``, ``beta_deg`` or ``nz_g``.

        """
        value: float | None = getattr(self, f"tracking_rms_{phase}_{quantity}")
        return value

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
        alpha_trim_deg: trim point, from which departure is measured, deg.
        failed_at_s: time of the first failure of any kind, s; None without one: the whole flight is then "pre".
        readings: estimate -> number of readings that its estimator predicts, where it declares them.

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
    """Return the origin of an estimate's times: the first time with a true K other than 1, or that of the first failure where K stays 1."""
    changed = trace["t_s"][trace[true_share(estimate)] != 1.0]
    return float(changed[0]) if changed.size else failed_at_s


def _phases(trace: Trace, failed_at_s: float | None) -> tuple[Mask, Mask, Mask]:
    """Return masks of the ticks before a failure, from it on, and from SETTLING_S after it on."""
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
    known = post & (best < 0.5)  # a larger bound holds less information than 0 <= K <= 1
    return (
        _finite(np.mean(best[known] ** 2) / np.mean(error[known] ** 2))
        if known.any() and np.any(error[known])
        else None
    )


def _nees(error: Vector, std: Vector, post: Mask) -> float | None:
    """Return the mean of (error/std)^2; None for an estimator without a standard deviation, or with one of 0."""
    known = post & (std > 0.0)
    return _mean((error[known] / std[known]) ** 2) if known.any() and known.sum() == post.sum() else None


def _mean(values: Vector) -> float | None:
    return _finite(np.mean(values)) if values.size else None


def _rms(values: Vector) -> float | None:
    return _finite(np.sqrt(np.mean(values**2))) if values.size else None


def _finite(value: float | np.floating[Any]) -> float | None:
    return float(value) if np.isfinite(value) else None


def at_stop(trace: Trace, actuator: Actuator, surface: str = "elevator") -> npt.NDArray[np.bool_]:
    """Return a mask of the ticks at which the command to a surface is cut at a stop of its actuator."""
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
