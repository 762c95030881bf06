"""What the flight computer knows of the elevator's actuator."""

from __future__ import annotations

from math import nan

import numpy as np

from flightbed.aircraft import Actuator


class ActuatorOnBoard:
    """What an actuator in order makes of its commands: lag, rate limit and stops, one step a tick; owns its position, rad."""

    def __init__(self, actuator: Actuator, control_hz: int, delay_ticks: int) -> None:
        self._actuator, self._delay = actuator, delay_ticks
        self._share = 1.0 - float(np.exp(-actuator.lag_rad_s / control_hz))
        self._mean = (
            1.0 - self._share * control_hz / actuator.lag_rad_s
        )  # of the way, that a lag has gone on the average of a period
        self._step = actuator.rate_limit_rad_s / control_hz
        self._commands: list[float] = []
        self._position = nan

    def commanded(self, command: float) -> None:
        """Take the command of a tick; in the first the actuator is where it was told to be."""
        self._commands.append(command)
        if self._position != self._position:
            self._position = command
            self._commands = [command] * (1 + self._delay)

    def mean(self) -> float:
        """Return the mean position over the period that has ended, and move on; nan if nobody told a command."""
        if not self._commands:
            return nan
        low, high = self._actuator.min_rad, self._actuator.max_rad
        command, begun = min(max(self._commands.pop(0), low), high), self._position
        way = command - begun
        moved = self._share * way
        if abs(moved) > self._step:
            moved = self._step if moved > 0.0 else -self._step
            self._position = begun + moved
            return begun + 0.5 * moved
        self._position = begun + moved
        return begun + self._mean * way
