"""Trace of a flight commanded in g -> metrics of a pull-up: overshoot, undershoot, elevator flutter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import nan
from types import MappingProxyType

import numpy as np

from flightbed.analysis.trace import Vector

COLUMNS = (
    "t_s", "nz_g", "theta_deg", "phi_deg", "nz_cmd_g", "theta_meas_deg", "phi_meas_deg", "elevator_cmd_deg",
)  # fmt: skip
# Metrics of a pull-up in metrics.json and campaigns -> unit, definition.
PULL_UP_METRICS: Mapping[str, tuple[str, str]] = MappingProxyType(
    {
        "pull_up_overshoot": (
            "1",
            "first pulse in g: largest increment over level flight during the pulse, divided by the command, minus 1",
        ),
        "pull_up_undershoot": (
            "1",
            "largest increment of opposite sign in the 3 s after the release, divided by the command",
        ),
        "pull_up_disturbance_g": ("g", "largest increment in the 2 s before the pulse"),
        "pull_up_flutter_deg": (
            "deg",
            "RMS of the elevator command above 5 Hz during the pulse and for 3 s after it, without the 0.5 s after each step",
        ),
    }
)
FLUTTER_HZ = 5.0  # above the bandwidth of a loop with poles at -4 +- 2j and -10 rad/s
_AFTER_S, _EDGE_S, _HELD_S = 3.0, 0.5, 0.5
_LOSS_RATIO = 4.0  # |a_n| over the command beyond which the aircraft counts as lost


@dataclass(frozen=True)
class PullUp:
    """Metrics of one pull-up, in increments a_n over level flight.

    Attributes:
        overshoot: largest a_n during the pulse divided by the command, minus 1; negative if the command is not reached.
        undershoot: largest a_n of opposite sign, in the 3 s after the release or up to the next command, divided by the command; nan
            without a release.
        disturbance_g: largest |a_n| in the 2 s before the pulse: the effect of a failure in that time.
        flutter_deg: RMS of the elevator command above 5 Hz, in the pulse and for 3 s after its release, without the first 0.5 s of each, in
            which every loop is active; nan at control rates below 20 Hz. It includes the sensors' noise.
        tracking_rms_g: RMS of a_n minus the command, from the start of the pulse to 3 s after its release; lower for a faster response.
        lost: the flight ended early (if before the pulse, the other metrics are nan), |a_n| exceeded four times the command, or the mean
            a_n in the second half of the pulse was not between 0.5 and 1.5 times the command.

    """

    overshoot: float
    undershoot: float
    disturbance_g: float
    flutter_deg: float
    tracking_rms_g: float
    lost: bool


def increment_g(columns: Mapping[str, Vector]) -> Vector:
    """Return the true increment a_n = nz - cos theta cos phi, g, up positive, (ticks,)."""
    level: Vector = columns["nz_g"] - np.cos(np.radians(columns["theta_deg"])) * np.cos(np.radians(columns["phi_deg"]))
    return level


def command_g(columns: Mapping[str, Vector]) -> Vector:
    """Return the command as an increment, g, (ticks,): the column includes the measured level flight, which is subtracted."""
    level = np.cos(np.radians(columns["theta_meas_deg"])) * np.cos(np.radians(columns["phi_meas_deg"]))
    command: Vector = np.round(columns["nz_cmd_g"] - level, 9)
    return command


def first_pulse(command: Vector, *, control_hz: int) -> tuple[int, int, float] | None:
    """Return first tick, end (tick of the release, or the length of the record) and size, g, of the first command; None if it is no pulse.

    A pulse is constant for at least half a second and then returns to 0; the first half of a doublet is no pulse.
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
    """Return a record high-passed at ``above_hz`` by a Butterworth filter of order 4, run forward and backward over this record."""
    from scipy.signal import butter, sosfiltfilt  # slow to import

    passing = butter(4, above_hz, "highpass", fs=control_hz, output="sos")
    return np.asarray(sosfiltfilt(passing, values), dtype=np.float64)


def _flutter(elevator: Vector, spans: Sequence[tuple[int, int]], control_hz: int) -> float:
    """Return the RMS above 5 Hz over stretches of a record; each stretch is filtered alone, so that samples outside do not ring in it."""
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
        ticks: length of the complete flight.

    Raises:
        ValueError: the first command is no pulse.

    """
    command, found = command_g(columns), increment_g(columns)
    pulse = first_pulse(command, control_hz=control_hz)
    if pulse is None:
        if len(command) < ticks:
            return PullUp(nan, nan, nan, nan, nan, lost=True)
        raise ValueError("the flight has no pull-up: its first command is no pulse")
    begin, end, size = pulse
    next_command = np.flatnonzero(command[end:])
    over = min(end + round(_AFTER_S * control_hz), end + int(next_command[0]) if next_command.size else len(command))
    answer, halfway, edge = found * np.sign(size), (begin + end) // 2, round(_EDGE_S * control_hz)
    held = float(np.mean(answer[halfway:end])) / abs(size)
    before, after, flown = found[max(0, begin - 2 * control_hz) : begin], answer[end:over], slice(begin, over)
    return PullUp(
        overshoot=float(np.max(answer[begin:end])) / abs(size) - 1.0,
        undershoot=-float(np.min(after)) / abs(size) if after.size else nan,
        disturbance_g=float(np.max(np.abs(before))) if before.size else 0.0,
        flutter_deg=_flutter(columns["elevator_cmd_deg"], ((begin + edge, end), (end + edge, over)), control_hz),
        tracking_rms_g=float(np.sqrt(np.mean((found[flown] - command[flown]) ** 2))),
        lost=len(command) < ticks or float(np.max(np.abs(found))) > _LOSS_RATIO * abs(size) or not 0.5 <= held <= 1.5,
    )
