"""Schedule, from an Airframe: tables of the pitch dynamics over Mach number and alpha, for the on-board model.

    alpha' = q + [qbar (n + n_delta(d)) + (qbar/V) n_q q + g cos-terms + thrust] / V
    q'     =      qbar (m + m_delta(d)) + (qbar/V) m_q q + thrust moment

where d is the effective deflection (K times position), qbar follows from Mach number and altitude, and gravity from attitude. The
coefficients are tables over (Mach, alpha), bilinear between nodes; n_delta and m_delta are also piecewise linear in d. A pair of
nodes encloses each breakpoint of the aircraft's own tables, so that a discontinuity of the aircraft is reproduced.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

NORMAL, NORMAL_Q, MOMENT, MOMENT_Q, BY_ELEVATOR = 0, 1, 2, 3, 4


@dataclass(frozen=True, eq=False)
class Schedule:
    """The pitch model over the envelope. SI, radians.

    Attributes:
        mach: (M,) nodes; alpha_rad: (N,); elevator_rad: (E,), including 0; altitude_m: (H,), for thrust only.
        coefficients: (M, N, 4 + 2 E): n, n_q, m, m_q, then n_delta and m_delta at the elevator's nodes; m/s^2 and rad/s^2 per Pa,
            n_q and m_q per Pa s/m and rad/s.
        thrust_n: (M, H) thrust at the throttle setting.
        per_newton: (3,) accelerations along body x and z (m/s^2) and in pitch (rad/s^2) per N of thrust.
        span_m: (1,) wing span, which converts the gradient of a gust into a pitch rate.

    """

    mach: Array
    alpha_rad: Array
    elevator_rad: Array
    altitude_m: Array
    coefficients: Array
    thrust_n: Array
    per_newton: Array
    span_m: Array

    def packed(self) -> Array:
        """Return all tables as one array, in the layout of ``avionics.pitch_kernels``."""
        parts = (self.mach, self.alpha_rad, self.elevator_rad, self.altitude_m)
        sizes = [float(len(p)) for p in parts]
        return np.concatenate(
            [sizes, self.per_newton, self.span_m, *parts, self.thrust_n.ravel(), self.coefficients.ravel()]
        )

    def scaled(
        self, *, cm_alpha: float = 1.0, cm_q: float = 1.0, cm_delta: float = 1.0, about_rad: float = 0.0
    ) -> Schedule:
        """Return a schedule with model errors, as factors on C_mq, C_m_delta and the change of C_m(alpha) from ``about_rad``."""
        wrong, E = self.coefficients.copy(), len(self.elevator_rad)
        here = np.array([np.interp(about_rad, self.alpha_rad, row) for row in wrong[:, :, MOMENT]])
        wrong[:, :, MOMENT] = here[:, None] + cm_alpha * (wrong[:, :, MOMENT] - here[:, None])
        wrong[:, :, MOMENT_Q] *= cm_q
        wrong[:, :, BY_ELEVATOR + E :] *= cm_delta
        return replace(self, coefficients=wrong)
