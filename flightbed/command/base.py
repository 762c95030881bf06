"""What the pilot asks for: a pitch-rate command as a function of time, and the prefilter that makes it a reference."""

from __future__ import annotations

from math import exp
from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

Vector = npt.NDArray[np.float64]


class Command(Protocol):
    """A pitch-rate command over time."""

    def __call__(self, t_s: Vector) -> Vector:
        """Return the command at the given times, rad/s."""


class Profile(NamedTuple):
    """A command sampled at the control rate, and the reference after the prefilter; rad/s, one value per tick."""

    q_cmd_rad_s: Vector
    q_ref_rad_s: Vector


def profile(command: Command, *, ticks: int, control_hz: int, filter_rad_s: float) -> Profile:
    """Sample a command and pass it through the prefilter w/(s+w), discretized by zero-order hold (Sillence S 3.1).

    Args:
        filter_rad_s: bandwidth w of the prefilter; 0 leaves the command as it is.

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
