"""Measures of one flight for the judgement of claims: tracking errors and estimation errors over intervals of time."""

from __future__ import annotations

from typing import Any

import numpy as np

from flightbed.analysis.seeds import Flown
from flightbed.statistics.intervals import Vector
from flightbed.studies.sillence import printed
from flightbed.studies.sillence.plots import TIME
from flightbed.studies.sillence.setup import WINDOW

SETTLED_S = printed.FAILED_AT_S + 0.3  # start of "after the failure", also in flights without failure


def tracking(flown: Flown, from_s: float, to_s: float = np.inf) -> float:
    """Return the RMS of q - reference from ``from_s`` to before ``to_s``, deg/s."""
    return float(np.sqrt(np.mean(_tracking_error(flown, from_s, to_s) ** 2)))


def peak(flown: Flown) -> float:
    """Return the largest |q - reference| within 0.3 s after the failure, deg/s."""
    return float(np.max(np.abs(_tracking_error(flown, printed.FAILED_AT_S, SETTLED_S))))


def _tracking_error(flown: Flown, from_s: float, to_s: float) -> Vector:
    c = flown.columns
    span = (c[TIME] >= from_s - 1e-9) & (c[TIME] < to_s - 1e-9)
    return (c["q_deg_s"] - c["q_ref_deg_s"])[span]


def share_within_two_sigma(flown: Flown, name: str) -> float:
    """Return the share of an estimator's raw K-hat within two sigma of the true K.

    Windows that contain the failure, and the first window, are excluded.
    """
    c, t = flown.columns, flown.columns[TIME]
    clean = (t > 0.3) & ~((t >= printed.FAILED_AT_S) & (t < SETTLED_S))
    error = c[f"{name}.effectiveness_raw"] - c["effectiveness_true"]
    return float(np.mean((np.abs(error) <= 2.0 * c[f"{name}.effectiveness_std"])[clean]))


def _error(flown: Flown) -> Any:
    return flown.columns[f"{WINDOW}.effectiveness_raw"] - flown.columns["effectiveness_true"]


def rms_before(flown: Flown) -> float:
    """Return the RMS error of the window's raw K-hat from 0.3 s to the failure."""
    t = flown.columns[TIME]
    return float(np.sqrt(np.mean(_error(flown)[(t > 0.3) & (t < printed.FAILED_AT_S - 1e-9)] ** 2)))


def rms_after(flown: Flown) -> float:
    """Return the RMS error of the window's raw K-hat from 0.3 s after the failure."""
    return float(np.sqrt(np.mean(_error(flown)[_settled_samples(flown)] ** 2)))


def _settled_samples(flown: Flown) -> Any:
    return flown.columns[TIME] >= SETTLED_S - 1e-9
