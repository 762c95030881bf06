"""Trace of a flight that is commanded in g -> how a pull-up went: overshoot, undershoot, and how busy the elevator is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import nan
from types import MappingProxyType

import numpy as np

from flightbed.trace import Vector

COLUMNS = (
    "t_s", "nz_g", "theta_deg", "phi_deg", "nz_cmd_g", "theta_meas_deg", "phi_meas_deg", "elevator_cmd_deg",
)  # fmt: skip
# What metrics.json and campaigns tell of it: unit, and what it is.
PULL_UP_METRICS: Mapping[str, tuple[str, str]] = MappingProxyType(
    {
        "pull_up_overshoot": (
            "1",
            "of the first pulse in g: largest increment over level flight in it, over the command, less 1",
        ),
        "pull_up_undershoot": (
            "1",
            "largest increment of the other side in the 3 s after its release, over the command",
        ),
        "pull_up_disturbance_g": ("g", "largest increment in the 2 s before it"),
        "pull_up_flutter_deg": (
            "deg",
            "RMS of the elevator command above 5 Hz, but for 0.5 s after each step of the command",
        ),
    }
)
FLUTTER_HZ = 5.0  # above what a loop with poles at -4 +- 2j and -10 rad/s asks of the elevator
_AFTER_S, _EDGE_S = 3.0, 0.5
_LOST = 4.0  # times the command


@dataclass(frozen=True)
class PullUp:
    """How one went, in increments a_n over level flight.

    Attributes:
        overshoot: largest a_n during the pulse, over the command, less 1; below 0 if it is not reached.
        undershoot: the same of the other side, in the 3 s after its release, over the command; nan if it is not released.
        disturbance_g: largest |a_n| in the 2 s before it: what a failure that came then has done.
        flutter_deg: RMS of the elevator command above 5 Hz, but for 0.5 s after each change of the command, in which every loop is busy.
        tracking_rms_g: RMS of a_n less the command, from the pulse's begin to 3 s after its release: what quickness is worth.
        lost: the flight ended early (before the pulse: then the rest is nan), |a_n| went beyond four times the command, or in the second
            half of the pulse its mean was not within half of the command.

    """

    overshoot: float
    undershoot: float
    disturbance_g: float
    flutter_deg: float
    tracking_rms_g: float
    lost: bool


def increment_g(columns: Mapping[str, Vector]) -> Vector:
    """Return the true a_n = nz - cos theta cos phi, up positive."""
    level: Vector = columns["nz_g"] - np.cos(np.radians(columns["theta_deg"])) * np.cos(np.radians(columns["phi_deg"]))
    return level


def command_g(columns: Mapping[str, Vector]) -> Vector:
    """Return the command as an increment: the column holds the measured level flight, which is taken off again."""
    level = np.cos(np.radians(columns["theta_meas_deg"])) * np.cos(np.radians(columns["phi_meas_deg"]))
    command: Vector = np.round(columns["nz_cmd_g"] - level, 9)
    return command


def high_passed(values: Vector, *, control_hz: int, above_hz: float = FLUTTER_HZ) -> Vector:
    """Return what of a record lies above a frequency, by its Fourier transform; the line from its first to its last value is taken off."""
    n = len(values)
    spectrum = np.fft.rfft(values - np.linspace(values[0], values[-1], n))
    spectrum[np.fft.rfftfreq(n, 1.0 / control_hz) < above_hz] = 0.0
    return np.asarray(np.fft.irfft(spectrum, n), dtype=np.float64)


def pull_up(columns: Mapping[str, Vector], *, control_hz: int, ticks: int) -> PullUp:
    """Measure the first pulse of a flight's command.

    Args:
        columns: ``COLUMNS`` of the trace.
        control_hz: rate of its rows.
        ticks: of the flight if it does not end early.

    Raises:
        ValueError: nothing is commanded in it.

    """
    command, found = command_g(columns), increment_g(columns)
    on = np.flatnonzero(command)
    if not on.size:
        if len(command) < ticks:
            return PullUp(nan, nan, nan, nan, nan, lost=True)
        raise ValueError("the flight has no pull-up: its command is zero throughout")
    begin, size = int(on[0]), float(command[on[0]])
    released = np.flatnonzero(command[begin:] != size)
    end = begin + int(released[0]) if released.size else len(command)
    answer = found * np.sign(size)
    flown, halfway = slice(begin, end + round(_AFTER_S * control_hz)), (begin + end) // 2
    held = float(np.mean(answer[halfway:end])) / abs(size)
    before = found[max(0, begin - 2 * control_hz) : begin]
    after = answer[end : end + round(_AFTER_S * control_hz)]
    changed = np.flatnonzero(np.diff(command)) + 1
    quiet = np.ones(len(command), dtype=bool)
    for tick in changed:
        quiet[tick : tick + round(_EDGE_S * control_hz)] = False
    busy = high_passed(columns["elevator_cmd_deg"], control_hz=control_hz)[quiet]
    return PullUp(
        overshoot=float(np.max(answer[begin:end])) / abs(size) - 1.0,
        undershoot=-float(np.min(after)) / abs(size) if after.size else nan,
        disturbance_g=float(np.max(np.abs(before))) if before.size else 0.0,
        flutter_deg=float(np.sqrt(np.mean(busy**2))),
        tracking_rms_g=float(np.sqrt(np.mean((found[flown] - command[flown]) ** 2))),
        lost=len(command) < ticks or float(np.max(np.abs(found))) > _LOST * abs(size) or not 0.5 <= held <= 1.5,
    )
