"""Histories at the points of a campaign in small figures: all points, or a few that are spread over the grid."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flightbed.analysis.trace import true_share
from flightbed.campaigns.plan import MOST_REMEMBERED, SHOWN, select_points, values_of
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
from flightbed.campaigns.report.points import value_words
from flightbed.campaigns.result import Campaign
from flightbed.core.estimate_names import estimator_indices
from flightbed.document import drawing, palette
from flightbed.document.document import Picture
from flightbed.report.figures import MARGIN, mark_changes
from flightbed.scenario.tables import Scenario
from flightbed.statistics.histories import PERCENTILES, Ensemble

_ACROSS = 3  # small figures per row, where the grid does not define it
_BUCKETS = 200  # intervals of time per figure: 0.08 s each of 16.5 s


def selection_text(campaign: Campaign, points: Sequence[int]) -> list[str]:
    """Return sentences on the bands and on points without a figure."""
    of, kept = len(campaign.programme.points), len(campaign.histories)
    low, inner_low, _, inner_high, high = PERCENTILES
    sentences = [
        f"Median, bands from {inner_low} to {inner_high} % and from {low} to {high} % of the flights of a point that still fly. "
        + sample_text(max((campaign.histories[point] for point in points), key=lambda ensemble: ensemble.sampled))
    ]
    if len(points) < of:
        settings = campaign.programme.settings
        chosen = settings is not None and settings.histories.keep == "chosen"
        rest = (
            f"the campaign file selects {kept}"
            if chosen
            else f"with more than {MOST_REMEMBERED} points only {kept} keep histories, unless histories.points selects others"
            if kept < of and of > MOST_REMEMBERED
            else f"histories.parquet has the {kept} points with a flight without error"
        )
        sentences.append(f"Shown are {len(points)} of {of} points; {rest}.")
    return sentences


def point_pictures(campaign: Campaign, points: Sequence[int]) -> list[Picture]:
    """Draw small figures of the points: pitch rate, and smoothed K of every estimate."""
    found = [("q_deg_s", "q_ref_deg_s", drawing.ACTUAL, "Pitch rate", "pitch rate, deg/s", "reference")]
    found += [
        (f"{name}.effectiveness_smoothed", true_share(name), palette.estimate(i), f"Smoothed K of '{name}'", "K", "truth")
        for name, i in estimator_indices(campaign.estimators).items()
    ]  # fmt: skip
    scenarios = {point: campaign.programme.at(point) for point in points}
    return [_small(campaign, scenarios, *figure) for figure in found]


def _small(
    campaign: Campaign, scenarios: dict[int, Scenario], column: str, aim: str, color: str, title: str, label: str, name: str
) -> Picture:  # fmt: skip
    points = list(scenarios)
    across = _across(campaign, len(points))
    rows = -(-len(points) // across)
    key = f"points-{column.replace('.', '-').replace('_', '-')}"
    end_s, ends, gain = 0.0, list[tuple[float, float]](), column != "q_deg_s"
    with drawing.canvas(rows, across, height=1.55, margin=MARGIN) as (axes, svg):
        for axis, point in zip(axes, points, strict=False):
            ensemble, scenario = campaign.histories[point], scenarios[point]
            t = np.arange(len(ensemble.moments.flying)) / scenario.rates.control_hz
            buckets = _BUCKETS
            drawing.line(
                axis, t, ensemble.moments.mean[aim], color=drawing.TRUTH if gain else drawing.REFERENCE, label=name, buckets=buckets
            )  # fmt: skip
            draw(axis, t, ensemble, column, color, "median", buckets)
            axis.set_title(_point_words(campaign, point), fontsize=7.5, pad=3.0)
            end_s = max(end_s, float(t[-1]))
            ends.append(_frame(ensemble, column, aim, t))
            if not is_drawn(campaign):
                mark_changes(axis, scenario, float(t[-1]), name=axis is axes[0])
            stayed, runs = int(ensemble.moments.flying[-1]), int(ensemble.moments.flying[0])
            if stayed < runs or len(t) < scenario.ticks:
                text = f"{stayed if len(t) == scenario.ticks else 0} of {runs} fly to the end"
                axis.text(
                    0.03,
                    0.05,
                    text,
                    transform=axis.transAxes,
                    fontsize=7.0,
                    color=drawing.FAILURE,
                    backgroundcolor="#ffffffc0",
                )
        axes[0].legend(loc="best", fontsize=6.5)
        for i, axis in enumerate(axes):
            axis.set_visible(i < len(points))
            axis.set_xlim(0.0, max(end_s, 1e-3))
            axis.set_ylim(min(low for low, _ in ends), max(high for _, high in ends))
            if i % across == 0:
                axis.set_ylabel(label)
            if i + across >= len(points):
                axis.tick_params(labelbottom=True)
                axis.set_xlabel("time, s")
        text = f"The {name} and the flights, one figure per point; its title gives {_keys(campaign)}."
        return Picture(key, title, drawing.distinct(svg(), key), text)


def _frame(ensemble: Ensemble, column: str, aim: str, t: Vector) -> tuple[float, float]:
    """Return the limits of an axis: of K all but divergent values, of other histories the bands at nearly all ticks."""
    low, *_, high = edges(ensemble, column)
    if column != "q_deg_s":
        return -0.08, effectiveness_limit(high[t > START_S])
    shown = np.concatenate([low, high, ensemble.moments.mean[aim]])
    shown = shown[np.isfinite(shown)]
    if not shown.size:
        return -1.0, 1.0
    least, most = np.quantile(shown, [1.0 - SEEN, SEEN]).tolist()
    return least - 0.15 * (most - least) - 1e-3, most + 0.15 * (most - least) + 1e-3


def _across(campaign: Campaign, count: int) -> int:
    """Return the number of small figures per row: in a grid the number of values of the last axis among them."""
    settings = campaign.programme.settings
    axes = [axis for axis in campaign.programme.axes if not axis.is_drawn]
    if settings is not None and settings.combine == "crossed" and len(axes) > 1:
        points = select_points(settings, sorted(campaign.histories), SHOWN)
        last = len({str(campaign.programme.points[point][axes[-1].key]) for point in points})
        if 2 <= last <= 4 and count % last == 0:
            return last
    return min(_ACROSS, count)


def _varied(campaign: Campaign) -> list[str]:
    return [axis.key for axis in campaign.programme.axes if not axis.is_drawn and len(values_of(axis)) > 1]


def _keys(campaign: Campaign) -> str:
    return " and ".join(_varied(campaign))


def _point_words(campaign: Campaign, point: int) -> str:
    """Return the values of a point in few words, with the last part of each key where these parts differ."""
    keys = _varied(campaign)
    short = [key.rpartition(".")[2] for key in keys]
    names = short if len(set(short)) == len(short) else keys
    values = campaign.programme.points[point]
    return ", ".join(f"{name} {value_words(values[key])}" for name, key in zip(names, keys, strict=True))
