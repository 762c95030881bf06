"""Pseudo-linear identification (PLID): state and parameters of a plant of any order from one linear Kalman filter.

With one input and one output, the observable-canonical form x+ = J x + a y + b u, y = x_n + b_n u (J shifts down) is jointly linear in
state and parameters once y is measured: s = (x, a, b[, b_n]) obeys s+ = F(y, u) s, y = H(u) s, and the Kalman filter applies. (Kemp,
Pseudo-Linear Identification and Its Application to Adaptive Control, MS thesis, Virginia Polytechnic Institute, 1987, S 2.2-2.4.)

Without noise of the readings (r = 0), y in F is exact and the filter is the exact conditional mean: unbiased under process noise. With
noise of the readings, y in F is noisy, which the filter does not model: the parameters are biased.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from flightbed.core.compiled import compiled

Array = npt.NDArray[np.float64]
Stored = npt.NDArray[np.floating[Any]]  # float64 or float32, as configured
READING_VAR, PROCESS_VAR, WHOLE_FADE, BLOCK_FADE, PSEUDONOISE_VAR, TINY = range(
    6
)  # indices into the settings of ``step``
Step = Callable[..., tuple[Any, Any, Any]]  # numbers of that type


@dataclass(frozen=True)
class Tracking:
    """Methods that keep the gain of the filter up when the plant may change (Kemp S 4.1-4.3); all off by default.

    Attributes:
        block_fade: alpha >= 1 on the covariance of the parameters alone, eq (4.3): the tracking PLID; the thesis takes 1.001.
        whole_fade: alpha >= 1 on the whole F P F', eq (4.2): Gelb's fading memory.
        pseudonoise_var: gamma, added to the variance of each parameter at every sample, eq (4.1).
        reset_every: samples after which the covariance is reset to the prior's; 0: never.
        reset_below: norm of the parameters' Kalman gains below which the covariance is reset (the state's gains do not decay under
            noise); 0: never.

    """

    block_fade: float = 1.0
    whole_fade: float = 1.0
    pseudonoise_var: float = 0.0
    reset_every: int = 0
    reset_below: float = 0.0

    def __post_init__(self) -> None:
        if self.block_fade < 1.0 or self.whole_fade < 1.0:
            raise ValueError(f"fade factors must be at least 1 (got {self.block_fade:g} and {self.whole_fade:g})")
        if self.pseudonoise_var < 0.0 or self.reset_every < 0 or self.reset_below < 0.0:
            raise ValueError("pseudonoise and limits of resetting must not be negative")


@dataclass(frozen=True)
class PlidConfig:
    """Settings of the filter. Input and output in the caller's units; variances in their squares.

    Attributes:
        order: n, order of the plant.
        feedthrough: whether the output contains b_n u of the same sample, and b_n is identified: 3n + 1 states instead of 3n.
        process_var: q of Q_1 = q I, process noise of each state, eq (3.3).
        output_var: r, variance of the readings of y.
        prior: s(0) = (x, a, b[, b_n]), each in ascending order of the index; zeros if empty, eq (2.24).
        prior_var: P(0): one variance for all components, or one for each.
        tracking: method for following changes of the plant.
        dtype: type of state, covariance, and every operation on them.

    """

    order: int
    feedthrough: bool = False
    process_var: float = 0.0
    output_var: float = 0.0
    prior: tuple[float, ...] = ()
    prior_var: float | tuple[float, ...] = 200.0
    tracking: Tracking = field(default_factory=Tracking)
    dtype: Literal["float64", "float32"] = "float64"

    def __post_init__(self) -> None:
        if self.order < 1:
            raise ValueError(f"order must be at least 1 (got {self.order})")
        if self.process_var < 0.0 or self.output_var < 0.0 or np.min(self.prior_var) < 0.0:
            raise ValueError("variances must not be negative")
        for name, value in (("prior", self.prior), ("prior_var", self.prior_var)):
            if isinstance(value, tuple) and len(value) not in (self.size, 0 if name == "prior" else self.size):
                raise ValueError(f"{name} needs {self.size} values, for x, a and b (got {len(value)})")

    @property
    def size(self) -> int:
        """Number of states of the filter."""
        return 3 * self.order + self.feedthrough


@dataclass(frozen=True)
class Form:
    """Form in which the covariance is stored and advanced.

    Attributes:
        step: the kernel, as ``step``.
        start: (N,) variances -> stored array, (N, N), float64.
        covariance: stored array -> P.

    """

    step: Step
    start: Callable[[Array], Array]
    covariance: Callable[[Array], Array]


@compiled
def step(
    s: Stored,
    P: Stored,
    gain: Stored,
    settings: Stored,
    y_before: float,
    u_before: float,
    y: float,
    u: float,
    first: bool,
) -> tuple[Any, Any, Any]:
    """Advance state and covariance by one sample, Kemp eqs (2.23) with the fading of (4.1)-(4.3).

    Departures: the correction computes one half of P and mirrors it, so that P stays symmetric (in the listing the halves drift apart);
    a sample with an innovation variance made negative by round-off is skipped (the listing divides by it); y(0) also corrects the prior,
    as in (2.26), which has no later effect for a diagonal prior without feedthrough.

    Args:
        s: (N,) extended state, updated.
        P: (N, N) covariance, updated.
        gain: (N,) Kalman gain, written.
        settings: r, q, whole fade, block fade, gamma, the smallest normal number.
        y_before, u_before: output and input of the previous sample.
        y, u: output and, for feedthrough, input of this sample.
        first: whether this is the first sample.

    Returns:
        innovation, its variance, squared norm of the parameters' gains.

    """
    real = s.dtype.type
    zero = real(0.0)
    N = s.shape[0]
    n = N // 3
    r, q, whole, block, gamma = (
        settings[READING_VAR],
        settings[PROCESS_VAR],
        settings[WHOLE_FADE],
        settings[BLOCK_FADE],
        settings[PSEUDONOISE_VAR],
    )
    yb, ub, yn, un = real(y_before), real(u_before), real(y), real(u)
    if not first:
        for i in range(n - 1, -1, -1):  # s- = F s, F P: in descending order, so that row i - 1 still has its old value
            above = s[i - 1] if i > 0 else zero
            s[i] = above + yb * s[n + i] + ub * s[2 * n + i]
            for j in range(N):
                above = P[i - 1, j] if i > 0 else zero
                P[i, j] = above + yb * P[n + i, j] + ub * P[2 * n + i, j]
        for i in range(n - 1, -1, -1):  # (F P) F'
            for j in range(N):
                above = P[j, i - 1] if i > 0 else zero
                P[j, i] = above + yb * P[j, n + i] + ub * P[j, 2 * n + i]
        for i in range(N):
            for j in range(N):
                P[i, j] *= whole
            P[i, i] += q if i < n else gamma
        for i in range(n, N):
            for j in range(n, N):
                P[i, j] *= block
    feed = N % 3 == 1
    innovation = yn - s[n - 1]
    if feed:
        innovation -= un * s[N - 1]
    for i in range(N):
        gain[i] = P[i, n - 1] + un * P[i, N - 1] if feed else P[i, n - 1]
    variance = r + gain[n - 1]
    if feed:
        variance += un * gain[N - 1]
    norm = zero
    if variance > zero:
        for i in range(N):
            part = gain[i] / variance
            s[i] += part * innovation
            if i >= n:
                norm += part * part
            for j in range(i, N):
                P[i, j] -= part * gain[j]
                P[j, i] = P[i, j]
        for i in range(N):
            gain[i] /= variance
    else:
        gain[:] = zero
    return innovation, variance, norm


CONVENTIONAL = Form(step, np.diag, lambda P: P)


class Plid:
    """The filter; owns its state.

    Args:
        config: settings.
        form: form of the covariance: conventional, or factored (``factored.FACTORED``).

    Attributes:
        stored: stored array of the covariance, (N, N).
        settings: as in ``step``.
        reset: samples after which the covariance is reset, and the squared norm of gains below which it is reset.

    """

    def __init__(self, config: PlidConfig, form: Form = CONVENTIONAL) -> None:
        tracking = config.tracking
        self.config, self.form, self._type = config, form, np.dtype(config.dtype)
        self._s = np.zeros(config.size, dtype=self._type)
        if config.prior:
            self._s[:] = config.prior
        self._gain = np.zeros_like(self._s)
        memory = (tracking.whole_fade, tracking.block_fade, tracking.pseudonoise_var)
        self.settings = np.array(
            [config.output_var, config.process_var, *memory, np.finfo(self._type).tiny], dtype=self._type
        )
        self.reset = (tracking.reset_every, tracking.reset_below**2)
        self.stored = self._start()
        self._y, self._count = 0.0, 0
        self.innovation, self.innovation_var = 0.0, 0.0

    def _start(self) -> Stored:
        variances = np.broadcast_to(np.asarray(self.config.prior_var, dtype=np.float64), (self.config.size,))
        return np.ascontiguousarray(self.form.start(variances), dtype=self._type)

    def update(self, y: float, u_before: float, u: float = 0.0) -> None:
        """Take the reading of the next sample.

        Args:
            y: output.
            u_before: input since the previous sample; not used at the first.
            u: input of this sample; used with feedthrough only.

        """
        first = self._count == 0
        self.innovation, self.innovation_var, norm = self.form.step(
            self._s, self.stored, self._gain, self.settings, self._y, u_before, y, u, first
        )
        self._y, self._count = y, self._count + 1
        every, below = self.reset
        if (every and self._count % every == 0) or (below and norm < below and not first):
            self.stored = self._start()

    @property
    def state(self) -> Array:
        """State x, (n,); the last component is the filtered output (without feedthrough)."""
        return self._s[: self.config.order].astype(np.float64)

    @property
    def parameters(self) -> Array:
        """Parameters a_0 ... a_(n-1), b_0 ... b_(n-1)[, b_n]: y(k) = sum a_(n-i) y(k-i) + b_(n-i) u(k-i), eq (2.8)."""
        return self._s[self.config.order :].astype(np.float64)

    @property
    def covariance(self) -> Array:
        """Covariance P, (N, N)."""
        return self.form.covariance(self.stored.astype(np.float64))

    @property
    def gain(self) -> Array:
        """Kalman gain of the last sample, (N,)."""
        return self._gain.astype(np.float64)
