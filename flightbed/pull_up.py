"""Trace of a flight that is commanded in g -> how a pull-up went: overshoot, undershoot, and how busy the elevator is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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
            "RMS of the elevator command above 5 Hz in it and for 3 s after it, but for 0.5 s after each step",
        ),
    }
)
FLUTTER_HZ = 5.0  # above what a loop with poles at -4 +- 2j and -10 rad/s asks of the elevator
_AFTER_S, _EDGE_S, _HELD_S = 3.0, 0.5, 0.5
_LOST = 4.0  # times the command


@dataclass(frozen=True)
class PullUp:
    """How one went, in increments a_n over level flight.

    Attributes:
        overshoot: largest a_n during the pulse, over the command, less 1; below 0 if it is not reached.
        undershoot: the same of the other side, in the 3 s after its release or up to the next command, over the command; nan if it is
            not released.
        disturbance_g: largest |a_n| in the 2 s before it: what a failure that came then has done.
        flutter_deg: RMS of the elevator command above 5 Hz, in the pulse and for 3 s after its release, but for the first 0.5 s of each, in
            which every loop is busy; nan at control rates that do not show it. The sensors' noise is in it.
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


def first_pulse(command: Vector, *, control_hz: int) -> tuple[int, int, float] | None:
    """Return first tick, end (the tick of the release, or the record's) and size of the first command, if it is a pulse.

    A pulse is held, for half a second at least, and then given up: a doublet's first half is none.
    """
    on = np.flatnonzero(command)
    if not on.size:
        return None
    begin, size = int(on[0]), float(command[on[0]])
    released = np.flatnonzero(command[begin:] != size)
    end = begin + int(released[0]) if released.size else len(command)
    if end - begin < round(_HELD_S * control_hz) or (released.size and command[end] != 0.0):
        return None
    return begin, end, size


def high_passed(values: Vector, *, control_hz: int, above_hz: float = FLUTTER_HZ) -> Vector:
    """Return what of a record lies above a frequency: Butterworth's filter of order 4, forward and back, of this record alone."""
    from scipy.signal import butter, sosfiltfilt  # slow to import

    passing = butter(4, above_hz, "highpass", fs=control_hz, output="sos")
    return np.asarray(sosfiltfilt(passing, values), dtype=np.float64)


def _flutter(elevator: Vector, spans: Sequence[tuple[int, int]], control_hz: int) -> float:
    """Return the RMS above 5 Hz of the stretches of a record, each of them filtered alone: what is outside does not ring in it."""
    long_enough = [elevator[first:last] for first, last in spans if last - first >= round(_HELD_S * control_hz)]
    if not long_enough or control_hz < 4.0 * FLUTTER_HZ:
        return nan
    busy = np.concatenate([high_passed(stretch, control_hz=control_hz) for stretch in long_enough])
    return float(np.sqrt(np.mean(busy**2)))


def pull_up(columns: Mapping[str, Vector], *, control_hz: int, ticks: int) -> PullUp:
    """Measure the first pulse of a flight's command.

    Args:
        columns: ``COLUMNS`` of the trace.
        control_hz: rate of its rows.
        ticks: of the flight if it does not end early.

    Raises:
        ValueError: its first command is no pulse.

    """
    command, found = command_g(columns), increment_g(columns)
    pulse = first_pulse(command, control_hz=control_hz)
    if pulse is None:
        if len(command) < ticks:
            return PullUp(nan, nan, nan, nan, nan, lost=True)
        raise ValueError("the flight has no pull-up: its first command is no pulse")
    begin, end, size = pulse
    again = np.flatnonzero(command[end:])
    over = min(end + round(_AFTER_S * control_hz), end + int(again[0]) if again.size else len(command))
    answer, halfway, edge = found * np.sign(size), (begin + end) // 2, round(_EDGE_S * control_hz)
    held = float(np.mean(answer[halfway:end])) / abs(size)
    before, after, flown = found[max(0, begin - 2 * control_hz) : begin], answer[end:over], slice(begin, over)
    return PullUp(
        overshoot=float(np.max(answer[begin:end])) / abs(size) - 1.0,
        undershoot=-float(np.min(after)) / abs(size) if after.size else nan,
        disturbance_g=float(np.max(np.abs(before))) if before.size else 0.0,
        flutter_deg=_flutter(columns["elevator_cmd_deg"], ((begin + edge, end), (end + edge, over)), control_hz),
        tracking_rms_g=float(np.sqrt(np.mean((found[flown] - command[flown]) ** 2))),
        lost=len(command) < ticks or float(np.max(np.abs(found))) > _LOST * abs(size) or not 0.5 <= held <= 1.5,
    )
