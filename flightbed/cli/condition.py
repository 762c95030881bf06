"""Options and output of the commands `trim` and `linearize`."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from cyclopts import Group, Parameter

_CONDITION = Group(
    "Flight condition",
    help="Exactly one of --mach, --tas-fps and --cas-kt is required. Speed and altitude also take a list, 0.6,0.8, or a range, "
    "FIRST:LAST:STEP: the command then sweeps all combinations.",
)


@Parameter(name="*", group=_CONDITION)
@dataclass(frozen=True)
class ConditionOptions:
    """Options for the flight condition; the strings also take lists and ranges."""

    mach: str | None = None
    "Mach number."
    tas_fps: str | None = None
    "True airspeed, ft/s."
    cas_kt: str | None = None
    "Calibrated airspeed, kt."
    altitude_ft: str = "20000"
    "Geometric altitude, ft."
    gamma_deg: float = 0.0
    "Flight-path angle, positive in a climb, deg."
    load_factor: float | None = None
    "Load factor of a pull-up with wings level, g."
    bank_deg: float = 0.0
    "Bank angle of a steady turn, right positive, deg."
    cg_shift_cbar: float = 0.0
    "C.g. shift in mean chords, aft positive."
    effectiveness: float = 1.0
    "Elevator effectiveness K; not for the aircraft that ship with JSBSim."
    engine: Literal["steady", "frozen"] = "steady"
    "Engines and propellers: steady, at the steady state of each motion; or frozen, with spool, propeller speed and manifold pressure as \
trimmed and without the throttle as an input."


def deliver(content: bytes, output: Path | None) -> None:
    """Write the output of a command to a file, atomically, or to stdout if None."""
    from flightbed.core.files import write_atomic

    if output is not None:
        write_atomic(output, content)
        return
    sys.stdout.buffer.write(content)
    sys.stdout.buffer.flush()
