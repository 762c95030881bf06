"""Drawing of ensembles: a median with its bands; the accuracy of percentiles."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from flightbed.campaigns.result import Campaign
from flightbed.document import drawing
from flightbed.statistics.histories import PERCENTILES, Ensemble

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Vector = npt.NDArray[np.float64]

START_S = 0.3  # until then an estimate shows its prior
SEEN = 0.98  # share of the ticks whose bands lie within the frame


def sample_text(ensemble: Ensemble) -> str:
    """Return the accuracy of the percentiles, in words."""
    sampled = ensemble.sampled
    if sampled == ensemble.moments.flying[0]:
        return f"Percentiles over all {sampled} flights, interpolated between neighbours, in single precision."
    shares = [1.96 * (p * (100 - p) / sampled) ** 0.5 for p in PERCENTILES[:3]]
    accuracy = ", ".join(f"{p} +-{share:.1f}" for p, share in zip(PERCENTILES, shares, strict=False))
    return (
        f"Percentiles over the point's first {sampled} flights; with 95 % confidence they are the percentiles {accuracy} of the "
        "distribution over all seeds (normal approximation to the binomial)."
    )


def draw(axis: Axes, t: Vector, ensemble: Ensemble, column: str, color: str, label: str, buckets: int) -> None:
    """Draw the median of a history, and the bands around it."""
    low, inner_low, middle, inner_high, high = edges(ensemble, column)
    drawing.band(axis, t, low, high, color=color, alpha=0.2, buckets=min(buckets, drawing.BUCKETS // 2))
    drawing.band(axis, t, inner_low, inner_high, color=color, alpha=0.35, buckets=min(buckets, drawing.BUCKETS // 2))
    drawing.line(axis, t, middle, color=color, label=label, buckets=buckets)


def edges(ensemble: Ensemble, column: str) -> list[Vector]:
    """Return the percentiles of a history, each (n,)."""
    return [edge.astype(np.float64) for edge in ensemble.percentiles[column]]


def effectiveness_limit(values: Vector) -> float:
    """Return the upper end of an axis for K: just above the values, but at most 3, for estimates that diverge."""
    finite = values[np.isfinite(values)]
    return max(1.25, min(3.0, float(finite.max(initial=0.0)) + 0.1))


def is_drawn(campaign: Campaign) -> bool:
    """Return whether every flight draws the time of a failure or gust, so that no time can be marked."""
    return any(axis.is_drawn and axis.key.endswith(".at_s") for axis in campaign.programme.axes)
