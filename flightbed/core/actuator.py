"""On-board model of the elevator's actuator."""

from __future__ import annotations

from dataclasses import dataclass
from math import nan

import numpy as np


@dataclass(frozen=True)
class Actuator:
    """A first-order lag with rate and position limits.

    Attributes:
        lag_rad_s: bandwidth of the lag, rad/s.
        rate_limit_rad_s: largest rate, rad/s.
        min_rad, max_rad: position limits, rad.

    """

    lag_rad_s: float
    rate_limit_rad_s: float
    min_rad: float
    max_rad: float


class ActuatorOnBoard:
    """Response of a healthy actuator to its commands: stops, lag, rate limit, in JSBSim's order, one step per tick; owns its position, rad.

    The rate limit follows the lag and does not feed back to it: a rate-limited surface reverses when the lag's output crosses it.
    """

    def __init__(self, actuator: Actuator, control_hz: int, delay_ticks: int) -> None:
        self._actuator, self._delay = actuator, delay_ticks
        self._share = 1.0 - float(np.exp(-actuator.lag_rad_s / control_hz))
        self._mean = (
            1.0 - self._share * control_hz / actuator.lag_rad_s
        )  # mean response of the lag over a period, as a share of the step
        self._step = actuator.rate_limit_rad_s / control_hz
        self._commands: list[float] = []
        self._lagged = self._position = nan

    def packed(self) -> dict[str, float]:
        """Return the numbers of a new one by name, for compiled callers."""
        actuator = self._actuator
        return {
            "has_actuator": 1.0, "delay": self._delay, "share": self._share, "mean": self._mean, "step": self._step,
            "low": actuator.min_rad, "high": actuator.max_rad, "lagged": nan, "position": nan,
        }  # fmt: skip

    def commanded(self, command: float) -> None:
        """Take the command of a tick; at the first tick the actuator is at its command."""
        self._commands.append(command)
        if self._position != self._position:
            self._lagged = self._position = command
            self._commands = [command] * (1 + self._delay)

    def mean(self) -> float:
        """Return the mean position over the period that ends now, rad, and advance; nan before the first command."""
        if not self._commands:
            return nan
        low, high = self._actuator.min_rad, self._actuator.max_rad
        command = min(max(self._commands.pop(0), low), high)
        lagged, begun = self._lagged, self._position
        self._lagged += self._share * (command - lagged)
        way = self._lagged - begun
        late = abs(way) > self._step
        self._position = begun + (self._step if way > 0.0 else -self._step) if late else self._lagged
        if late or begun != lagged:
            return 0.5 * (begun + self._position)
        return begun + self._mean * (command - begun)
