"""A flight that Python code steps, tick by tick, with the scenario's law or with its own elevator command."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from math import isfinite
from numbers import Real
from pathlib import Path
from typing import Any

from flightbed.config.overrides import setting
from flightbed.config.tracebacks import error_context
from flightbed.core.signals import Sample
from flightbed.flight.assembly import assemble
from flightbed.flight.composed import Composed
from flightbed.flight.computer import computer_of
from flightbed.flight.ending import Ended
from flightbed.flight.loop import Loop
from flightbed.flight.plan import plan
from flightbed.scenario.own_code import named_extensions
from flightbed.scenario.reading import load_scenario
from flightbed.scenario.tables import Scenario


class Stepper:
    """One flight of a scenario, one control tick at a time; ``fly`` yields the same samples.

    At each tick ``sense`` returns the sample and ``advance`` flies one control period. The flight ends at the tick whose sample is the
    last: ``ended`` is then set, and ``advance`` flies nothing more, because no control period follows.

    Args:
        scenario: a Scenario, the path of a file, a shipped name, or the contents of a file as a mapping.
        overrides: of a scenario that is not a Scenario: KEY=VALUE texts, such as ``"failures.0.to=0.35"``, or a mapping of such keys.

    Raises:
        InputError, NotComputableError: as ``load_scenario`` and ``run``.
        ValueError: overrides of a Scenario.

    """

    def __init__(
        self,
        scenario: Scenario | str | Path | Mapping[str, Any],
        overrides: Sequence[str] | Mapping[str, Any] = (),
    ) -> None:
        if isinstance(overrides, Mapping):
            overrides = [setting(key, value) for key, value in overrides.items()]
        if not isinstance(scenario, Scenario):
            scenario = load_scenario(scenario, overrides)
        elif overrides:
            raise ValueError(f"overrides: apply to a name or a file, not to a Scenario (got {', '.join(overrides)})")
        self._scenario, self._own = scenario, named_extensions(scenario)
        flight = assemble(plan(scenario))
        self._loop = Loop(flight, Composed(flight) if self._own else computer_of(flight))
        self._sample: Sample | None = None

    @property
    def scenario(self) -> Scenario:
        """The scenario with all overrides."""
        return self._scenario

    @property
    def ended(self) -> Ended | None:
        """None while the flight flies; from the last sample on ``"time"``, ``"departed"`` or ``"ground"``."""
        return self._loop.ended

    def sense(self) -> Sample:
        """Return all signals of the present tick; the same Sample however often it is called. The last Sample stays after the end.

        ``elevator_cmd_rad`` is the command of the scenario's law, which ``advance()`` flies.

        Raises:
            EstimateError: the smoothed K of a correcting estimator is not finite.

        """
        if self._sample is None:
            with self._errors():
                self._loop.sense()
                self._sample = self._loop.sample()
        return self._sample

    def advance(self, command_rad: float | None = None) -> None:
        """Fly one control period, from the present tick to the next one. At the last tick it flies nothing.

        Args:
            command_rad: position command of the elevator's actuator, rad, before transport delay, rate limit and stops, in place of law
                and correction; it acts from the present tick on. None flies the scenario's law. Estimators run on, and those that use
                commands get this one. The law runs on as well, with its integral held at the tick after a given command. Aileron,
                rudder and throttle stay with the scenario's laws. Beyond a stop the actuator stays at the stop; a linear aircraft has
                no stops.

        Raises:
            ValueError: command_rad is not a finite number.
            RuntimeError: the flight was over before.
            EstimateError: as ``sense``.

        """
        if command_rad is not None:
            command_rad = _checked(command_rad)
        with self._errors():
            self._loop.advance(command_rad)
        if self._loop.ended is None:
            self._sample = None

    def _errors(self) -> AbstractContextManager[None]:
        """Convert errors of external code, if the scenario names any."""
        return error_context(self._scenario.rates.control_hz, self._own) if self._own else nullcontext()


def _checked(command_rad: object) -> float:
    if isinstance(command_rad, bool) or not isinstance(command_rad, Real) or not isfinite(command_rad):
        raise ValueError(f"command_rad: must be a finite number, rad, or None (got {command_rad!r})")
    return float(command_rad)
