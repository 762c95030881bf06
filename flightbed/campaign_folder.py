"""Campaign -> the files of its folder: scenario, campaign file, table, summary, report, traces."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isfinite
from pathlib import Path
from typing import Any

import tomli_w

from flightbed.bootstrap import RESAMPLES
from flightbed.campaign import Campaign, departed, passed
from flightbed.campaign_table import Row, quantities, write_table
from flightbed.card import FOLLOWED
from flightbed.consistency import estimates
from flightbed.folder import to_json
from flightbed.histories_file import write_histories
from flightbed.journal import Journal
from flightbed.mission import run as fly_one
from flightbed.percentiles import SAMPLE
from flightbed.programme import Programme, Values, scenario_of
from flightbed.statistics import Interval
from flightbed.versions import versions


def finish(campaign: Campaign, book: Journal) -> None:
    """Write what a finished campaign leaves, the summary last, and take away what told of an unfinished one. Raises OutputError."""
    from flightbed.campaign_report import campaign_report
    from flightbed.page import render

    programme = campaign.programme

    def put(name: str, text: str) -> None:
        book.put(name, lambda path: _write(path, text))

    if programme.settings is None:
        put("scenario.toml", campaign.scenario.to_toml())
    else:
        put("scenario.toml", tomli_w.dumps(programme.raw))
        put("campaign.toml", programme.settings.model_copy(update={"base": "scenario.toml"}).to_toml())
    put_table(campaign.rows, programme, book)
    put("report.html", render(campaign_report(campaign)))
    _put_histories(campaign, book)
    _put_traces(campaign, book)
    put("summary.json", to_json(summary(campaign)))
    book.finish()


def put_table(rows: Sequence[Row], programme: Programme, book: Journal) -> None:
    """Write the table. Raises OutputError."""
    keys = [axis.key for axis in programme.axes]
    book.put("table.parquet", lambda path: write_table(rows, path, keys))


def _put_histories(campaign: Campaign, book: Journal) -> None:
    if campaign.histories:
        control_hz = {point: campaign.programme.at(point).rates.control_hz for point in campaign.histories}
        book.put("histories.parquet", lambda path: write_histories(campaign.histories, control_hz, path))


def _put_traces(campaign: Campaign, book: Journal) -> None:
    settings = campaign.programme.settings
    if settings is None or settings.traces.keep == "none":
        return
    if settings.traces.keep == "worst":
        if campaign.worst is not None:
            book.put(f"traces/flight-{campaign.worst_index}.parquet", campaign.worst.trace.write)
        return
    failed = {row["index"] for row in campaign.failed}
    for index in settings.traces.indices:
        if index not in failed:
            scenario = scenario_of(campaign.programme.raw, campaign.programme.flight(index))
            book.put(f"traces/flight-{index}.parquet", fly_one(scenario).trace.write)


def _write(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8")


def summary(campaign: Campaign) -> dict[str, Any]:
    """Return what summary.json holds: nested plain values, null for what is infinite or cannot be said."""
    programme, rows, worst = campaign.programme, campaign.rows, campaign.worst
    return {
        "scenario": campaign.scenario.name,
        "name": programme.name,
        "campaign": programme.fingerprint,
        "flights": len(rows),
        "runs": programme.runs,
        **({"first_seed": campaign.scenario.seed} if programme.settings is None else {"seed": programme.settings.seed}),
        **summary_of(rows, programme),
        "bootstrap": {"resamples": RESAMPLES, **_resampled(campaign)},
        "histories": {"points": sorted(campaign.histories), "percentiles_of_flights": SAMPLE},
        "points": [
            {"point": number, "values": dict(values), "flights": len(there), **summary_of(there, programme)}
            for number, (values, there) in enumerate(by_point(campaign))
        ]
        if len(programme.points) > 1
        else [],
        "worst": None
        if worst is None
        else {
            "index": campaign.worst_index,
            "point": programme.flight(campaign.worst_index).point,
            "values": dict(programme.flight(campaign.worst_index).values),
            "seed": worst.summary["seed"],
            "reason": campaign.reason,
            "command": campaign.again,
            "metrics": worst.metrics.to_dict(),
        },
        "wall_time_s": campaign.wall_time_s,
        "aircraft_sha256": programme.aircraft[0],
        "versions": dict(versions()),
    }


def by_point(campaign: Campaign) -> list[tuple[Values, list[Row]]]:
    """Return the points with their rows."""
    runs = campaign.programme.runs
    points = enumerate(campaign.programme.points)
    return [(values, list(campaign.rows[number * runs : (number + 1) * runs])) for number, values in points]


def _resampled(campaign: Campaign) -> dict[str, Any]:
    """Return intervals by resampling of the mean and the percentiles of tracking, null where there are too few flights."""
    found: dict[str, Any] = {}
    for column in (f"tracking_rms_{when}_{key}" for _, key, _ in FOLLOWED[:2] for when in ("pre", "post")):
        quantity = campaign.quantity(column)
        if quantity.known:
            ends = {f"p{percent}": quantity.resampled_percentile(percent) for percent in (5, 50, 95)}
            found[column] = {
                name: [end if isfinite(end) else None for end in (interval.low, interval.high)]
                for name, interval in {"mean": quantity.mean, **ends}.items()
                if interval is not None
            }
    return found


def summary_of(rows: Sequence[Row], programme: Programme) -> Mapping[str, Any]:
    """Return what the summary says of some flights: how many raised, departed, passed; every number's median with its interval."""
    flown = [row for row in rows if row["error"] is None]
    ends = [row["ended"] for row in flown]
    scenario = programme.scenario
    numbers = {q.column: q.to_dict() for q in quantities(flown, scenario, programme.seed)}
    return {
        "errors": len(rows) - len(flown),
        "departed": _share(departed(rows), ends.count("departed")),
        "hit_ground": ends.count("ground"),
        "passed": _share(passed(rows), sum(row["passed"] is True for row in rows)),
        **{column: values for column, values in numbers.items() if "." not in column},
        "estimators": {
            name: {c.removeprefix(f"{name}."): v for c, v in numbers.items() if c.rpartition(".")[0] == name}
            for name in estimates(scenario)
        },
    }


def _share(interval: Interval | None, successes: int) -> dict[str, float | int] | None:
    if interval is None:
        return None
    return {"count": successes, "share": interval.estimate, "low": interval.low, "high": interval.high}
