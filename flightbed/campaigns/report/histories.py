"""Histories of a campaign in its report: bands of percentiles, mean, standard deviation; small figures for several points."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flightbed.analysis.trace import true_share
from flightbed.campaigns.plan import SHOWN, select_points
from flightbed.campaigns.report.bands import (
    SEEN,
    START_S,
    Vector,
    draw,
    edges,
    effectiveness_limit,
    is_drawn,
    sample_text,
)
from flightbed.campaigns.report.small_multiples import point_pictures, selection_text
from flightbed.campaigns.result import Campaign
from flightbed.core.estimate_names import estimator_indices
from flightbed.document import drawing, palette
from flightbed.document.document import Picture, Section
from flightbed.report.figures import MARGIN, mark_changes
from flightbed.statistics.histories import PERCENTILES, Ensemble

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def histories_sections(campaign: Campaign) -> list[Section]:
    """Return the section on histories; none for a campaign without histories."""
    if not campaign.histories:
        return []
    if len(campaign.programme.points) == 1:
        ensemble = campaign.histories[0]
        text = (f"Over the flights that still fly: {_bands(ensemble)}", sample_text(ensemble))
        return [Section("Histories", text, _of_one(campaign, ensemble))]
    points = select_points(campaign.programme.settings, sorted(campaign.histories), SHOWN)
    return [Section("Histories at the points", selection_text(campaign, points), point_pictures(campaign, points))]


def _bands(ensemble: Ensemble) -> str:
    low, inner_low, _, inner_high, high = PERCENTILES
    return (
        f"the line is their median, the dark band goes from {inner_low} to {inner_high} % of them, the light one from {low} to {high} %. "
        f"About the median: dashed the mean, dotted the mean +-1 sigma, of all {ensemble.moments.flying[0]}."
    )


@dataclass(frozen=True)
class _Curve:
    """A history in a figure.

    Attributes:
        column: its name in the trace.
        label: of its axes.
        short: label of its axes in the figure about the median.
        color: of median and bands.
        name: its name in a sentence.
        mean: name of its mean in a legend.

    """

    column: str
    label: str
    short: str
    color: str
    name: str
    mean: str = "mean"


def _of_one(campaign: Campaign, ensemble: Ensemble) -> list[Picture]:
    """Draw motion and K, and both relative to their medians, which shows narrow bands."""
    moments = ensemble.moments
    motion = [
        _Curve("q_deg_s", "pitch rate, deg/s", "q, deg/s", drawing.ACTUAL, "pitch rate"),
        _Curve("alpha_deg", "angle of attack, deg", "alpha, deg", drawing.ACTUAL, "angle of attack"),
        _Curve("elevator_deg", "elevator, deg", "elevator, deg", drawing.ACTUAL, "elevator"),
    ]
    gain = [
        _Curve(f"{name}.effectiveness_smoothed", "K", "K", palette.estimate(i), f"'{name}'", f"mean of '{name}'")
        for name, i in estimator_indices(campaign.estimators).items()
    ]
    flying, flights = moments.flying, int(moments.flying[0])
    t = np.arange(len(flying)) / campaign.scenario.rates.control_hz
    early = flying[-1] < flights or len(t) < campaign.scenario.ticks

    def draw_motion(axes: list[Axes]) -> str:
        drawing.line(axes[0], t, moments.mean["q_ref_deg_s"], color=drawing.REFERENCE, label="reference")
        for axis, curve in zip(axes, motion, strict=False):
            draw(axis, t, ensemble, curve.column, curve.color, "median", drawing.BUCKETS)
            axis.set_ylabel(curve.label)
        if not early:
            return ""
        drawing.line(axes[-1], t, flying.astype(np.float64), color=drawing.OTHER)
        axes[-1].set_ylim(0.0, 1.05 * flights)
        axes[-1].set_ylabel("still flying")
        return f"{flying[-1]} of {flights} fly at {t[-1]:.2f} s."

    def draw_gain(axes: list[Axes]) -> str:
        words = []
        for axis, curve, name in zip(axes, gain, campaign.estimators, strict=True):
            truth = moments.mean[true_share(name)]
            drawing.line(axis, t, truth, color=drawing.TRUTH, linewidth=2.2, label="truth")
            draw(axis, t, ensemble, curve.column, curve.color, f"smoothed K of {curve.name}, median", drawing.BUCKETS)
            low, _, middle, _, high = edges(ensemble, curve.column)
            axis.set_ylim(-0.08, effectiveness_limit(high[t > START_S]))
            axis.set_ylabel("K")
            words.append(
                f"{curve.name} ends at {middle[-1]:.3f} ({PERCENTILES[0]} to {PERCENTILES[-1]} %: {low[-1]:.3f} to {high[-1]:.3f}; mean "
                f"{moments.mean[curve.column][-1]:.3f} +- {moments.std(curve.column)[-1]:.2g}; truth {truth[-1]:.3f})."
            )
        return " ".join(words)

    figures: list[tuple[str, str, int, Callable[[list[Axes]], str]]] = [
        ("motion", "Motion and elevator", len(motion) + early, draw_motion),
        ("motion-about", "Motion and elevator about their median", len(motion), lambda axes: _about(axes, t, ensemble, motion)),
    ]  # fmt: skip
    if gain:
        figures += [
            ("gain", "Smoothed K", len(gain), draw_gain),
            ("gain-about", "Smoothed K about its median", len(gain), lambda axes: _about(axes, t, ensemble, gain)),
        ]
    return [_picture(campaign, key, title, rows, draw, float(t[-1])) for key, title, rows, draw in figures]


def _about(axes: list[Axes], t: Vector, ensemble: Ensemble, curves: Sequence[_Curve]) -> str:
    """Draw bands, mean and standard deviation minus the median."""
    words = []
    for axis, curve in zip(axes, curves, strict=True):
        low, inner_low, middle, inner_high, high = edges(ensemble, curve.column)
        mean, std = ensemble.moments.mean[curve.column], ensemble.moments.std(curve.column)
        with np.errstate(invalid="ignore"):  # where the median is infinite
            drawing.band(axis, t, low - middle, high - middle, color=curve.color, alpha=0.2)
            drawing.band(axis, t, inner_low - middle, inner_high - middle, color=curve.color, alpha=0.35)
            drawing.line(axis, t, mean - middle, color="black", linestyle="--", linewidth=0.8, label=curve.mean)
            for i, edge in enumerate((mean - std, mean + std)):
                drawing.line(
                    axis, t, edge - middle, color="black", linestyle=":", linewidth=0.8, label="_" if i else "+-1 sigma"
                )
            away = np.maximum.reduce([np.abs(edge - middle) for edge in (low, high, mean - std, mean + std)])
        away = away[np.isfinite(away)]
        most = 1.1 * float(np.quantile(away, SEEN)) if away.size else 0.0
        cut = ""
        if most > 0.0:
            axis.set_ylim(-most, most)
            cut = f", beyond the frame in {np.mean(away > most):.1%} of the ticks" if np.any(away > most) else ""
        axis.set_ylabel(curve.short)
        finite = np.where(np.isfinite(std), std, 0.0)
        words.append(f"{curve.name}: sigma up to {finite.max():.3g}, at {t[finite.argmax()]:.2f} s{cut}")
    return "; ".join(words) + "."


def _picture(
    campaign: Campaign, key: str, title: str, rows: int, draw: Callable[[list[Axes]], str], end_s: float
) -> Picture:
    with drawing.canvas(rows, height=1.8, margin=MARGIN) as (axes, svg):
        facts = draw(axes)
        for axis in axes:
            if not is_drawn(campaign):
                mark_changes(axis, campaign.scenario, end_s, name=axis is axes[0])
            axis.set_xlim(0.0, max(end_s, 1e-3))
            drawing.legend(axis)
        axes[-1].set_xlabel("time, s")
        return Picture(key, title, drawing.distinct(svg(), key), "", facts)
