"""Campaign -> its report: how many departed, its points, distributions, mean and one-sigma histories, medians, the worst flight."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from flightbed import drawing, palette
from flightbed.campaign import Campaign
from flightbed.campaign_points import axis_words, criteria_words, points_section, value_words
from flightbed.campaign_table import Quantity
from flightbed.card import FOLLOWED, correction, flown, outcome
from flightbed.document import Cell, Document, Listing, Picture, Section, Table, show
from flightbed.event_log import failures, gusts
from flightbed.extension import at_hand, permits
from flightbed.figures import MARGIN, mark_changes, pictures
from flightbed.moments import Moments
from flightbed.naming import numbered
from flightbed.programme import versions
from flightbed.report import ESTIMATOR_METRICS, again
from flightbed.statistics import Interval
from flightbed.trace import true_share
from flightbed.units import unit_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Vector = npt.NDArray[np.float64]
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
    **{key: meaning for key, (_, meaning) in ESTIMATOR_METRICS.items()},
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
            *(
                [Section("Mean and one sigma", (), _histories(campaign, campaign.histories))]
                if campaign.histories
                else []
            ),
            Section("Medians", (), _medians(campaign)),
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


def tracking(campaign: Campaign) -> Quantity:
    """Return the tracking that counts: after the failure, or of the whole flights where nothing fails."""
    after = campaign.quantity("tracking_rms_post_deg_s")
    return after if after.known else campaign.quantity("tracking_rms_pre_deg_s")


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
        after = "" if chosen.column.endswith("pre_deg_s") else " from 0.3 s after the failure"
        told.append(f"Median RMS of q - q_ref{after}: {_interval(chosen, '.3g')} deg/s.")
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
        *([f"Varied: {varied}. Of the base scenario:"] if varied else []),
        f"{happened[0].upper()}{happened[1:]}. The {scenario.control.law} law is {correction(scenario)}. "
        f"Worst flight: {_which(campaign)}{campaign.reason}.",
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
        rows.append([name, *(_often(q) for q in quantities)])
    note = "Medians over the flights, with 95 % interval."
    return Section("", text, [Table("key", "", columns, rows, dict.fromkeys(columns, ".3g"), note)] if rows else ())


def _which(campaign: Campaign) -> str:
    if campaign.worst is None:
        return ""
    flight = campaign.programme.flight(campaign.worst_index)
    values = "".join(f"{key} = {value_words(value)}, " for key, value in flight.values.items())
    return f"{f'number {flight.index}, ' if values else ''}{values}seed {flight.seed}, "


def _often(quantity: Quantity) -> Cell:
    """Return the median of a quantity for a table: never where it never happened, none where it cannot be said."""
    if not quantity.known:
        return None
    return "never" if quantity.never == len(quantity.known) else quantity.median


def _medians(campaign: Campaign) -> list[Table]:
    columns = ("metric", "unit", "median (95 % interval)", "5 %", "95 %", "flights", "never in", "meaning")
    note = (
        "The interval holds the median with at least 95 % whatever the distribution; fewer than 6 flights leave it open. What never "
        "happened counts as infinite in it, and is left out of the range from 5 to 95 %."
    )
    tables = []
    for owner in ("", *campaign.estimators):
        rows: list[list[Cell]] = []
        for q in campaign.quantities():
            name, _, key = q.column.rpartition(".")
            if name == owner:
                around = (q.spread.low, q.spread.high)
                rows.append([key, unit_of(key), _often(q), *around, len(q.known), q.never or None, _MEANINGS[key]])
        title = f"Estimator '{owner}'" if owner else "The flights"
        key = f"medians-{owner}" if owner else "medians"
        tables.append(
            Table(key, title, columns, rows, dict.fromkeys(columns, ".3g" if owner else ".4g"), "" if owner else note)
        )
    return tables


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
    after = "of the whole flight" if chosen.column.endswith("pre_deg_s") else "from 0.3 s after the failure"
    found = [_histogram("tracking", "Tracking", f"RMS of q - q_ref {after}.", "RMS of q - q_ref, deg/s", by_end)]
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


def _histories(campaign: Campaign, histories: Moments) -> list[Picture]:
    scenario, flying = campaign.scenario, histories.flying
    flights = int(flying[0])
    t = np.arange(len(flying)) / scenario.rates.control_hz
    alone = drawing.ACTUAL

    def band(axis: Axes, column: str, color: str, label: str) -> tuple[Vector, Vector]:
        mean, std = histories.mean[column], histories.std(column)
        drawing.band(axis, t, mean - std, mean + std, color=color, alpha=0.25)
        drawing.line(axis, t, mean, color=color, label=label)
        return mean, std

    def motion(axes: list[Axes]) -> str:
        drawing.line(axes[0], t, histories.mean["q_ref_deg_s"], color=drawing.REFERENCE, label="reference")
        words = []
        for axis, column, label in zip(
            axes, ("q_deg_s", "alpha_deg", "elevator_deg"), ("pitch rate, deg/s", "angle of attack, deg", "elevator, deg"), strict=False
        ):  # fmt: skip
            _, std = band(axis, column, alone, "mean, +-1 sigma")
            axis.set_ylabel(label)
            finite = np.where(np.isfinite(std), std, 0.0)
            words.append(f"{label.partition(',')[0]}: sigma up to {finite.max():.3g}, at {t[finite.argmax()]:.2f} s")
        if len(axes) > 3:
            drawing.line(axes[3], t, flying.astype(np.float64), color=drawing.OTHER)
            axes[3].set_ylim(0.0, 1.05 * flights)
            axes[3].set_ylabel("still flying")
            words.append(f"{flying[-1]} of {flights} fly at {t[-1]:.2f} s")
        return "; ".join(words) + "."

    def gain(axes: list[Axes]) -> str:
        words = []
        for axis, (name, color) in zip(axes, _colors(campaign).items(), strict=True):
            truth = histories.mean[true_share(name)]
            drawing.line(axis, t, truth, color=drawing.TRUTH, linewidth=2.2, label="truth")
            mean, std = band(axis, f"{name}.effectiveness_smoothed", color, f"smoothed K of '{name}', mean, +-1 sigma")
            axis.set_ylim(-0.08, max(1.25, min(3.0, float(np.nanmax(mean[t > 0.3], initial=0.0)) + 0.1)))
            axis.set_ylabel("K")
            words.append(f"'{name}' ends at {mean[-1]:.3f} +- {std[-1]:.2g} (truth {truth[-1]:.3f}).")
        return " ".join(words)

    early = flying[-1] < flights or len(t) < scenario.ticks
    figures: list[tuple[str, str, int, Callable[[list[Axes]], str]]] = [
        ("motion", "Motion and elevator", 3 + early, motion)
    ]
    if campaign.estimators:
        figures.append(("gain", "Smoothed K", len(campaign.estimators), gain))
    text = "Mean over the flights that still fly, and one standard deviation to either side."
    return [_history(campaign, key, title, rows, draw, text, float(t[-1])) for key, title, rows, draw in figures]


def _history(
    campaign: Campaign, key: str, title: str, rows: int, draw: Callable[[list[Axes]], str], text: str, end_s: float
) -> Picture:
    with drawing.canvas(rows, height=1.8, margin=MARGIN) as (axes, svg):
        facts = draw(axes)
        for axis in axes:
            mark_changes(axis, campaign.scenario, end_s, name=axis is axes[0])
            axis.set_xlim(0.0, max(end_s, 1e-3))
            drawing.legend(axis)
        axes[-1].set_xlabel("time, s")
        return Picture(key, title, drawing.distinct(svg(), key), text, facts)


def _worst(campaign: Campaign) -> Section:
    worst = campaign.worst
    assert worst is not None
    stayed = f"; {outcome(worst.summary)}" if worst.summary["ended"] == "time" else ""
    which = _which(campaign)
    text = f"{which[0].upper()}{which[1:-2]}: {campaign.reason}{stayed}."
    listing = Listing("It flies again, with a report of its own, by", campaign.again)
    return Section("The worst flight", (text,), [listing, *pictures(worst, ("pitch-rate", "effectiveness"))])
