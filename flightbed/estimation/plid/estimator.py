"""Effectiveness by pseudo-linear identification: PLID identifies the transfer function from elevator to pitch rate; its numerator gives K.

At effectiveness K, b_0 and b_1 of the second-order model are K times their healthy values, and a_0 and a_1 are unchanged (force and moment
are lost equally). Kemp (1987) identifies a, b and the state together (S 2.2-2.4) but does not estimate K; its computation from b is an
addition:

    K-hat = h' S^-1 b-hat / (h' S^-1 h),    sigma^2 = 1 / (h' S^-1 h)

the least-squares solution of b-hat = K h + error, with S the covariance of b-hat and h the healthy numerator at the flight condition.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import nan, sqrt
from types import MappingProxyType
from typing import Annotated, Any, ClassVar, Literal

import numpy as np

from flightbed.avionics import pitch_kernels
from flightbed.avionics.onboard import OnBoard
from flightbed.config.kinds import EffectivenessPrior, EstimatorSettings
from flightbed.config.table import NonNegative, between
from flightbed.core.compiled import Array
from flightbed.core.signals import Estimate, Measurement
from flightbed.core.units import DEG
from flightbed.estimation.plid.factored import FACTORED
from flightbed.estimation.plid.identify import CONVENTIONAL, Form, Plid, PlidConfig, Tracking

FORMS = MappingProxyType({"factored": FACTORED, "plain": CONVENTIONAL})


def dtype_of(precision: str) -> Literal["float64", "float32"]:
    """Return the dtype of a precision, ``"double"`` or ``"single"``."""
    return "float32" if precision == "single" else "float64"


_NOTHING = np.zeros((1, 2))


@dataclass(frozen=True)
class PlidEffectivenessConfig:
    """Settings of the estimator. SI, radians.

    Attributes:
        scheduled: take prior and healthy numerator from the schedule at the flight condition instead of the design model.
        form, dtype: form and type of the filter, see ``plid``.
        block_fade: fade factor of the parameters; 1.001 in the thesis, with which readings from before a failure count for 10 s.
        q_disturbance_rad_s2: process noise, a pitch acceleration held for a tick.
        damping_std_1_s: prior standard deviation of a_0 and a_1, as the error of a damping; divided by the control rate.
        washout_rad_s: lower corner of the band pass of pitch rate and elevator; it removes the trim values and their change after a
            failure, because PLID has no constant input.
        filter_rad_s, filter_damping: upper corner of the band pass, w^2/(s^2 + 2 z w s + w^2).
        smoothing, bounds, prior_effectiveness, prior_effectiveness_var: as in LoopGainConfig.

    """

    scheduled: bool = True
    form: Form = CONVENTIONAL
    dtype: Literal["float64", "float32"] = "float64"
    block_fade: float = 1.01
    q_disturbance_rad_s2: float = 0.005
    damping_std_1_s: float = 0.3
    washout_rad_s: float = 0.5
    filter_rad_s: float = 20.0
    filter_damping: float = 0.8
    smoothing: float = 0.9
    bounds: tuple[float, float] = (0.0, 1.0)
    prior_effectiveness: float = 1.0
    prior_effectiveness_var: float = 0.63**2


def band_pass(config: PlidEffectivenessConfig, hz: int) -> tuple[Array, Array]:
    """Return numerator and denominator, (4,) each, of the washout s/(s + w_0) times the low pass, by Tustin's rule."""
    from scipy.signal import bilinear  # slow to import

    w, z = config.filter_rad_s, config.filter_damping
    low = np.convolve([1.0, config.washout_rad_s], [1.0, 2.0 * z * w, w * w])
    b, a = bilinear([w * w, 0.0], low, fs=hz)
    return np.asarray(b, dtype=np.float64), np.asarray(a, dtype=np.float64)


def project(b: Array, healthy: Array, covariance: Array) -> tuple[float, float]:
    """Return K-hat and its standard deviation, from the numerators b and healthy (2,) and the covariance of b (2, 2).

    If round-off has made the covariance indefinite, b is projected without weights.
    """
    s00, s01, s11 = float(covariance[0, 0]), float(covariance[0, 1]), float(covariance[1, 1])
    h0, h1, b0, b1 = float(healthy[0]), float(healthy[1]), float(b[0]), float(b[1])
    determinant = s00 * s11 - s01 * s01
    w0, w1 = s11 * h0 - s01 * h1, s00 * h1 - s01 * h0  # S^-1 h times the determinant
    information = w0 * h0 + w1 * h1
    if determinant > 0.0 and information > 0.0:
        return (w0 * b0 + w1 * b1) / information, sqrt(determinant / information)
    square = h0 * h0 + h1 * h1
    spread = h0 * h0 * s00 + 2.0 * h0 * h1 * s01 + h1 * h1 * s11
    return (h0 * b0 + h1 * b1) / square, sqrt(max(spread, 0.0)) / square


def transfer_function(A: Array, b: Array) -> tuple[Array, Array]:
    """Return (a_0, a_1) and (b_0, b_1) from elevator to pitch rate of x+ = A x + b u, x = (alpha, q); as ``Plid.parameters``."""
    denominator = np.array([A[0, 1] * A[1, 0] - A[0, 0] * A[1, 1], A[0, 0] + A[1, 1]])
    return denominator, np.array([A[1, 0] * b[0] - A[0, 0] * b[1], b[1]])


class PlidEffectiveness:
    """PLID of order 2 from the elevator's mean position to pitch rate; an Estimator.

    PLID treats y in its model as exact, but pitch rate is noisy, and in a closed loop the elevator contains the same noise: with the raw
    signals K-hat exceeds 1 at any K. Both signals therefore pass through the same band pass, which preserves their transfer function and
    removes most of the noise. The remaining noise of the equation, v_k - a_1 v_(k-1) - a_0 v_(k-2) of the filtered v, enters PLID as
    process noise, half on each of the two states, and the readings are treated as exact. All of this is an addition to the thesis. The
    state of the estimate is that of the readings.

    Args:
        config: settings.
        onboard: on-board knowledge of aircraft and sensors.

    Raises:
        ValueError: the model is the schedule, but none is on board.

    """

    readings = 1.0

    def __init__(self, config: PlidEffectivenessConfig, onboard: OnBoard) -> None:
        if config.scheduled and onboard.schedule is None:
            raise ValueError("the estimator's model is the schedule, but there is none on board")
        schedule = onboard.schedule if config.scheduled else None
        self._schedule: Array | None = None if schedule is None else schedule.packed()
        self._config, self._hz, self._noise_var = config, onboard.control_hz, onboard.noise.q_rad_s**2
        held = onboard.design.discrete(onboard.control_hz)
        self._design = transfer_function(held.A, held.b)
        self._model, self._work = np.zeros((2, 4)), np.zeros((2, 4))
        self._numerator, self._denominator = band_pass(config, onboard.control_hz)
        self._band_state = np.zeros((3, 2))  # state of the band pass, of pitch rate and elevator
        self._last: Measurement | None = None
        self._plid: Plid | None = None
        self._smoothed = 1.0
        for _ in range(2):  # compile, or load from the cache, before the flight
            self.update(Measurement(0.05, 0.0, 0.0, 0.0, 0.6, 0.0, 0.05, 0.0))
        self._last, self._plid, self._smoothed = None, None, 1.0
        self._band_state[:] = 0.0

    def update(self, measurement: Measurement) -> Estimate:
        """Take the readings of the next tick, return the estimate that includes them."""
        config, last = self._config, self._last or measurement
        self._last = measurement
        denominator, healthy = self._healthy(last)
        if self._plid is None:
            self._plid = self._start(denominator, healthy)
            self._first = np.array([measurement.q_rad_s, measurement.elevator_mean_rad])
        q, plid = measurement.q_rad_s, self._plid
        plid.update(*self._band(np.array([q, measurement.elevator_mean_rad]) - self._first))
        raw, std = project(plid.parameters[2:], healthy, plid.covariance[4:, 4:])
        bounded = min(max(raw, config.bounds[0]), config.bounds[1])
        self._smoothed = config.smoothing * self._smoothed + (1.0 - config.smoothing) * bounded
        innovation, variance = float(plid.innovation), float(plid.innovation_var)
        nis = innovation * innovation / variance if variance > 0.0 else nan
        return Estimate(
            bounded, std, self._smoothed, raw, measurement.alpha_rad, q, nis,
            innovation_q_rad_s=innovation, innovation_q_std_rad_s=sqrt(max(variance, 0.0)),
        )  # fmt: skip

    def _band(self, signals: Array) -> list[float]:
        """Filter pitch rate and elevator with the band pass (direct form II, transposed)."""
        b, a, held = self._numerator, self._denominator, self._band_state
        out = b[0] * signals + held[0]
        held[:] = b[1:, None] * signals - a[1:, None] * out + np.vstack([held[1:], _NOTHING])
        found: list[float] = out.tolist()
        return found

    def _impulse(self) -> Array:
        """Return the impulse response of the band pass, over 20 s."""
        from scipy.signal import lfilter  # slow to import

        struck = np.zeros(20 * self._hz)
        struck[0] = 1.0
        return np.asarray(lfilter(self._numerator, self._denominator, struck), dtype=np.float64)

    def _start(self, denominator: Array, healthy: Array) -> Plid:
        config = self._config
        spread = config.prior_effectiveness_var * healthy**2
        left = np.convolve(self._impulse(), [1.0, -denominator[1], -denominator[0]])
        let_in = 0.5 * float(left @ left) * self._noise_var
        known = ((config.damping_std_1_s / self._hz) ** 2,) * 2
        return Plid(
            PlidConfig(
                order=2,
                process_var=(config.q_disturbance_rad_s2 / self._hz) ** 2 + let_in,
                prior=(0.0, 0.0, *denominator.tolist(), *(config.prior_effectiveness * healthy).tolist()),
                prior_var=(let_in, let_in, *known, *spread.tolist()),
                tracking=Tracking(block_fade=config.block_fade),
                dtype=config.dtype,
            ),
            config.form,
        )

    def _healthy(self, at: Measurement) -> tuple[Array, Array]:
        """Return denominator and numerator, (2,) each, of the healthy aircraft over the period that starts at a measurement."""
        if self._schedule is None:
            return self._design
        pitch_kernels.local_model(
            self._schedule, self._model, self._work, self._smoothed, 1.0 / self._hz, at.alpha_rad, at.q_rad_s, at.elevator_rad,
            at.mach, at.altitude_m, at.theta_rad, at.phi_rad, 0.0,
        )  # fmt: skip
        return transfer_function(self._model[:, :2], self._model[:, 2])


class PlidSettings(EstimatorSettings):
    """Pseudo-linear identification (Kemp 1987) from elevator to pitch rate; K is the ratio of its numerator to the healthy one."""

    reads_accelerometer: ClassVar[bool] = False

    on_short_period: ClassVar[Mapping[str, Any]] = MappingProxyType({"q_disturbance_deg_s2": 6.0})

    kind: Literal["plid"] = "plid"
    block_fade: Annotated[float, between(1, 2)] = 1.01
    """Fading factor of the parameters' covariance per sample."""
    form: Literal["factored", "plain"] = "factored"
    """Form of the covariance: U D U', or plain."""
    precision: Literal["double", "single"] = "double"
    """Precision of the numbers."""
    q_disturbance_deg_s2: NonNegative = 0.3
    """Process noise: standard deviation of a pitch acceleration, held for a tick. Default with model "short-period": 6."""
    prior: EffectivenessPrior = EffectivenessPrior()
    """Prior of K."""

    def build(self, onboard: OnBoard) -> PlidEffectiveness:
        """Return the estimator."""
        config = PlidEffectivenessConfig(
            scheduled=self.model == "scheduled",
            form=FORMS[self.form],
            dtype=dtype_of(self.precision),
            block_fade=self.block_fade,
            q_disturbance_rad_s2=self.q_disturbance_deg_s2 * DEG,
            smoothing=self.smoothing,
            bounds=self.bounds,
            prior_effectiveness=self.prior.effectiveness,
            prior_effectiveness_var=self.prior.effectiveness_std**2,
        )
        return PlidEffectiveness(config, onboard)
