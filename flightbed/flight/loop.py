"""The flight loop: ``Loop`` alternates between the work on board and one control period of the plant; ``fly`` yields one Sample per tick.

The loop owns the plant, the failures, the transport delay and the end of the flight. All work on board belongs to a flight computer:
``composed.Composed``, of objects of any origin, or ``computer.Compiled``, one compiled call per tick.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from math import isnan
from typing import Protocol

from flightbed.core.signals import Health, Sample
from flightbed.flight.composed import Composed
from flightbed.flight.ending import Ended
from flightbed.flight.parts import Flight


class Computer(Protocol):
    """A flight computer: all work on board at one tick. Its ticks are taken in order, each once."""

    @property
    def ended(self) -> Ended | None:
        """End condition that holds at the latest tick; None while the flight flies."""

    @property
    def listeners(self) -> Sequence[Callable[[float], object]]:
        """Functions that take the elevator command that acts from a tick on, rad."""

    def step(self, tick: int, health: Health) -> float:
        """Sense, estimate and decide at a tick; return the elevator command, rad, or nan if the flight ends here."""

    def sample(self) -> Sample:
        """Return all signals of the latest tick."""

    def replace(self, elevator_cmd_rad: float) -> None:
        """Take the command that replaces the law's at the latest tick; the law holds its integral at the next one."""

    def lateral_command(self) -> tuple[float, float]:
        """Return the commands to aileron and rudder of the latest tick, rad."""

    def throttle_norm(self) -> float:
        """Return the throttle command of the latest tick; nan keeps the throttle."""


class Loop:
    """One flight, tick by tick: ``sense`` does the work on board, ``advance`` flies one control period.

    Args:
        flight: assembled, at its start.
        computer: flight computer of this flight.

    Attributes:
        tick: number of the present tick.
        ended: None while the flight flies; set by ``sense`` at the last tick: the profile ends ("time"), or an end condition holds.

    """

    def __init__(self, flight: Flight, computer: Computer) -> None:
        plant = flight.plant
        self._computer, self._step, self._fly = computer, computer.step, plant.advance
        self._listeners = computer.listeners
        self._health_at = flight.health
        self._following = flight.health(0)
        self._health = self._following
        self._last = flight.ticks - 1
        still = plant.sense().elevator_rad
        self._delayed = deque([still] * flight.delay_ticks)
        self._axes, self._load_factor = flight.lateral, flight.load_factor
        self._delayed_lateral = deque([(0.0, 0.0)] * flight.delay_ticks)
        self._command, self._is_sensed, self._is_over = still, False, False
        self.tick = 0
        self.ended: Ended | None = None

    def sense(self) -> None:
        """Do the work on board of the present tick; once per tick.

        Raises:
            EstimateError: the smoothed K of a correcting estimator is not finite.

        """
        if self._is_sensed:
            return
        tick = self.tick
        self._health = health = self._following
        self._following = self._health_at(tick + 1)
        self._command = command = self._step(tick, health)
        self._is_sensed = True
        if command != command:
            self.ended = self._computer.ended
        if tick == self._last and self.ended is None:
            self.ended = "time"

    def sample(self) -> Sample:
        """Return all signals of the present tick, after ``sense``."""
        return self._computer.sample()

    def advance(self, command_rad: float | None = None) -> None:
        """Fly one control period, with the law's command or the given one; senses first if that was not done at this tick.

        At the last tick no period follows, and nothing flies.

        Raises:
            RuntimeError: the flight was over before.
            EstimateError: as ``sense``.
            ValueError: damage that the plant does not model.

        """
        if not self._is_sensed:
            self.sense()
        tick, command = self.tick, self._command  # error messages read the tick here
        if self.ended is not None:
            if self._is_over:
                raise RuntimeError(f"advance: the flight ended at tick {tick} ({self.ended}); start a new one")
            self._is_over = True
            return
        if command_rad is not None:
            command = command_rad
            self._computer.replace(command)
        for listen in self._listeners:
            listen(command)
        if self._axes is not None:
            self._delayed_lateral.append(self._computer.lateral_command())
            self._axes.plant.steer(*self._delayed_lateral.popleft())
        if self._load_factor is not None and not isnan(throttle := self._computer.throttle_norm()):
            self._load_factor.plant.throttle(throttle)
        if self._delayed:
            self._delayed.append(command)
            command = self._delayed.popleft()
        self._fly(command, self._health, self._following)
        self.tick = tick + 1
        self._is_sensed = False


def fly(flight: Flight, computer: Computer | None = None) -> Iterator[Sample]:
    """Fly and yield one Sample per control tick, up to the end of the profile, a departure, or the ground (that sample included).

    Args:
        flight: assembled, at its start.
        computer: its flight computer; None for one composed of the flight's objects.

    Raises:
        EstimateError: the smoothed K of a correcting estimator is not finite.

    """
    loop = Loop(flight, computer or Composed(flight))
    while loop.ended is None:
        loop.sense()
        yield loop.sample()
        loop.advance()
