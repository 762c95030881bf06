"""Headline of a campaign: shares that departed and passed, tracking, the worst flight, the estimators."""

from __future__ import annotations

import numpy as np

from flightbed.analysis.events import failures, gusts
from flightbed.analysis.summary_text import correction
from flightbed.campaigns.report.points import axis_words, criteria_words, value_words
from flightbed.campaigns.result import Campaign
from flightbed.campaigns.summary import CampaignSummary, QuantitySummary, ShareSummary, WorstSummary
from flightbed.document.document import Cell, Section, Table, show
from flightbed.statistics.intervals import Interval


def headline(summary: CampaignSummary) -> str:
    """Return the headline as sentences: flights that departed and passed, tracking, errors."""
    flights, followed = summary.flights, summary.tracking.followed
    failed = (
        [f"{flights.errors} of {flights.flights} flights failed: {summary.errors[0].message}."]
        if summary.errors
        else []
    )
    if flights.departed is None:
        return " ".join(failed)
    sentences = [f"{_share(flights.departed, 'flights departed')}."]
    if flights.passed is not None:
        sentences.append(f"{_share(flights.passed, 'passed')}; to pass: {criteria_words(summary.criteria)}.")
    tracking = summary.quantity(followed.column)
    if tracking is not None:
        after = " from 0.3 s after the failure" if followed.after else ""
        sentences.append(f"Median RMS of {followed.what}{after}: {_interval(tracking.median, '.3g')} {followed.unit}.")
    return " ".join([*sentences, *failed])


def _share(of: ShareSummary, what: str) -> str:
    share = of.share
    return (
        f"{of.count} of {share.runs} {what}: {share.estimate:.1%} (95 % interval {share.low:.1%} to {share.high:.1%})"
    )


def _interval(middle: Interval, spec: str) -> str:
    if not np.isfinite([middle.low, middle.high]).all():
        return f"{show(middle.estimate, spec)} (too few flights for an interval)"
    return f"{show(middle.estimate, spec)} (95 % interval {middle.low:{spec}} to {middle.high:{spec}})"


def headline_section(campaign: Campaign) -> Section:
    """Return the first section of the report."""
    scenario, summary = campaign.scenario, campaign.summary
    happened = "; ".join([*failures(scenario), *gusts(scenario)]) or "no failures or gusts"
    varied = "; ".join(f"{axis.key}: {axis_words(axis)}" for axis in campaign.programme.axes)
    text = [
        headline(summary),
        *([f"Varied: {varied}."] if varied else []),
        f"{f'Base scenario: {happened}' if varied else f'{happened[0].upper()}{happened[1:]}'}. The {scenario.control.law} law is "
        f"{correction(scenario)}.",
        f"Worst flight: {flight_label(summary.worst)}{campaign.reason}.",
    ]
    keys = ("median_abs_error_post", "first_within_20pct_s", "detected_at_s", "nis_mean", "nees_mean_post")
    columns = (
        "estimator",
        "median |K-hat - K|",
        "within 20 % after, s",
        "alarm after, s",
        "mean NIS (expected)",
        "NEES (expected: 1)",
    )
    rows: list[list[Cell]] = [
        [name, *(median_cell(summary.quantity(f"{name}.{key}")) for key in keys)] for name in campaign.estimators
    ]
    note = "Medians over the flights, with 95 % interval."
    return Section("", text, [Table("key", "", columns, rows, dict.fromkeys(columns, ".3g"), note)] if rows else ())


def flight_label(flight: WorstSummary | None) -> str:
    """Return number, values and seed that identify a flight; empty for None."""
    if flight is None:
        return ""
    values = "".join(f"{key} = {value_words(value)}, " for key, value in flight.values.items())
    return f"{f'number {flight.index}, ' if values else ''}{values}seed {flight.seed}, "


def median_cell(quantity: QuantitySummary | None) -> Cell:
    """Return the median for a table cell: "never" where the event occurred in no flight, None where no flight has it."""
    if quantity is None:
        return None
    return "never" if quantity.never == quantity.flights else quantity.median
