"""State feedback with integral action on a model identified in flight: Kemp S 5.2, S 5.3 and the listings of CA and D.

u = -K x - K_e z, where z is the sum of the errors r - y. ``placement.assign`` places the poles of the model in observable-canonical form
augmented with z, eqs (5.15)-(5.17). Its gains equal those of Ackermann's formula, which the thesis uses, without the loss of digits.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from flightbed.control import placement
from flightbed.core.compiled import compiled

Array = npt.NDArray[np.float64]

_assign = compiled(placement.assign)
_UNLIMITED = (-np.inf, np.inf)


@dataclass(frozen=True)
class AckermannConfig:
    """Settings of the law. Input and output in the caller's units.

    Attributes:
        poles: n + 1 closed-loop poles in the z plane; complex poles with their conjugates.
        first: (n + 1,) initial gains (K, K_e), used until a model is accepted; zeros and -0.01 in Kemp S 5.4.
        signs: required sign of each gain, -1 or +1; 0 allows both. Gains of a wrong sign are rejected. Empty: no check.
        smallest_controllability: smallest accepted distance of the model from an uncontrollable one, as ``placement.assign`` measures
            it; the listing rejects exactly singular models only.
        patience: number of consecutive rejected models after which the initial gains are restored; 0: never, as in the listing.
            Without it the gains of a poor model can persist: the loop diverges along one motion, which cannot identify a better model.
        kept: share of the previous gains in a first-order filter of the gains, in [0, 1), against the flutter of Kemp S 6.3; the first
            accepted gains are not filtered. 0, as in the listing: no filter.

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
                f"first and signs must have one value for each of the {len(self.poles)} poles (got {len(self.first)} and {len(self.signs)})"
            )
        if any(sign not in (-1, 0, 1) for sign in self.signs):
            raise ValueError(f"signs must be -1, 0 or +1 (got {self.signs})")
        if any(sign * gain < 0.0 for sign, gain in zip(self.signs, self.first, strict=False)):
            raise ValueError(f"first: the gains must have the required signs {self.signs} (got {self.first})")
        if not placement.has_conjugate_pairs(np.array(self.poles, dtype=np.complex128)):
            raise ValueError("complex poles must come in conjugate pairs")
        if not self.smallest_controllability > 0.0:
            raise ValueError(f"smallest_controllability must be above 0 (got {self.smallest_controllability:g})")
        if not 0.0 <= self.kept < 1.0:
            raise ValueError(f"kept must be at least 0 and below 1 (got {self.kept:g})")
        if self.patience < 0:
            raise ValueError(f"patience must not be negative (got {self.patience})")


@compiled
def augment(theta: Array, A: Array, b: Array) -> None:
    """Write A (n+1, n+1) and b (n+1,) of the augmented state (x, z), Kemp eq (5.15).

    ``theta`` (2n,) is ``Plid.parameters`` without feedthrough.
    """
    n = b.shape[0] - 1
    A[:] = 0.0
    for i in range(n):
        if i > 0:
            A[i, i - 1] = 1.0
        A[i, n - 1] += theta[i]
        b[i] = theta[n + i]
    A[n, n - 1], A[n, n], b[n] = -1.0, 1.0, 0.0


@compiled
def place(theta: Array, poles: placement.Poles, signs: Array, least: float, kept: float, gains: Array) -> bool:
    """Compute the gains of a model; accept them if the model is controllable and their signs are allowed.

    ``kept`` is the share of the previous gains in the new ones. Returns whether the gains were accepted.
    """
    size = gains.shape[0]
    A, b, k = np.empty((size, size)), np.empty(size), np.empty(size)
    augment(theta, A, b)
    if not _assign(A, b, poles, k) >= least:
        return False
    for i in range(size):
        if not np.isfinite(k[i]) or signs[i] * k[i] < 0.0:
            return False
    for i in range(size):
        gains[i] = k[i] if kept == 0.0 else kept * gains[i] + (1.0 - kept) * k[i]
    return True


class IntegralPlacement:
    """The law; owns its gains and the integral z."""

    def __init__(self, config: AckermannConfig) -> None:
        size = len(config.poles)
        self.config = config
        self._poles = np.array(config.poles, dtype=np.complex128)
        self._signs = np.array(config.signs or (0,) * size, dtype=np.float64)
        self._gains = np.array(config.first, dtype=np.float64)
        self.integral = 0.0
        self._rejected_in_a_row, self._designed = 0, False

    @property
    def gains(self) -> Array:
        """(K, K_e), (n + 1,)."""
        return self._gains.copy()

    def design(self, theta: Array) -> bool:
        """Design the gains for a model; return whether they were accepted. If not, the previous gains stay.

        Args:
            theta: (2n,) a_0 .. a_(n-1), b_0 .. b_(n-1), as ``Plid.parameters``.

        """
        kept, least = self.config.kept if self._designed else 0.0, self.config.smallest_controllability
        taken = bool(place(theta, self._poles, self._signs, least, kept, self._gains))
        self._designed |= taken
        self._rejected_in_a_row = 0 if taken else self._rejected_in_a_row + 1
        if self._rejected_in_a_row == self.config.patience > 0:
            self._gains[:] = self.config.first
        return taken

    def settle(self, x: Array, u: float) -> None:
        """Set z so that the law demands u at the state x: bumpless start (listing of D).

        Raises:
            ValueError: K_e is 0.

        """
        if self._gains[-1] == 0.0:
            raise ValueError(
                "settle: the integral gain is 0, so no integral gives a demanded input; set an integral gain in first"
            )
        self.integral = -(u + float(self._gains[:-1] @ x)) / float(self._gains[-1])

    def demand(self, x: Array, error: float, limits: tuple[float, float] = _UNLIMITED) -> float:
        """Return the input of this sample and integrate the error for the next one.

        At a limit, an error that would drive the input further beyond it is not integrated (anti-windup, listing of D).

        Args:
            x: (n,) state, in observable-canonical form.
            error: r - y; r - x_n with Kemp's filtered feedback.
            limits: lower and upper limit of the input.

        """
        low, high = limits
        integral_gain = float(self._gains[-1])
        u = -float(self._gains[:-1] @ x) - integral_gain * self.integral
        push = -integral_gain * error
        if not ((u > high and push > 0.0) or (u < low and push < 0.0)):
            self.integral += error
        return min(max(u, low), high)
