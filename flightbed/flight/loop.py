"""The flight loop: ``halves`` alternates between the work on board and one control period of the plant; ``fly`` yields one Sample per tick.

The loop owns the plant, the failures, the transport delay and the end of the flight. All work on board belongs to a flight computer:
``composed.Composed``, of objects of any origin, or ``computer.Compiled``, one compiled call per tick.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
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

    @property
    def step(self) -> Callable[[int, Health], float]:
        """Function (tick, health) that senses, estimates and decides; the elevator command, rad, or nan if the flight ends here."""

    def sample(self) -> Sample:
        """Return all signals of the latest tick."""

    def replace(self, elevator_cmd_rad: float) -> None:
        """Take the command that replaces the law's at the latest tick; the law holds its integral at the next one."""

    def lateral_command(self) -> tuple[float, float]:
        """Return the commands to aileron and rudder of the latest tick, rad."""

    def throttle_norm(self) -> float:
        """Return the throttle command of the latest tick; nan keeps the throttle."""


def halves(flight: Flight, computer: Computer) -> Generator[None, float | None]:
    """Fly: at each tick do the work on board and yield, then fly one control period and yield; end after the work of the last tick.

    The value sent at the first of the two yields is a command that replaces the law's, rad; None flies the law's. This is the only function
    that advances a plant, and a generator, because attributes of an object would cost 3 % of a tick.

    Args:
        flight: assembled, at its start.
        computer: flight computer of this flight.

    Raises:
        EstimateError: the smoothed K of a correcting estimator is not finite.
        ValueError: damage that the plant does not model.

    """
    plant, axes, load_factor, health_at = flight.plant, flight.lateral, flight.load_factor, flight.health
    step, advance, listeners = computer.step, plant.advance, computer.listeners
    following, last, delay = health_at(0), flight.ticks - 1, flight.delay_ticks
    delayed, delayed_lateral = deque([plant.sense().elevator_rad] * delay), deque([(0.0, 0.0)] * delay)
    for tick in range(flight.ticks):  # error messages read ``tick``
        health, following = following, health_at(tick + 1)
        command = step(tick, health)
        given = yield
        if tick == last or (command != command and computer.ended is not None):
            return
        if given is not None:
            command = given
            computer.replace(command)
        for listen in listeners:
            listen(command)
        if axes is not None:
            delayed_lateral.append(computer.lateral_command())
            axes.plant.steer(*delayed_lateral.popleft())
        if load_factor is not None and not isnan(throttle := computer.throttle_norm()):
            load_factor.plant.throttle(throttle)
        if delay:
            delayed.append(command)
            command = delayed.popleft()
        advance(command, health, following)
        yield


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
        self._computer, self._halves, self._last = computer, halves(flight, computer), flight.ticks - 1
        self._is_sensed, self._is_over = False, False
        self.tick = 0
        self.ended: Ended | None = None

    def sense(self) -> None:
        """Do the work on board of the present tick; once per tick.

        Raises:
            EstimateError: the smoothed K of a correcting estimator is not finite.

        """
        if self._is_sensed:
            return
        try:
            next(self._halves)
        except StopIteration:  # an error ended the generator
            raise RuntimeError(f"sense: the flight failed at tick {self.tick}; start a new one") from None
        self._is_sensed = True
        self.ended = self._computer.ended or ("time" if self.tick == self._last else None)

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
        self.sense()
        if self.ended is not None:
            if self._is_over:
                raise RuntimeError(f"advance: the flight ended at tick {self.tick} ({self.ended}); start a new one")
            self._is_over = True
            return
        self._halves.send(command_rad)
        self.tick += 1
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
