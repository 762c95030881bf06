"""State feedback with integral action on a model that is identified in flight: Kemp S 5.2, S 5.3 and the listings of CA and D.

u = -K x - K_e z, z the sum of the errors r - y. The gains place the poles of the model in observable-canonical form with z beside it, eqs
(5.15)-(5.17), by ``placement.assign``: the same gains as Ackermann's formula, which the thesis uses, without its loss of digits.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from flightbed.compiling import compiled
from flightbed.control import placement

Array = npt.NDArray[np.float64]

_assign = compiled(placement.assign)
_UNLIMITED = (-np.inf, np.inf)


@dataclass(frozen=True)
class AckermannConfig:
    """Settings of the law. Input and output in the caller's units.

    Attributes:
        poles: n + 1 of the closed loop, in the z plane; complex ones with their conjugates.
        first: gains (K, K_e) until a model gives others, n + 1; zeros and -0.01 in Kemp S 5.4.
        signs: of each gain, -1, 0 or +1, 0 for any: gains with another sign are rejected. Empty for no such rule.
        smallest_controllability: gains of a model that is nearer to an uncontrollable one, as ``placement.assign`` measures it, are
            rejected; the listing rejects only what is singular to the last bit.
        patience: after so many models in a row that were rejected the first gains are taken again; 0 never, as the listing. Gains that
            a poor model gave can be kept for good: they make the loop diverge along one motion, from which no better model is told.
        kept: share of the gains before that is kept when gains are taken, 0 to below 1, but for the first that are: a low pass against
            the flutter of Kemp S 6.3. 0, the listing, takes them at once.

    """

    poles: tuple[complex, ...]
    first: tuple[float, ...]
    signs: tuple[int, ...] = ()
    smallest_controllability: float = 1e-8
    patience: int = 0
    kept: float = 0.0

    def __post_init__(self) -> None:
        if len(self.first) != len(self.poles) or len(self.signs) not in (0, len(self.poles)):
            raise ValueError(
                f"{len(self.poles)} poles need as many first gains and signs (got {len(self.first)} and {len(self.signs)})"
            )
        if any(sign not in (-1, 0, 1) for sign in self.signs):
            raise ValueError(f"signs are -1, 0 or +1 (got {self.signs})")
        if any(sign * gain < 0.0 for sign, gain in zip(self.signs, self.first, strict=False)):
            raise ValueError("the first gains do not have the signs that are asked for")
        if not placement.paired(np.array(self.poles, dtype=np.complex128)):
            raise ValueError("complex poles must come in conjugate pairs")
        if not self.smallest_controllability > 0.0:
            raise ValueError("smallest_controllability must be above 0: at 0 nothing can be divided by")
        if not 0.0 <= self.kept < 1.0:
            raise ValueError(f"kept must be at least 0 and below 1 (got {self.kept:g})")
        if self.patience < 0:
            raise ValueError(f"patience must not be negative (got {self.patience})")


@compiled
def augmented(theta: Array, A: Array, b: Array) -> None:
    """Write the matrices of (x, z), Kemp eq (5.15): A (n+1, n+1), b (n+1,); theta (2n,) as ``Plid.parameters``, no feedthrough."""
    n = b.shape[0] - 1
    A[:] = 0.0
    for i in range(n):
        if i > 0:
            A[i, i - 1] = 1.0
        A[i, n - 1] += theta[i]
        b[i] = theta[n + i]
    A[n, n - 1], A[n, n], b[n] = -1.0, 1.0, 0.0


@compiled
def _design(theta: Array, poles: placement.Poles, signs: Array, least: float, kept: float, gains: Array) -> bool:
    """Take the gains of a model, if it is controllable and their signs are allowed; tell whether they were taken.

    ``kept`` is the share of those before that stays.
    """
    size = gains.shape[0]
    A, b, k = np.empty((size, size)), np.empty(size), np.empty(size)
    augmented(theta, A, b)
    if not _assign(A, b, poles, k) >= least:
        return False
    for i in range(size):
        if not np.isfinite(k[i]) or signs[i] * k[i] < 0.0:
            return False
    for i in range(size):
        gains[i] = k[i] if kept == 0.0 else kept * gains[i] + (1.0 - kept) * k[i]
    return True


class IntegralPlacement:
    """The law at work; owns its gains and z."""

    def __init__(self, config: AckermannConfig) -> None:
        size = len(config.poles)
        self.config = config
        self._poles = np.array(config.poles, dtype=np.complex128)
        self._signs = np.array(config.signs or (0,) * size, dtype=np.float64)
        self._gains = np.array(config.first, dtype=np.float64)
        self.integral, self.rejected = 0.0, 0
        self._rejected_in_a_row, self._designed = 0, False

    @property
    def gains(self) -> Array:
        """(K, K_e), (n + 1,)."""
        return self._gains.copy()

    def design(self, theta: Array) -> bool:
        """Take the gains of a model; returns whether they were taken, or those from before are kept.

        Args:
            theta: (2n,) a_0 .. a_(n-1), b_0 .. b_(n-1), as ``Plid.parameters``.

        """
        kept, least = self.config.kept if self._designed else 0.0, self.config.smallest_controllability
        taken = bool(_design(theta, self._poles, self._signs, least, kept, self._gains))
        self._designed |= taken
        self.rejected += not taken
        self._rejected_in_a_row = 0 if taken else self._rejected_in_a_row + 1
        if self._rejected_in_a_row == self.config.patience > 0:
            self._gains[:] = self.config.first
        return taken

    def settle(self, x: Array, u: float) -> None:
        """Set z so that the law asks for u at the state x: a start without a bump (listing of D). K_e must not be 0."""
        if self._gains[-1] == 0.0:
            raise ValueError("without an integral gain there is no integral that asks for a given input")
        self.integral = -(u + float(self._gains[:-1] @ x)) / float(self._gains[-1])

    def demand(self, x: Array, error: float, limits: tuple[float, float] = _UNLIMITED) -> float:
        """Return the input of this sample, and integrate the error for the next.

        At a limit an error that would push further beyond it is not integrated (listing of D).

        Args:
            x: (n,) state, in observable-canonical form.
            error: r - y; with Kemp's filtered feedback r - x_n.
            limits: of the input.

        """
        low, high = limits
        integral_gain = float(self._gains[-1])
        u = -float(self._gains[:-1] @ x) - integral_gain * self.integral
        push = -integral_gain * error
        if not ((u > high and push > 0.0) or (u < low and push < 0.0)):
            self.integral += error
        return min(max(u, low), high)
