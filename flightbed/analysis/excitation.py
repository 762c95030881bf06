"""Excitation: pitch acceleration by elevator motion, the information about K in a flight."""

from __future__ import annotations

import numpy as np

from flightbed.analysis.trace import Trace, Vector

WINDOW_S = 0.3  # the thesis's window


def with_excitation(trace: Trace, *, m_delta: float, control_hz: int) -> Trace:
    """Return the trace with a column ``excitation_deg_s2``: |M_delta| times the RMS of the measured deflection.

    The RMS is over the last 0.3 s, of the mean deflection over each tick. This pitch acceleration makes K observable: in a window of N
    ticks with K as the only unknown, sigma of K is about sigma_q / (excitation x time x sqrt(N/3)).

    Args:
        trace: the flight.
        m_delta: pitch acceleration per deflection of the undamaged elevator at the trim point, 1/s^2.
        control_hz: ticks per second.

    """
    return trace.with_column(
        "excitation_deg_s2", excitation_deg_s2(trace["elevator_mean_meas_deg"], m_delta=m_delta, control_hz=control_hz)
    )


def excitation_deg_s2(deflection_deg: Vector, *, m_delta: float, control_hz: int) -> Vector:
    """Return |m_delta| times the RMS deflection over the last 0.3 s, deg/s^2, (ticks,); the window is shorter at the first ticks."""
    window = max(1, round(WINDOW_S * control_hz))
    total = np.concatenate([[0.0], np.cumsum(np.square(deflection_deg))])
    end = np.arange(1, len(total))
    begin = np.maximum(0, end - window)
    # Differences of a running sum can fall below 0 by round-off.
    rms: Vector = np.sqrt(np.maximum(0.0, total[end] - total[begin]) / (end - begin))
    return abs(m_delta) * rms
