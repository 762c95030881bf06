"""The pilot's pitch-rate command as a function of time, and the prefilter that turns it into a reference."""

from __future__ import annotations

from math import exp, sqrt
from typing import Annotated, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from flightbed.config.table import between

Vector = npt.NDArray[np.float64]
Count = Annotated[int, between(0, 10000)]  # type of a key

ROUND_OFF_S = 1e-9  # round-off can put t = k / hz just before a switching time


class Command(Protocol):
    """A pitch-rate command over time."""

    def __call__(self, t_s: Vector) -> Vector:
        """Return the command at the given times, rad/s."""


class Profile(NamedTuple):
    """A command sampled at the control rate, and the reference after the prefilter; rad/s, one value per tick."""

    q_cmd_rad_s: Vector
    q_ref_rad_s: Vector


def profile(command: Command, *, ticks: int, control_hz: int, filter_rad_s: float) -> Profile:
    """Sample a command and filter it with the prefilter w/(s+w), discretized by zero-order hold (Sillence S 3.1).

    Args:
        command: the command over time.
        ticks: number of samples.
        control_hz: control rate.
        filter_rad_s: bandwidth w of the prefilter; 0 passes the command unfiltered.

    """
    q_cmd = command(np.arange(ticks) / control_hz)
    if filter_rad_s == 0.0:
        return Profile(q_cmd, q_cmd.copy())
    keep = exp(-filter_rad_s / control_hz)
    q_ref, state = np.empty(ticks), 0.0
    for k in range(ticks):
        q_ref[k] = state
        state = keep * state + (1.0 - keep) * q_cmd[k]
    return Profile(q_cmd, q_ref)


def energy(q_rad_s: Vector, *, control_hz: int) -> float:
    """Return the integral of q^2 dt, rad^2/s; the record is held between ticks."""
    return float(np.sum(np.square(q_rad_s))) / control_hz


def relative_peak_factor(q_rad_s: Vector) -> float:
    """Return (max q - min q) / (2 sqrt(2) rms q) of a record: 1 for a sine, 1/sqrt(2) for a square wave, any unit.

    Raises:
        ValueError: the record is empty or zero throughout.

    Source:
        Klein and Morelli, Aircraft System Identification (2006), ch. 9; rms about zero, not about the mean.
    """
    if not np.any(q_rad_s):
        raise ValueError(
            "relative peak factor: the record is empty or zero throughout; give at least one value that is not zero"
        )
    return float((np.max(q_rad_s) - np.min(q_rad_s)) / (2.0 * sqrt(2.0) * np.sqrt(np.mean(np.square(q_rad_s)))))
