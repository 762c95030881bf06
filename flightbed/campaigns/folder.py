"""Campaign -> the files of its folder: scenario, campaign file, table, summary, report, traces."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import tomli_w

from flightbed.analysis.result import fly_scenario
from flightbed.campaigns.histories_file import write_histories
from flightbed.campaigns.journal import Journal
from flightbed.campaigns.plan import Programme, scenario_of
from flightbed.campaigns.result import Campaign
from flightbed.campaigns.table import Row, write_table
from flightbed.core.files import to_json


def finish(campaign: Campaign, book: Journal) -> None:
    """Write the files of a finished campaign, the summary last, and remove the files of the unfinished one. Raises OutputError."""
    from flightbed.campaigns.report.page import campaign_report
    from flightbed.document.html import render

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
    put("summary.json", to_json(campaign.summary.to_dict()))
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
            book.put(f"traces/flight-{index}.parquet", fly_scenario(scenario).trace.write)


def _write(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8")
