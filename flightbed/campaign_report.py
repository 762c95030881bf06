"""Campaign -> its report: how many departed, its points, distributions, histories, medians, the worst flight."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flightbed import drawing, palette
from flightbed.bootstrap import FEWEST, FEWEST_OF_PERCENTILE, RESAMPLES
from flightbed.campaign import Campaign
from flightbed.campaign_ensembles import histories_sections
from flightbed.campaign_lead import lead, often, tracking, which
from flightbed.campaign_points import points_section
from flightbed.campaign_table import followed
from flightbed.card import FOLLOWED, flown, outcome
from flightbed.document import Cell, Document, Listing, Picture, Section, Table
from flightbed.extension import at_hand, permits
from flightbed.figures import pictures
from flightbed.naming import numbered
from flightbed.percentiles import PERCENTILES
from flightbed.pull_up import PULL_UP_METRICS
from flightbed.report import ESTIMATOR_METRICS, again
from flightbed.statistics import Interval
from flightbed.units import unit_of
from flightbed.versions import versions

Line = tuple[str, str, list[float]]  # name, colour, values

_BINS = 30
_MOST_ERRORS = 20  # that the page tells
_MEANINGS = {
    "departed_at_s": "departure, over the flights that departed",
    "flown_s": "time flown",
    **{
        f"tracking_rms_{when}_{key}": f"RMS of {error} {words}"
        for error, key, _ in FOLLOWED
        for when, words in (
            ("pre", "before the first failure"),
            ("post", "from 0.3 s after the first failure; of a flight that ends early, as far as it got"),
        )
    },
    **{key: meaning for key, (_, meaning) in {**PULL_UP_METRICS, **ESTIMATOR_METRICS}.items()},
}


def campaign_report(campaign: Campaign) -> Document:
    """Return the report of a campaign; the same for the same flights, but for the time that they took."""
    scenario, programme, worst = campaign.scenario, campaign.programme, campaign.worst
    aircraft = scenario.aircraft.model if worst is None else worst.plan.aircraft.name
    seeds, condition = _seeds(campaign), f"Mach {scenario.condition.mach:g}, {scenario.condition.altitude_ft:,.0f} ft"
    facts = {
        "again": _all_again(campaign),
        "flights": len(campaign.rows),
        "seeds": seeds,
        "wall_time_s": round(campaign.wall_time_s, 1),
        "aircraft": f"{aircraft}, SHA-256 {', '.join(programme.aircraft)}",
        "campaign": f"SHA-256 {programme.fingerprint}",
        "versions": dict(versions()),
    }
    what = [row if row[0] != "seed" else ("seeds", seeds) for row in flown(scenario, aircraft)]
    varied = "What flew" if len(programme.axes) == 0 else "What flew, but for what is varied"
    sections = [
        *points_section(campaign),
        Section(varied, (), [Table("flown", "The flights", ("", ""), what)]),
        *([_failures(campaign)] if campaign.failed else []),
    ]
    if worst is not None:
        sections += [
            Section("How the flights differ", (), _distributions(campaign)),
            *histories_sections(campaign),
            Section(
                "Medians and means",
                (),
                [*([_tracked(campaign)] if tracking(campaign).known else []), *_medians(campaign)],
            ),
            _worst(campaign),
            again(scenario.to_toml(), campaign.override, worst.summary["versions"], at_hand(worst.summary)),
        ]
    where = f" at {condition}" if len(programme.points) == 1 else f", {len(programme.points)} points"
    title = f"{programme.name}: {len(campaign.rows)} flights of {aircraft}{where}"
    return Document(title, sections, facts, lead(campaign))


def _seeds(campaign: Campaign) -> str:
    programme = campaign.programme
    if programme.settings is not None:
        return f"one of every flight, from the campaign's seed {programme.settings.seed} and the flight's index"
    return f"{programme.scenario.seed} to {programme.scenario.seed + len(programme) - 1}"


def _all_again(campaign: Campaign) -> str:
    own = "" if campaign.worst is None else permits(campaign.worst.summary)
    if campaign.programme.settings is not None:
        return f"flightbed campaign FOLDER/campaign.toml{own}"
    return f"flightbed campaign FOLDER/scenario.toml --runs {len(campaign.rows)}{own}"


def _failures(campaign: Campaign) -> Section:
    """Return what the flights that raised have said, each message once."""
    said: dict[str, list[int]] = {}
    for row in campaign.failed:
        said.setdefault(str(row["error"]), []).append(int(row["index"] or 0))
    rows: list[list[Cell]] = [
        [len(indices), ", ".join(map(str, indices[:5])) + (", ..." if len(indices) > 5 else ""), error]
        for error, indices in sorted(said.items(), key=lambda item: -len(item[1]))[:_MOST_ERRORS]
    ]
    text = f"{len(campaign.failed)} of {len(campaign.rows)} flights raised an error; they are in no other number of this page."
    return Section("Flights that failed", (text,), [Table("errors", "Errors", ("flights", "indices", "error"), rows)])


def _medians(campaign: Campaign) -> list[Table]:
    columns = ("metric", "unit", "median (95 % interval)", "mean (95 % interval)", "5 %", "95 %", "flights", "never in")
    note = (
        "The median's interval holds it with at least 95 % whatever the distribution; fewer than 6 flights leave it open. What never "
        "happened counts as infinite in it, and is left out of the range from 5 to 95 %; there is no mean then. The mean's interval "
        f"is bootstrapped (BCa, {RESAMPLES} resamples from the campaign's seed), from {FEWEST} flights on."
    )
    tables, told = [], campaign.quantities()
    for owner in ("", *campaign.estimators):
        rows: list[list[Cell]] = []
        for q in told:
            name, _, key = q.column.rpartition(".")
            if name == owner:
                around = (q.spread.low, q.spread.high)
                rows.append([key, unit_of(key), often(q), _closed(q.mean), *around, len(q.known), q.never or None])
        title = f"Estimator '{owner}'" if owner else "The flights"
        key, spec = (f"medians-{owner}", ".3g") if owner else ("medians", ".4g")
        tables.append(Table(key, title, columns, rows, dict.fromkeys(columns, spec), "" if owner else note))
    known = dict.fromkeys(q.column.rpartition(".")[2] for q in told)
    tables.append(Table("meanings", "What they are", ("metric", "meaning"), [[key, _MEANINGS[key]] for key in known]))
    return tables


def _closed(interval: Interval | None) -> Cell:
    """Return an interval for a table; its estimate alone where it is open."""
    if interval is None or np.isfinite([interval.low, interval.high]).all():
        return interval
    return interval.estimate


def _tracked(campaign: Campaign) -> Table:
    """Return mean and percentiles of tracking with exact intervals, as far as there are any, and bootstrapped ones."""
    chosen = tracking(campaign)
    rows: list[list[Cell]] = [["mean", None if chosen.mean is None else chosen.mean.estimate, None, _ends(chosen.mean)]]
    for percent in PERCENTILES:
        exact = chosen.percentile(percent)
        rows.append([f"{percent} %", exact.estimate, _ends(exact), _ends(chosen.resampled_percentile(percent))])
    told_of = followed(campaign.flown)
    columns = (
        f"RMS of {told_of.what}, {told_of.unit}",
        "estimate",
        "exact 95 % interval",
        "bootstrapped 95 % interval",
    )
    note = (
        f"Exact: between order statistics, whatever the distribution; of the mean there is none. Bootstrapped from {RESAMPLES} resamples: "
        f"the mean BCa, from {FEWEST} flights on; percentiles by the percentile method, from {FEWEST_OF_PERCENTILE} on; at 5 and 95 % "
        "these hold what they should too seldom, of 100 flights in about 86 % of campaigns."
    )
    return Table("tracked", "Tracking", columns, rows, dict.fromkeys(columns, ".4g"), note)


def _ends(interval: Interval | None) -> str:
    if interval is None or not np.isfinite([interval.low, interval.high]).all():
        return "too few flights"
    return f"{interval.low:.4g} to {interval.high:.4g}"


def _colors(campaign: Campaign) -> dict[str, str]:
    return {name: palette.estimate(i) for name, i in numbered(campaign.estimators).items()}


def _distributions(campaign: Campaign) -> list[Picture]:
    """Return histograms: of tracking by what came of the flight, of the errors and delays of every estimator."""
    chosen = tracking(campaign)
    gone = [row["departed"] for row in campaign.flown]
    by_end: list[Line] = [
        (name, color, [v for v, away in zip(chosen.values, gone, strict=True) if v is not None and away == wanted])
        for name, color, wanted in (("stayed", drawing.ACTUAL, False), ("departed", drawing.FAILURE, True))
    ]
    told_of = followed(campaign.flown)
    what, after = f"RMS of {told_of.what}", "from 0.3 s after the failure" if told_of.after else "of the whole flight"
    found = [_histogram("tracking", "Tracking", f"{what} {after}.", f"{what}, {told_of.unit}", by_end)]
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
    """Draw how often which values occur, each kind on axes of its own; None if there are none. Times come in whole ticks."""
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
    """Return the edges of the bins from a least to a largest value; of times, with whole ticks in their middle."""
    if tick_s is None:
        pad = 0.0 if high - low > 1e-9 * abs(high) else 0.05 * (abs(high) or 1.0)
        edges: list[float] = np.linspace(low - pad, high + pad, _BINS + 1).tolist()
        return edges
    first, last = round(low / tick_s), round(high / tick_s)
    each = (last - first) // _BINS + 1
    return [(first - 0.5 + each * i) * tick_s for i in range((last - first) // each + 2)]


def _worst(campaign: Campaign) -> Section:
    worst = campaign.worst
    assert worst is not None
    stayed = f"; {outcome(worst.summary)}" if worst.summary["ended"] == "time" else ""
    named = which(campaign)
    text = f"{named[0].upper()}{named[1:-2]}: {campaign.reason}{stayed}."
    listing = Listing("It flies again, with a report of its own, by", campaign.again)
    return Section("The worst flight", (text,), [listing, *pictures(worst, ("pitch-rate", "effectiveness"))])
