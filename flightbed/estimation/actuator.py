"""What the flight computer knows of the elevator's actuator."""

from __future__ import annotations

from math import nan

import numpy as np

from flightbed.aircraft import Actuator


class ActuatorOnBoard:
    """What an actuator in order makes of its commands: stops, lag, rate limit, in JSBSim's order, one step a tick; owns its position, rad.

    The rate limit follows the lag and does not hold it back: a surface that is late turns round when the lag's output meets it.
    """

    def __init__(self, actuator: Actuator, control_hz: int, delay_ticks: int) -> None:
        self._actuator, self._delay = actuator, delay_ticks
        self._share = 1.0 - float(np.exp(-actuator.lag_rad_s / control_hz))
        self._mean = (
            1.0 - self._share * control_hz / actuator.lag_rad_s
        )  # of the way, that a lag has gone on the average of a period
        self._step = actuator.rate_limit_rad_s / control_hz
        self._commands: list[float] = []
        self._lagged = self._position = nan

    def commanded(self, command: float) -> None:
        """Take the command of a tick; in the first the actuator is where it was told to be."""
        self._commands.append(command)
        if self._position != self._position:
            self._lagged = self._position = command
            self._commands = [command] * (1 + self._delay)

    def mean(self) -> float:
        """Return the mean position over the period that has ended, and move on; nan if nobody told a command."""
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
