"""LinearModel -> named modes, and the flying qualities of the short period."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import inf

import numpy as np
import numpy.typing as npt

from flightbed.core.units import G0
from flightbed.models.linearize import LinearModel

_FAST = ("alpha", "q")
_SLOW = ("airspeed", "theta")


@dataclass(frozen=True)
class Mode:
    """One real eigenvalue or one complex pair.

    Attributes:
        name: name of the mode; ends in "real root" where two real roots replace an oscillation.
        eigenvalue: rad/s; for a pair the one with positive imaginary part.

    """

    name: str
    eigenvalue: complex

    @property
    def omega_n_rad_s(self) -> float:
        """Undamped natural frequency, rad/s; for a real root its magnitude."""
        return abs(self.eigenvalue)

    @property
    def zeta(self) -> float:
        """Damping ratio; for a real root 1 if stable, -1 if unstable."""
        return -self.eigenvalue.real / self.omega_n_rad_s if self.omega_n_rad_s else 1.0

    @property
    def time_constant_s(self) -> float:
        """-1 / real part, s: time to decay to 1/e, negative for growth, infinite at 0."""
        return -1.0 / self.eigenvalue.real if self.eigenvalue.real else inf


def modes(model: LinearModel) -> tuple[Mode, ...]:
    """Name the modes of a longitudinal, lateral, short-period or full model.

    In asymmetric flight the longitudinal and lateral motions are coupled: each eigenvalue of the full model then takes the name of the
    nearest eigenvalue of the uncoupled models, and an eigenvalue without a match is named "coupled".
    """
    names = {name for name, _ in model.states}
    if not {"airspeed", "beta"} <= names:
        return (longitudinal_modes if "alpha" in names else lateral_modes)(model)
    left = [*longitudinal_modes(model.subset("longitudinal")), *lateral_modes(model.subset("lateral"))]
    found = []
    for value in sorted((complex(v) for v in model.eigenvalues() if v.imag >= 0.0), key=abs, reverse=True):
        kind = [m for m in left if bool(m.eigenvalue.imag) == bool(value.imag)] or left
        near = min(kind, key=lambda m: abs(m.eigenvalue - value), default=None)
        found.append(Mode(near.name if near else "coupled", value))
        if near:
            left.remove(near)
    return tuple(found)


def lateral_modes(model: LinearModel) -> tuple[Mode, ...]:
    """Name the lateral modes: Dutch roll, roll, spiral, and heading (neutral).

    The heading is the root with the largest participation of psi. Of the oscillations, the Dutch roll is the one with the larger
    participation of beta and r; a second one is the lateral phugoid (coupled roll and spiral). Of the real roots the fastest is the
    roll, the slowest the spiral; two further real roots replace the Dutch roll.
    """
    values, share = _participation(model)
    names = [name for name, _ in model.states]
    heading = int(np.argmax(share[names.index("psi")]))
    yaw = share[names.index("beta")] + share[names.index("r")]
    pairs = sorted((i for i in range(len(values)) if values[i].imag > 0.0), key=lambda i: -yaw[i])
    reals = sorted(
        (i for i in range(len(values)) if values[i].imag == 0.0 and i != heading), key=lambda i: -abs(values[i])
    )
    named = {heading: "heading"}
    named |= dict(zip(pairs, ("Dutch roll", "lateral phugoid"), strict=False))
    if len(pairs) == 2:
        reals = []
    if reals:
        named |= dict.fromkeys(reals[1:-1], "Dutch roll, real root") | {reals[0]: "roll", reals[-1]: "spiral"}
    found = [Mode(named.get(i, "lateral"), complex(v)) for i, v in enumerate(values) if v.imag >= 0.0]
    return tuple(sorted(found, key=lambda mode: -mode.omega_n_rad_s))


def _participation(model: LinearModel) -> tuple[npt.NDArray[np.complex128], npt.NDArray[np.float64]]:
    """Return the eigenvalues (n,), rad/s, and participation factors (n, n), state by eigenvalue: left times right eigenvectors."""
    values, right = np.linalg.eig(model.A)
    try:
        share = np.abs(right * np.linalg.inv(right).T)
    except np.linalg.LinAlgError:  # a defective matrix
        share = np.abs(right) ** 2
    return np.asarray(values, dtype=np.complex128), np.asarray(share / share.sum(axis=0))


def longitudinal_modes(model: LinearModel) -> tuple[Mode, ...]:
    """Name the longitudinal modes by the participation of the states (products of left and right eigenvectors).

    Each root belongs to the group of states with the largest participation: alpha and q form the short period, airspeed and theta the
    phugoid, altitude the altitude mode. Real roots that replace a pair are named "real root"; a pair formed by one root of the short
    period and one of the phugoid is a "third oscillation".
    """
    values, share = _participation(model)
    names = [name for name, _ in model.states]

    def part(i: int, states: Iterable[str]) -> float:
        return float(sum(share[names.index(s), i] for s in states if s in names))

    kinds = []
    for i in range(len(values)):
        by_kind = {"short period": part(i, _FAST), "phugoid": part(i, _SLOW), "altitude": part(i, ["altitude"])}
        kinds.append(max(by_kind, key=lambda kind: by_kind[kind]))
    modes = []
    for i, value in enumerate(values):
        if value.imag < 0.0:
            continue
        alone = kinds.count(kinds[i]) % 2 == 1 and kinds[i] != "altitude"
        name = kinds[i]
        if value.imag > 0.0 and alone:
            name = "third oscillation"
        elif value.imag == 0.0 and kinds[i] != "altitude":
            name = f"{kinds[i]}, real root"
        modes.append(Mode(name, complex(value)))
    return tuple(sorted(modes, key=lambda mode: -mode.omega_n_rad_s))


@dataclass(frozen=True)
class FlyingQualities:
    """Short-period flying qualities by MIL-F-8785C, 3.2.2.1, category A flight phases.

    Attributes:
        n_alpha_g_rad: n/alpha, load factor per angle of attack, g/rad.
        omega_n_rad_s, zeta: natural frequency and damping ratio of the short period; None for two real roots.
        cap: control anticipation parameter omega_n^2 / (n/alpha), 1/(g s^2); None for two real roots.
        level: 1, 2 or 3; None if the requirement does not apply or level 3 is not met.

    """

    n_alpha_g_rad: float
    omega_n_rad_s: float | None
    zeta: float | None
    cap: float | None
    level: int | None


def flying_qualities(model: LinearModel) -> FlyingQualities:
    """Rate the short period of the bare airframe.

    Category A limits of MIL-F-8785C (1980), Figure 1a and Table IV: level 1 CAP 0.28 to 3.6 and zeta 0.35 to 1.30, omega_n at least 1.0;
    level 2 CAP 0.16 to 10 and zeta 0.25 to 2.0, omega_n at least 0.6; level 3 CAP at least 0.16 and zeta at least 0.15.
    n/alpha is that of the short-period approximation, -V Z_alpha / g.
    """
    names = [name for name, _ in model.states]
    n_alpha = -model.trim.airspeed_m_s * float(model.A[names.index("alpha"), names.index("alpha")]) / G0
    half = model.subset("longitudinal") if "beta" in names else model
    pair = [m for m in longitudinal_modes(half) if m.name == "short period"]
    if not pair:
        return FlyingQualities(n_alpha, None, None, None, None)
    omega, zeta = pair[0].omega_n_rad_s, pair[0].zeta
    cap = omega**2 / n_alpha
    level = None
    if 0.28 <= cap <= 3.6 and 0.35 <= zeta <= 1.30 and omega >= 1.0:
        level = 1
    elif 0.16 <= cap <= 10.0 and 0.25 <= zeta <= 2.0 and omega >= 0.6:
        level = 2
    elif cap >= 0.16 and zeta >= 0.15:
        level = 3
    return FlyingQualities(n_alpha, omega, zeta, cap, level)
