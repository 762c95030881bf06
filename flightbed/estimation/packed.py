"""Interface of estimators to the compiled flight computer."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from flightbed.core.compiled import Array
from flightbed.core.records import layout
from flightbed.core.signals import Estimate, LateralMeasurement, Measurement

MEASUREMENT, LATERAL_MEASUREMENT, ESTIMATE = map(
    layout, (Measurement._fields, LateralMeasurement._fields, Estimate._fields)
)


@runtime_checkable
class Packable(Protocol):
    """An estimator that the compiled flight computer can fly; ``flight/computer.py`` lists its function ``observe``.

    ``observe(memory, now, then, turning, turned, command, k, out)`` is ``update`` in compiled code:

    - memory: as from ``packed``; updated.
    - now, then: fields of the Measurement at tick k and at the tick before; at tick 0 both are those of tick 0.
    - turning, turned: the same of the LateralMeasurement; without meaning in flights without lateral axes.
    - command: elevator command that acts from the tick before, rad; nan at tick 0 and for estimators that do not use commands.
    - k: number of the tick.
    - out: fields of the estimates, one after the other; ``observe`` leaves those that it does not estimate.
    """

    def packed(self) -> Array | None:
        """Return the memory of a new estimator, flat; None if its settings have no compiled form."""
