"""Trace -> the modes of a flight over time: healthy or failed, saturated, detected. No rerun in here."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from flightbed import palette
from flightbed.aircraft import Actuator
from flightbed.metrics import at_stop
from flightbed.trace import Trace
from flightbed.units import DEG

_NEAR = 0.99  # of the rate limit: the mean rate over a tick that begins at the limit falls short of it


@dataclass(frozen=True)
class Lane:
    """One mode over time.

    Attributes:
        key: where it is logged.
        states: its names.
        colors: of the states.

    """

    key: str
    states: tuple[str, ...]
    colors: tuple[str, ...]


def lanes(detectors: Sequence[str]) -> tuple[Lane, ...]:
    """Return the lanes of a flight; ``detectors`` are the estimators that test for a change of K."""
    return (
        Lane("elevator", ("healthy", "failed", "departed"), (palette.REFERENCE, palette.FAILURE, palette.DEPARTED)),
        Lane("airframe", ("as built", "c.g. moved"), (palette.REFERENCE, palette.FAILURE)),
        Lane(
            "saturation",
            ("free", "saturated: rate", "saturated: stop"),
            (palette.OTHER, palette.COMMAND, palette.TRUTH),
        ),
        *(
            Lane(f"detection_{name}", ("no change found", "change detected"), (palette.OTHER, palette.ACTUAL))
            for name in detectors
        ),
    )


def states(trace: Trace, lane: Lane, actuator: Actuator, *, control_hz: int) -> npt.NDArray[np.intp]:
    """Return the index of the state of a lane at every tick."""
    hurt: npt.NDArray[np.bool_]
    if lane.key == "elevator":
        hurt = (trace["effectiveness_true"] != 1.0) | (trace["elevator_force_true"] != 1.0)
    elif lane.key == "airframe":
        hurt = trace["cg_shift_cbar"] != 0.0
    elif lane.key == "saturation":
        rate = np.abs(np.diff(trace["elevator_deg"], prepend=trace["elevator_deg"][:1])) * DEG * control_hz
        fast = rate >= _NEAR * actuator.rate_limit_rad_s
        return np.where(at_stop(trace, actuator), 2, fast.astype(np.intp))
    else:
        hurt = trace[f"{lane.key.removeprefix('detection_')}.alarms"] > 0.0
    return hurt.astype(np.intp)
