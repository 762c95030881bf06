"""Interface of estimators to the compiled flight computer."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar, Protocol

from flightbed.core.by_address import by_address
from flightbed.core.compiled import Array
from flightbed.core.records import layout
from flightbed.core.signals import Estimate, LateralMeasurement, Measurement

MEASUREMENT, LATERAL_MEASUREMENT, ESTIMATE = map(
    layout, (Measurement._fields, LateralMeasurement._fields, Estimate._fields)
)


# Address and call of the functions ``compiled_update``.
OBSERVERS = by_address(("array", "array", "array", "array", "array", "float", "int", "array"), "none")


class Packable(Protocol):
    """An estimator that the compiled flight computer can fly. The class itself, not a base class, has ``compiled_update``.

    ``compiled_update(memory, now, then, turning, turned, command, k, out)`` is ``update`` in compiled code:

    - memory: as from ``packed``; updated.
    - now, then: fields of the Measurement at tick k and at the tick before; at tick 0 both are those of tick 0.
    - turning, turned: the same of the LateralMeasurement; without meaning in flights without lateral axes.
    - command: elevator command that acts from the tick before, rad; nan at tick 0.
    - k: number of the tick.
    - out: fields of the estimates, one after the other; the function leaves those that it does not estimate.
    """

    compiled_update: ClassVar[Callable[..., Any]]

    def packed(self) -> Array | None:
        """Return the memory of a new estimator, flat; None if its settings have no compiled form."""
