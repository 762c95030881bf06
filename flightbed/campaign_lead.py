"""What a reader should know of a campaign after ten seconds: how many departed and passed, how well they tracked, the worst flight."""

from __future__ import annotations

import numpy as np

from flightbed.campaign import Campaign
from flightbed.campaign_points import axis_words, criteria_words, value_words
from flightbed.campaign_table import Quantity, followed
from flightbed.card import correction
from flightbed.document import Cell, Section, Table, show
from flightbed.event_log import failures, gusts
from flightbed.statistics import Interval


def tracking(campaign: Campaign) -> Quantity:
    """Return the tracking that counts, see ``campaign_table.followed``."""
    return campaign.quantity(followed(campaign.flown).column)


def headline(campaign: Campaign) -> str:
    """Return in a few sentences how many flew, departed and passed, and how well they tracked."""
    departed, passed, settings = campaign.departed, campaign.passed, campaign.programme.settings
    failed = (
        f"{len(campaign.failed)} of {len(campaign.rows)} flights failed: {campaign.failed[0]['error']}."
        if campaign.failed
        else ""
    )
    if departed is None:
        return failed
    chosen = tracking(campaign)
    told = [f"{_share(departed, 'flights departed')}."]
    if passed is not None and settings is not None:
        told.append(f"{_share(passed, 'passed')}; to pass: {criteria_words(settings.criteria)}.")
    if chosen.known:
        told_of = followed(campaign.flown)
        after = " from 0.3 s after the failure" if told_of.after else ""
        told.append(f"Median RMS of {told_of.what}{after}: {_interval(chosen, '.3g')} {told_of.unit}.")
    return " ".join([*told, *([failed] if failed else [])])


def _share(share: Interval, what: str) -> str:
    count = round(share.estimate * share.runs)
    return f"{count} of {share.runs} {what}: {share.estimate:.1%} (95 % interval {share.low:.1%} to {share.high:.1%})"


def _interval(quantity: Quantity, spec: str) -> str:
    middle = quantity.median
    if not np.isfinite([middle.low, middle.high]).all():
        return f"{show(middle.estimate, spec)} (too few flights for an interval)"
    return f"{show(middle.estimate, spec)} (95 % interval {middle.low:{spec}} to {middle.high:{spec}})"


def lead(campaign: Campaign) -> Section:
    """Return what a reader should know after ten seconds."""
    scenario = campaign.scenario
    happened = "; ".join([*failures(scenario), *gusts(scenario)]) or "nothing fails"
    varied = "; ".join(f"{axis.key}: {axis_words(axis)}" for axis in campaign.programme.axes)
    text = [
        headline(campaign),
        *([f"Varied: {varied}."] if varied else []),
        f"{f'Base scenario: {happened}' if varied else f'{happened[0].upper()}{happened[1:]}'}. The {scenario.control.law} law is "
        f"{correction(scenario)}.",
        f"Worst flight: {which(campaign)}{campaign.reason}.",
    ]
    keys = ("median_abs_error_post", "first_within_20pct_s", "detected_at_s", "nis_mean", "nees_mean_post")
    columns = (
        "estimator",
        "median |K-hat - K|",
        "within 20 % after, s",
        "alarm after, s",
        "mean NIS (if right)",
        "NEES (1 is right)",
    )
    rows: list[list[Cell]] = []
    for name in campaign.estimators:
        quantities = [campaign.quantity(f"{name}.{key}") for key in keys]
        rows.append([name, *(often(q) for q in quantities)])
    note = "Medians over the flights, with 95 % interval."
    return Section("", text, [Table("key", "", columns, rows, dict.fromkeys(columns, ".3g"), note)] if rows else ())


def which(campaign: Campaign) -> str:
    """Return what tells the worst flight from the others: number, values, seed."""
    if campaign.worst is None:
        return ""
    flight = campaign.programme.flight(campaign.worst_index)
    values = "".join(f"{key} = {value_words(value)}, " for key, value in flight.values.items())
    return f"{f'number {flight.index}, ' if values else ''}{values}seed {flight.seed}, "


def often(quantity: Quantity) -> Cell:
    """Return the median of a quantity for a table: never where it never happened, none where it cannot be said."""
    if not quantity.known:
        return None
    return "never" if quantity.never == len(quantity.known) else quantity.median
