"""Trace -> state lanes of a flight: health, saturation and detection over time. Does not import rerun."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from flightbed.analysis.metrics import at_stop
from flightbed.analysis.trace import Trace, true_share
from flightbed.core.actuator import Actuator
from flightbed.core.estimate_names import estimate_name
from flightbed.core.units import DEG
from flightbed.document import palette

_SATURATION = {"elevator": "saturation", "aileron": "saturation_aileron", "rudder": "saturation_rudder"}
_NEAR = 0.99  # share of the rate limit: the mean rate over a tick that starts at the limit is below the limit


@dataclass(frozen=True)
class Lane:
    """One discrete state over time.

    Attributes:
        key: entity path of its data.
        states: names of the states.
        colors: colours of the states, ``#rrggbb``.

    """

    key: str
    states: tuple[str, ...]
    colors: tuple[str, ...]


def lanes(detectors: Sequence[str], surfaces: Collection[str] = ("elevator",)) -> tuple[Lane, ...]:
    """Return the lanes of a flight.

    Args:
        detectors: estimates that are tested for a change of K.
        surfaces: commanded surfaces.

    """
    conditions = ("healthy", "failed", "departed"), (palette.REFERENCE, palette.FAILURE, palette.DEPARTED)
    limits = ("free", "saturated: rate", "saturated: stop"), (palette.OTHER, palette.COMMAND, palette.TRUTH)
    return (
        *(Lane(surface, *conditions) for surface in surfaces),
        Lane("airframe", ("as built", "c.g. moved"), (palette.REFERENCE, palette.FAILURE)),
        *(Lane(_SATURATION[surface], *limits) for surface in surfaces),
        *(
            Lane(f"detection_{name}", ("no change found", "change detected"), (palette.OTHER, palette.ACTUAL))
            for name in detectors
        ),
    )


def states(
    trace: Trace, lane: Lane, actuators: Mapping[str, Actuator], *, faults_s: Mapping[str, float], control_hz: int
) -> npt.NDArray[np.intp]:
    """Return the index of a lane's state at every tick (T,).

    Args:
        trace: the flight, or a part of its ticks.
        lane: one of ``lanes``.
        actuators: commanded surface -> actuator.
        faults_s: surface -> onset of its first actuator fault, s, which the trace does not contain.
        control_hz: control rate, Hz.

    """
    active: npt.NDArray[np.bool_]
    if lane.key in actuators:
        active = (trace[true_share(estimate_name("", lane.key))] != 1.0) | (
            trace["t_s"] >= faults_s.get(lane.key, np.inf) - 1e-9
        )
        if lane.key == "elevator":
            active |= trace["elevator_force_true"] != 1.0
    elif lane.key == "airframe":
        active = trace["cg_shift_cbar"] != 0.0
    elif lane.key in _SATURATION.values():
        surface = next(surface for surface, key in _SATURATION.items() if key == lane.key)
        position, actuator = trace[f"{surface}_deg"], actuators[surface]
        rate = np.abs(np.diff(position, prepend=position[:1])) * DEG * control_hz
        fast = rate >= _NEAR * actuator.rate_limit_rad_s
        return np.where(at_stop(trace, actuator, surface), 2, fast.astype(np.intp))
    else:
        active = trace[f"{lane.key.removeprefix('detection_')}.alarms"] > 0.0
    return active.astype(np.intp)
