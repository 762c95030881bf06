"""Points of a campaign in its report: the axes, a table with one row per point, heat maps of two crossed axes."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
from typing import Any

import numpy as np
import numpy.typing as npt

from flightbed.campaigns.plan import values_of
from flightbed.campaigns.result import Campaign
from flightbed.campaigns.settings import AxisSettings, Criterion
from flightbed.campaigns.summary import CampaignSummary, FlightsSummary, ShareSummary
from flightbed.document import drawing
from flightbed.document.document import Cell, Picture, Section, Table, show
from flightbed.statistics.intervals import Interval

_MOST = 200  # points in the table of the page; summary.json has all
_LABELLED = 150  # cells of a heat map with a legible number in each


def points_section(campaign: Campaign) -> list[Section]:
    """Return the section on the points; none for a campaign without axes."""
    if not campaign.programme.axes:
        return []
    rows: list[list[Cell]] = [[axis.key, axis_words(axis)] for axis in campaign.programme.axes]
    items: list[Table | Picture] = [Table("axes", "Axes", ("key", "values"), rows)]
    if len(campaign.programme.points) > 1:
        items += [*_maps(campaign), points_table(campaign, campaign.estimators)]
    return [Section("Over the points", (), items)]


def axis_words(axis: AxisSettings) -> str:
    """Return the values of an axis in words."""
    if axis.distribution == "uniform":
        return f"drawn for every flight, uniformly from {axis.low:g} to {axis.high:g}"
    if axis.distribution == "normal":
        ends = [
            f"{word} {end:g}" for word, end in (("not below", axis.low), ("not above", axis.high)) if end is not None
        ]
        return f"drawn for every flight, normal, mean {axis.mean:g}, standard deviation {axis.std:g}{', ' if ends else ''}{', '.join(ends)}"
    values = values_of(axis)
    text = (
        ", ".join(map(value_words, values))
        if len(values) <= 12
        else f"{value_words(values[0])} to {value_words(values[-1])}"
    )
    return f"{text} ({len(values)})"


def value_words(value: Any) -> str:
    """Return a value of an axis as text for tables and figures."""
    return f"{value:g}" if isinstance(value, float) else str(value).lower() if isinstance(value, bool) else str(value)


def criteria_words(criteria: Sequence[Criterion]) -> str:
    """Return the criteria of a flight that passes, in words."""
    texts = []
    for c in criteria:
        if c.equals is not None:
            texts.append(f"{c.metric} = {value_words(c.equals)}")
        else:
            ends = [("at least", c.min), ("at most", c.max)]
            texts.append(f"{c.metric} {' and '.join(f'{word} {end:g}' for word, end in ends if end is not None)}")
    return "; ".join(texts)


def points_table(campaign: Campaign, estimators: Sequence[str]) -> Table:
    """Return a table with one row per point: shares that departed and passed, medians of tracking and of one metric per estimator."""
    keys = [axis.key for axis in campaign.programme.axes if not axis.is_drawn]
    summary = campaign.summary
    judged, failed = summary.flights.passed is not None, bool(summary.errors)
    tracked, what, unit, _ = summary.tracking.followed
    estimates = [(name, column) for name in estimators if (column := _estimate(summary, name))]
    columns = [
        "point", *keys, "flights", *(["failed"] if failed else []), "departed, %", *(["passed, %"] if judged else []),
        f"tracking RMS, {unit}", *(f"{name}: {_short(column)}" for name, column in estimates),
    ]  # fmt: skip
    rows: list[list[Cell]] = []
    for point in summary.points[:_MOST]:
        flights = point.flights
        cells: list[Cell] = [point.point, *(value_words(point.values[key]) for key in keys), flights.flights]
        cells += [flights.errors] if failed else []
        cells += [_percent(flights.departed), *([_percent(flights.passed)] if judged else [])]
        cells += [_median(flights, column) for column in (tracked, *(column for _, column in estimates))]
        rows.append(cells)
    note = (
        "Shares with exact 95 % intervals. Medians over the flights, from 6 flights on with 95 % intervals; "
        f"tracking is that of {what}."
    )
    if len(summary.points) > _MOST:
        note += f" The first {_MOST} of {len(summary.points)} points; summary.json has all."
    formats = {**dict.fromkeys(columns, ".3g"), **dict.fromkeys(columns[len(columns) - len(estimates) :], ".2g")}
    return Table("points", "Points", columns, rows, formats, note)


def _estimate(summary: CampaignSummary, name: str) -> str | None:
    """Return the column that judges an estimator: its error after the failure, or its false alarms where nothing fails."""
    columns = (f"{name}.median_abs_error_post", f"{name}.false_alarms")
    return next((column for column in columns if summary.quantity(column) is not None), None)


def _short(column: str) -> str:
    return "|K-hat - K|" if column.endswith("median_abs_error_post") else "false alarms"


def _median(flights: FlightsSummary, column: str) -> Cell:
    if column not in flights.quantities:
        return None
    middle = flights.quantities[column].median
    return middle if isfinite(middle.low) and isfinite(middle.high) else middle.estimate


def _percent(of: ShareSummary | None) -> Cell:
    if of is None:
        return None
    interval = of.share
    return Interval(100 * interval.estimate, 100 * interval.low, 100 * interval.high, interval.runs)


def _maps(campaign: Campaign) -> list[Picture]:
    """Draw the share that passed (without criteria: departed) and the median tracking over two crossed axes."""
    settings = campaign.programme.settings
    axes = [axis for axis in campaign.programme.axes if not axis.is_drawn]
    if settings is None or settings.combine != "crossed" or len(axes) != 2:
        return []
    summary = campaign.summary
    judged, (tracked, what_for, unit, _) = summary.flights.passed is not None, summary.tracking.followed
    shares, medians = [], []
    for point in summary.points:
        of, tracking = point.flights.passed if judged else point.flights.departed, point.flights.quantities.get(tracked)
        shares.append(np.nan if of is None else 100.0 * of.share.estimate)
        medians.append(np.nan if tracking is None else tracking.median.estimate)
    what = "passed" if judged else "departed"
    explained = (
        f"Passed: {criteria_words(settings.criteria)}." if judged else "Departed: alpha more than 25 deg from trim."
    )
    return [
        _map("share", f"Share that {what}", f"{what}, % of flights", axes, shares, explained, limits=(0.0, 100.0)),
        _map("map-tracking", "Tracking", f"median RMS of {what_for}, {unit}", axes, medians, f"Median of {tracked} of a point's flights."),
    ]  # fmt: skip


def _map(
    key: str, title: str, label: str, axes: Sequence[AxisSettings], values: Sequence[float], text: str,
    limits: tuple[float, float] | None = None,
) -> Picture:  # fmt: skip
    down, across = (values_of(axis) for axis in axes)
    table: npt.NDArray[np.float64] = np.array(values).reshape(len(down), len(across))
    finite = table[np.isfinite(table)]
    low, high = limits or ((float(finite.min()), float(finite.max())) if finite.size else (0.0, 1.0))
    with drawing.canvas(height=max(2.8, min(7.0, 0.32 * len(down) + 1.0))) as ((axis,), svg):
        mesh = axis.pcolormesh(np.ma.masked_invalid(table), cmap="cividis", vmin=low, vmax=high or 1.0)
        axis.grid(visible=False)
        for set_ticks, shown in ((axis.set_xticks, across), (axis.set_yticks, down)):
            every = -(-len(shown) // 25)
            set_ticks(np.arange(0, len(shown), every) + 0.5, [value_words(v) for v in shown[::every]])
        axis.set_xlabel(axes[1].key)
        axis.set_ylabel(axes[0].key)
        if table.size <= _LABELLED:
            for (i, j), value in np.ndenumerate(table):
                dark = np.isfinite(value) and (value - low) < 0.55 * (high - low)
                axis.text(
                    j + 0.5, i + 0.5, show(float(value), ".3g"), ha="center", va="center", fontsize=7,
                    color="white" if dark else "black",
                )  # fmt: skip
        axis.figure.colorbar(mesh, ax=axis, label=label)
        words = f"From {finite.min():.3g} to {finite.max():.3g}." if finite.size else "Not defined for any flight."
        return Picture(key, title, drawing.distinct(svg(), key), text, words)
