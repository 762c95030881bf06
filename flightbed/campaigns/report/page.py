"""Campaign -> its report: headline, points, distributions, histories, medians, the worst flight."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flightbed.analysis.pull_up import PULL_UP_METRICS
from flightbed.analysis.result import Result
from flightbed.analysis.summary_text import FOLLOWED, outcome, settings_rows
from flightbed.campaigns.report.headline import flight_label, headline_section, median_cell
from flightbed.campaigns.report.histories import histories_sections
from flightbed.campaigns.report.points import points_section
from flightbed.campaigns.result import Campaign
from flightbed.campaigns.summary import CampaignSummary, WorstSummary
from flightbed.config.own_code import names_without_option, use_options
from flightbed.core.estimate_names import estimator_indices
from flightbed.core.units import unit_of
from flightbed.document import drawing, palette
from flightbed.document.document import Cell, Document, Listing, Picture, Section, Table
from flightbed.report.figures import pictures
from flightbed.report.flight_report import ESTIMATOR_METRICS, rerun_command
from flightbed.statistics.bootstrap import FEWEST, FEWEST_OF_PERCENTILE, RESAMPLES
from flightbed.statistics.intervals import Interval

Line = tuple[str, str, list[float]]  # name, colour, values

_BINS = 30
_MOST_ERRORS = 20  # different messages on the page
_MEANINGS = {
    "departed_at_s": "departure, over the flights that departed",
    "flown_s": "time flown",
    **{
        f"tracking_rms_{when}_{key}": f"RMS of {error} {words}"
        for error, key, _ in FOLLOWED
        for when, words in (
            ("pre", "before the first failure"),
            ("post", "from 0.3 s after the first failure; of a flight that ends early, up to its end"),
        )
    },
    **{key: meaning for key, (_, meaning) in {**PULL_UP_METRICS, **ESTIMATOR_METRICS}.items()},
}


def campaign_report(campaign: Campaign) -> Document:
    """Return the report of a campaign; equal flights give an equal report, apart from the wall time."""
    scenario, programme, worst, summary = campaign.scenario, campaign.programme, campaign.worst, campaign.summary
    aircraft = scenario.aircraft.model if worst is None else worst.plan.aircraft.name
    seeds, condition = _seeds(campaign), f"Mach {scenario.condition.mach:g}, {scenario.condition.altitude_ft:,.0f} ft"
    facts = {
        "again": _rerun_command(campaign),
        "flights": summary.flights.flights,
        "seeds": seeds,
        "wall_time_s": round(summary.wall_time_s, 1),
        "aircraft": f"{aircraft}, SHA-256 {', '.join(programme.aircraft)}",
        **({"notes": "; ".join(programme.notes)} if programme.notes else {}),
        "campaign": f"SHA-256 {summary.fingerprint}",
        "versions": dict(summary.versions),
    }
    what = [row if row[0] != "seed" else ("seeds", seeds) for row in settings_rows(scenario, aircraft)]
    title_of_settings = "Settings" if len(programme.axes) == 0 else "Fixed settings"
    sections = [
        *points_section(campaign),
        Section(title_of_settings, (), [Table("flown", "The flights", ("", ""), what)]),
        *([_failures(summary)] if summary.errors else []),
    ]
    if worst is not None and summary.worst is not None:
        sections += [
            Section("Distributions", (), _distributions(campaign)),
            *histories_sections(campaign),
            Section(
                "Medians and means",
                (),
                [*([_tracking_table(summary)] if summary.tracking.percentiles else []), *_medians(summary)],
            ),
            _worst(worst, summary.worst),
            rerun_command(
                scenario.to_toml(),
                summary.worst.options,
                worst.summary.versions,
                names_without_option(worst.summary.own_code),
            ),
        ]
    where = f" at {condition}" if len(programme.points) == 1 else f", {len(programme.points)} points"
    title = f"{programme.name}: {summary.flights.flights} flights of {aircraft}{where}"
    return Document(title, sections, facts, headline_section(campaign))


def _seeds(campaign: Campaign) -> str:
    programme = campaign.programme
    if programme.settings is not None:
        return f"one of every flight, from the campaign's seed {programme.settings.seed} and the flight's index"
    return f"{programme.scenario.seed} to {programme.scenario.seed + len(programme) - 1}"


def _rerun_command(campaign: Campaign) -> str:
    own = "" if campaign.worst is None else use_options(campaign.worst.summary.own_code)
    if campaign.programme.settings is not None:
        return f"flightbed campaign FOLDER/campaign.toml{own}"
    return f"flightbed campaign FOLDER/scenario.toml --runs {len(campaign.rows)}{own}"


def _failures(summary: CampaignSummary) -> Section:
    """Return the errors that flights raised, each message once."""
    rows: list[list[Cell]] = [
        [len(error.indices), ", ".join(map(str, error.indices[:5])) + (", ..." if len(error.indices) > 5 else ""), error.message]
        for error in sorted(summary.errors, key=lambda error: -len(error.indices))[:_MOST_ERRORS]
    ]  # fmt: skip
    text = f"{summary.flights.errors} of {summary.flights.flights} flights raised an error; no other number on this page includes them."
    return Section("Flights that failed", (text,), [Table("errors", "Errors", ("flights", "indices", "error"), rows)])


def _medians(summary: CampaignSummary) -> list[Table]:
    columns = ("metric", "unit", "median (95 % interval)", "mean (95 % interval)", "5 %", "95 %", "flights", "never in")
    note = (
        "The median's interval is exact for any distribution, at least 95 %; with fewer than 6 flights it is open. An event that did not "
        "occur counts as infinite in the median; the 5 and 95 % percentiles leave it out, and the mean is not defined. The mean's interval "
        f"is bootstrapped (BCa, {RESAMPLES} resamples from the campaign's seed), from {FEWEST} flights on."
    )
    tables, known = [], dict[str, None]()
    for owner in ("", *summary.flights.estimators):
        quantities = summary.flights.of_owner(owner)
        known |= dict.fromkeys(quantities)
        rows: list[list[Cell]] = [
            [
                key,
                unit_of(key),
                median_cell(q),
                _finite_interval(q.mean),
                q.p5.estimate,
                q.p95.estimate,
                q.flights,
                q.never or None,
            ]
            for key, q in quantities.items()
        ]
        title = f"Estimator '{owner}'" if owner else "The flights"
        key, spec = (f"medians-{owner}", ".3g") if owner else ("medians", ".4g")
        tables.append(Table(key, title, columns, rows, dict.fromkeys(columns, spec), "" if owner else note))
    tables.append(Table("meanings", "Metrics", ("metric", "meaning"), [[key, _MEANINGS[key]] for key in known]))
    return tables


def _finite_interval(interval: Interval | None) -> Cell:
    """Return an interval for a table cell; only its estimate where an end is infinite."""
    if interval is None or np.isfinite([interval.low, interval.high]).all():
        return interval
    return interval.estimate


def _tracking_table(summary: CampaignSummary) -> Table:
    """Return mean and percentiles of the tracking RMS, with exact and with bootstrapped intervals."""
    followed, exact = summary.tracking.followed, summary.tracking.percentiles
    resampled = summary.resampled[followed.column]
    mean = resampled.mean
    rows: list[list[Cell]] = [["mean", None if mean is None else mean.estimate, None, _ends(mean)]]
    for percent, interval in exact.items():
        rows.append([f"{percent} %", interval.estimate, _ends(interval), _ends(resampled.percentiles[percent])])
    columns = (
        f"RMS of {followed.what}, {followed.unit}",
        "estimate",
        "exact 95 % interval",
        "bootstrapped 95 % interval",
    )
    note = (
        f"Exact: between order statistics, for any distribution; none for the mean. Bootstrapped from {RESAMPLES} resamples: "
        f"the mean BCa, from {FEWEST} flights on; percentiles by the percentile method, from {FEWEST_OF_PERCENTILE} on; at 5 and 95 % "
        "their coverage is too low, about 86 % with 100 flights."
    )
    return Table("tracked", "Tracking", columns, rows, dict.fromkeys(columns, ".4g"), note)


def _ends(interval: Interval | None) -> str:
    if interval is None or not np.isfinite([interval.low, interval.high]).all():
        return "too few flights"
    return f"{interval.low:.4g} to {interval.high:.4g}"


def _colors(campaign: Campaign) -> dict[str, str]:
    return {name: palette.estimate(i) for name, i in estimator_indices(campaign.estimators).items()}


def _distributions(campaign: Campaign) -> list[Picture]:
    """Return histograms: tracking by outcome, and the errors and delays of every estimator."""
    followed = campaign.summary.tracking.followed
    chosen = campaign.quantity(followed.column)
    gone = [row["departed"] for row in campaign.flown]
    by_end: list[Line] = [
        (name, color, [v for v, away in zip(chosen.values, gone, strict=True) if v is not None and away == wanted])
        for name, color, wanted in (("not departed", drawing.ACTUAL, False), ("departed", drawing.FAILURE, True))
    ]
    what, after = f"RMS of {followed.what}", "from 0.3 s after the failure" if followed.after else "of the whole flight"
    found = [_histogram("tracking", "Tracking", f"{what} {after}.", f"{what}, {followed.unit}", by_end)]
    for key, title, text, label in (
        ("median_abs_error_post", "Error of K", "Of each flight the median from 0.3 s after the failure.", "median |K-hat - K|"),
        ("first_within_20pct_s", "Settling", "From the failure to the first K-hat within +-20 % of K.", "time after the failure, s"),
        ("detected_at_s", "Detection", "From the failure to the first alarm after it.", "time after the failure, s"),
    ):  # fmt: skip
        lines = [(n, color, campaign.quantity(f"{n}.{key}").known) for n, color in _colors(campaign).items()]
        tick_s = 1.0 / campaign.scenario.rates.control_hz if key.endswith("_s") else None
        found.append(_histogram(key.replace("_", "-"), title, text, label, lines, tick_s))
    return [picture for picture in found if picture is not None]


def _histogram(
    key: str, title: str, text: str, label: str, lines: Sequence[Line], tick_s: float | None = None
) -> Picture | None:
    """Draw a histogram per line, each on its own axes; None without values. Bins of times hold whole ticks."""
    shown = [(name, color, [v for v in values if np.isfinite(v)]) for name, color, values in lines]
    shown = [(name, color, values) for name, color, values in shown if values]
    if not shown:
        return None
    words = [f"{name}: {_range(values)}." for name, _, values in lines if values]
    with drawing.canvas(len(shown), height=1.7, share_x=False) as (axes, svg):
        for axis, (name, color, values) in zip(axes, shown, strict=True):
            axis.hist(values, _edges(min(values), max(values), tick_s), color=color, alpha=0.6, label=name)
            axis.axvline(float(np.median(values)), color=color, linewidth=1.6)
            axis.set_axisbelow(True)
            axis.set_ylabel("flights")
            axis.locator_params(axis="y", integer=True)
            axis.ticklabel_format(axis="x", useOffset=False)
            drawing.legend(axis)
        axes[-1].set_xlabel(label)
        return Picture(key, title, drawing.distinct(svg(), key), f"{text} A line marks the median.", " ".join(words))


def _range(values: Sequence[float]) -> str:
    happened = [v for v in values if np.isfinite(v)]
    never = f", never in {len(values) - len(happened)}" if len(happened) < len(values) else ""
    if not happened:
        return f"never in {len(values)} flights"
    return f"median {np.median(happened):.4g}, {min(happened):.4g} to {max(happened):.4g}, {len(values)} flights{never}"


def _edges(low: float, high: float, tick_s: float | None) -> list[float]:
    """Return the edges of the bins from the smallest to the largest value; bins of times are centred on whole ticks."""
    if tick_s is None:
        pad = 0.0 if high - low > 1e-9 * abs(high) else 0.05 * (abs(high) or 1.0)
        edges: list[float] = np.linspace(low - pad, high + pad, _BINS + 1).tolist()
        return edges
    first, last = round(low / tick_s), round(high / tick_s)
    each = (last - first) // _BINS + 1
    return [(first - 0.5 + each * i) * tick_s for i in range((last - first) // each + 2)]


def _worst(worst: Result, found: WorstSummary) -> Section:
    stayed = f"; {outcome(worst.summary)}" if worst.summary.ended == "time" else ""
    label = flight_label(found)
    text = f"{label[0].upper()}{label[1:-2]}: {found.reason}{stayed}."
    listing = Listing("Command that repeats this flight, with its own report", found.rerun_command)
    return Section("The worst flight", (text,), [listing, *pictures(worst, ("pitch-rate", "effectiveness"))])
