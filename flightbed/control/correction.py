"""Adaptation: the correction of the command by 1/K-hat, between the summing junction and the actuator."""

from __future__ import annotations

from dataclasses import dataclass

from flightbed.core.compiled import compiled, plain


@compiled
def divisor(smoothed: float, std: float, floor: float, caution: float) -> float:
    """Return the divisor of the demand: K-hat, at least the floor, increased by caution; see Adaptation."""
    floored = smoothed if smoothed > floor else floor
    if caution == 0.0:
        return floored
    return min(max(1.0, floored), floored + (caution * std) ** 2 / floored)


@compiled
def limit_reference(reference: float, effectiveness: float, low: float, high: float, trim: float, peak: float) -> float:
    """Return the reference, limited to the range that the remaining elevator can follow between its stops; see Adaptation."""
    left = min(effectiveness * high - trim, trim - effectiveness * low)
    limit = max(0.0, left) / peak
    return -limit if reference < -limit else limit if reference > limit else reference


@compiled
def clip_command(command: float, low: float, high: float) -> float:
    """Return the command, limited to the stops."""
    return low if command < low else high if command > high else command


_divisor, _limit_reference, _clip_command = plain(divisor), plain(limit_reference), plain(clip_command)


@dataclass(frozen=True)
class Adaptation:
    """Convert the demanded effective deflection into a command.

    The demand is absolute. A loss of effectiveness also reduces the moment of the trim deflection, so the correction divides the whole
    demand by K-hat, not only its deviation from trim. With ``feedback = "effective"`` the law is fed K-hat times the surface
    position: if K-hat equals K, the loop in the variable K times position is exactly the healthy loop. ``"position"`` feeds back
    the surface position itself, as in Sillence's Figure 1.

    Attributes:
        enabled: False: K-hat = 1 throughout.
        estimator: index of the estimator that supplies K-hat.
        floor: lower bound of K-hat in the correction; bounds the loop gain.
        feedback: ``"effective"`` or ``"position"``.
        min_rad, max_rad: stops of the elevator; the command is limited to them.
        caution: c in the divisor K-hat + (c sigma)^2 / K-hat. With c = 1 the effective deflection has the least mean square error
            over the distribution of K: E (K u - d)^2 is least at u = d K-hat / (K-hat^2 + sigma^2) (the cautious controller of
            Astrom and Wittenmark, Adaptive Control, 2nd ed., S 7.4). 0 treats K-hat as exact.
        oracle: use the true K instead of an estimate, to study the cost of estimation.
        trim_rad: elevator deflection at trim.
        peak_per_reference: largest deflection from trim that a reversal of the reference demands, per rad/s of the reference; the
            reference is limited so that the remaining elevator can follow it. None: no limit.

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

    def effectiveness_used(self, effectiveness_smoothed: float, std: float = 0.0) -> float:
        """Return the effectiveness that divides the demand, from the smoothed estimate and its standard deviation."""
        return _divisor(effectiveness_smoothed, std, self.floor, self.caution) if self.enabled else 1.0

    def reference(self, q_ref_rad_s: float, effectiveness: float) -> float:
        """Return the reference, limited to the range that the remaining elevator can follow, rad/s."""
        if self.peak_per_reference is None or not self.enabled:
            return q_ref_rad_s
        return _limit_reference(
            q_ref_rad_s, effectiveness, self.min_rad, self.max_rad, self.trim_rad, self.peak_per_reference
        )

    def position_feedback(self, position_rad: float, effectiveness: float) -> float:
        """Return the deflection to feed back to the law, rad."""
        return effectiveness * position_rad if self.feedback == "effective" else position_rad

    def command(self, demand_rad: float, effectiveness: float) -> float:
        """Return the command, limited to the stops, rad."""
        return _clip_command(demand_rad / effectiveness, self.min_rad, self.max_rad)
