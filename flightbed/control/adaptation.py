"""Adaptation: the correction by 1/K-hat, after the summing junction and before the actuator."""

from __future__ import annotations

from dataclasses import dataclass

from flightbed.compiling import compiled, plain


@compiled
def divisor(smoothed: float, std: float, floor: float, caution: float) -> float:
    """Return what to divide the demand by: K-hat, no less than the floor, and with caution more; see Adaptation."""
    floored = smoothed if smoothed > floor else floor
    if caution == 0.0:
        return floored
    return min(max(1.0, floored), floored + (caution * std) ** 2 / floored)


@compiled
def limited(reference: float, believed: float, low: float, high: float, trim: float, peak: float) -> float:
    """Return a reference, cut to what the elevator that is left can give between its stops; see Adaptation."""
    left = min(believed * high - trim, trim - believed * low)
    limit = max(0.0, left) / peak
    return -limit if reference < -limit else limit if reference > limit else reference


@compiled
def cut(command: float, low: float, high: float) -> float:
    """Return a command, cut at the stops."""
    return low if command < low else high if command > high else command


_divisor, _limited, _cut = plain(divisor), plain(limited), plain(cut)


@dataclass(frozen=True)
class Adaptation:
    """Turn the deflection that should act into the deflection to command.

    The demand is absolute: the elevator's trim deflection loses its moment with the rest, so the correction multiplies
    all of it, demand / K-hat, not only the deviation from trim. With ``feedback = "effective"`` the law is fed
    K-hat times the surface position: if K-hat is right the loop is then exactly the healthy one in the variable
    K times position. ``"position"`` feeds back the surface position itself, as in Sillence's Figure 1.

    Attributes:
        enabled: off means K-hat = 1 throughout.
        estimator: index of the estimator that adapts.
        floor: smallest K-hat that is believed; bounds the loop gain.
        feedback: ``"effective"`` or ``"position"``.
        min_rad, max_rad: stops of the elevator; the command is cut there.
        caution: c in K-hat + (c sigma)^2 / K-hat, the divisor. With c = 1 the deflection that then acts has the least mean square
            error over what K may be: E (K u - d)^2 is least at u = d K-hat / (K-hat^2 + sigma^2) (the cautious controller of
            Astrom and Wittenmark, Adaptive Control, 2nd ed., S 7.4). 0 takes K-hat for certain.
        oracle: believe the true K instead of an estimate; for studies of what an estimate costs.
        trim_rad: elevator of trim.
        peak_per_reference: largest deflection from trim that a reversal of the reference asks for, per rad/s of it; the reference is
            cut to what the elevator that is left can give. None never cuts it.

    """

    enabled: bool
    estimator: int
    floor: float
    feedback: str
    min_rad: float
    max_rad: float
    caution: float = 0.0
    oracle: bool = False
    trim_rad: float = 0.0
    peak_per_reference: float | None = None

    def believed(self, effectiveness_smoothed: float, std: float = 0.0) -> float:
        """Return the K-hat to divide by, from the smoothed estimate and its standard deviation."""
        return _divisor(effectiveness_smoothed, std, self.floor, self.caution) if self.enabled else 1.0

    def reference(self, q_ref_rad_s: float, believed: float) -> float:
        """Return the reference, cut to what the deflection that is left can follow, rad/s."""
        if self.peak_per_reference is None or not self.enabled:
            return q_ref_rad_s
        return _limited(q_ref_rad_s, believed, self.min_rad, self.max_rad, self.trim_rad, self.peak_per_reference)

    def position_feedback(self, position_rad: float, believed: float) -> float:
        """Return the deflection that the law is fed, rad."""
        return believed * position_rad if self.feedback == "effective" else position_rad

    def command(self, demand_rad: float, believed: float) -> float:
        """Return the command, cut at the stops, rad."""
        return _cut(demand_rad / believed, self.min_rad, self.max_rad)
